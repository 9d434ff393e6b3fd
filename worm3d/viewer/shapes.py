"""Small meshes that everything is put together of; y is their long axis, as in three.js."""

from __future__ import annotations

import numpy as np

from worm3d.viewer.tube import Mesh, rings_mesh


def capsule(length: float, radius: float, *, sides: int = 8) -> Mesh:
    """Return a bar along y, centred, with rounded ends within a radius beyond its length [m]."""
    half = 0.5 * length
    return _turned(
        [(-half - 0.7 * radius, 0.6 * radius), (-half, radius), (half, radius), (half + 0.7 * radius, 0.6 * radius)],
        sides,
    )


def disc(radius: float, thick: float, *, sides: int = 32) -> Mesh:
    """Return a disc across y, from the origin to y = `thick`, with its edge there rounded off [m]."""
    return _turned([(0.0, radius), (0.5 * thick, radius), (thick, radius - 0.5 * thick)], sides)


def ball(*, rings: int = 17, sides: int = 28) -> Mesh:
    """Return a ball of radius 1."""
    angle = np.pi * (np.arange(rings) + 0.5) / rings
    return _turned(list(zip(-np.cos(angle), np.sin(angle), strict=True)), sides, pole=1.0)


def arrow(*, sides: int = 10) -> Mesh:
    """Return an arrow from the origin to y = 1, 0.1 in radius."""
    return _turned([(0.0, 0.04), (0.7, 0.04), (0.7, 0.1)], sides, tip=1.0)


def _turned(
    profile: list[tuple[float, float]], sides: int, *, pole: float | None = None, tip: float | None = None
) -> Mesh:
    """Return the solid of (y, radius) turned about y; its ends are flat unless their middles are moved outwards."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    circle = np.stack([np.sin(angle), np.zeros(sides), np.cos(angle)], axis=1)
    heights = np.array(profile)
    rings = heights[:, 1][:, None, None] * circle + heights[:, 0][:, None, None] * np.array([0.0, 1.0, 0.0])
    mesh = rings_mesh(rings)
    if pole is not None:
        mesh.vertices[-2:, 1] = -pole, pole
    if tip is not None:
        mesh.vertices[-1, 1] = tip
    return mesh
