"""What planes look like: tiles, and patches with another friction."""

from __future__ import annotations

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.viewer.world import Colour, WorldMesh, plane
from worm3d.worlds.clamped import ClampedGround
from worm3d.worlds.plane import Patch, Plane
from worm3d.worlds.scenery.base import MARGIN, Scenery, Window, scenery, tile_size

SLIPPERY: Colour = (0.62, 0.78, 0.92)
ROUGH: Colour = (0.72, 0.60, 0.45)
"""Patches with less and with more friction than the rest."""


@scenery.register
def _clamped(world: ClampedGround, window: Window) -> Scenery:
    """Return the level on which the joints are held; the worm reaches below it."""
    return Scenery(_floor(Plane(), window, 0.35))


@scenery.register
def _plane(world: Plane, window: Window) -> Scenery:
    return Scenery((*_floor(world, window, 1.0), *_patches(world, window)))


def _floor(world: Plane, window: Window, opacity: float) -> tuple[WorldMesh, ...]:
    """Return tiles that lie where they are whatever the worm does: the origin is a corner of four."""
    low, high = _extent(world, window)
    tile = tile_size(window.body_length, high - low)
    low, high = 2.0 * tile * np.floor(low / (2.0 * tile)), 2.0 * tile * np.ceil(high / (2.0 * tile))
    ascent, left, normal = world.axes
    middle = 0.5 * (low + high)
    return plane(
        middle[0] * ascent + middle[1] * left,
        normal,
        length=float(high[0] - low[0]),
        width=float(high[1] - low[1]),
        tile=tile,
        along=ascent,
        opacity=opacity,
    )


def _extent(world: Plane, window: Window) -> tuple[FloatArray, FloatArray]:
    """Return from where to where a plane is drawn, along the ascent and to the left, each of shape (2,) [m]."""
    places = window.points @ world.axes[:2].T
    margin = MARGIN * window.body_length
    return places.min(axis=0) - margin, places.max(axis=0) + margin


def _patches(world: Plane, window: Window) -> tuple[WorldMesh, ...]:
    low, high = _extent(world, window)
    drawn = (_patch(k, patch, world, low, high, window) for k, patch in enumerate(world.patches))
    return tuple(mesh for mesh in drawn if mesh is not None)


def _patch(
    number: int, patch: Patch, world: Plane, low: FloatArray, high: FloatArray, window: Window
) -> WorldMesh | None:
    """Return a patch as a sheet on the ground, a later one above an earlier; None if it is out of sight."""
    begin = np.maximum(low, [patch.along[0], patch.across[0]])
    end = np.minimum(high, [patch.along[1], patch.across[1]])
    if not (begin < end).all():
        return None
    above = 1e-3 * (number + 1) * window.body_length
    corners = np.array([[x, y, above] for x, y in zip(*_around(begin, end), strict=True)])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return WorldMesh(
        f"friction x {patch.grip:g}", corners @ world.axes, faces, SLIPPERY if patch.grip < 1.0 else ROUGH, 0.7
    )


def _around(begin: FloatArray, end: FloatArray) -> tuple[list[float], list[float]]:
    return [begin[0], end[0], end[0], begin[0]], [begin[1], begin[1], end[1], end[1]]
