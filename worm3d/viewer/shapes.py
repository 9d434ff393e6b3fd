"""Meshes for the parts of the pictures: bars, discs, balls and arrows about the y axis, and tubes along lines."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray


class Mesh(NamedTuple):
    """A triangle mesh with vertices, shape (V, 3) [m], and faces, shape (F, 3).

    Faces are rows of `vertices`, anticlockwise seen from outside.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]


def capsule(length: float, radius: float, *, sides: int = 8) -> Mesh:
    """Return a bar along y, centred at the origin, with rounded ends that extend beyond `length` by less than a radius.

    Length and radius are in metres.
    """
    half, radius = 0.5 * round(length, 12), round(radius, 12)  # without rounding errors, equal bars share a mesh
    ends = ((half, radius), (half + 0.7 * radius, 0.6 * radius))
    return _turned((*((-y, r) for y, r in reversed(ends)), *ends), sides)


def disc(radius: float, thick: float, *, sides: int = 32) -> Mesh:
    """Return a disc normal to y, from y = 0 to y = `thick`, with a rounded edge at y = `thick` [m]."""
    return _turned(((0.0, radius), (0.5 * thick, radius), (thick, radius - 0.5 * thick)), sides)


def ball(*, rings: int = 17, sides: int = 28) -> Mesh:
    """Return a ball of radius 1."""
    angle = np.pi * (np.arange(rings) + 0.5) / rings
    return _turned(tuple(zip((-np.cos(angle)).tolist(), np.sin(angle).tolist(), strict=True)), sides, tips=(-1.0, 1.0))


def arrow(*, sides: int = 10) -> Mesh:
    """Return an arrow from the origin to y = 1, whose head has the radius 0.1."""
    return _turned(((0.0, 0.04), (0.7, 0.04), (0.7, 0.1)), sides, tips=(0.0, 1.0))


@lru_cache(256)
def _turned(profile: tuple[tuple[float, float], ...], sides: int, tips: tuple[float, float] | None = None) -> Mesh:
    """Return the solid of revolution about y with a profile of points (y, radius).

    The ends are flat. If `tips` is given, the middles of the ends are moved to these y.
    """
    angle = 2.0 * np.pi * np.arange(sides) / sides
    circle = np.stack([np.sin(angle), np.zeros(sides), np.cos(angle)], axis=1)
    heights = np.array(profile)
    rings = heights[:, 1][:, None, None] * circle + heights[:, 0][:, None, None] * np.array([0.0, 1.0, 0.0])
    mesh = rings_mesh(rings)
    if tips is not None:
        mesh.vertices[-2:, 1] = tips
    return mesh


def tube(points: FloatArray, radius: float | FloatArray, *, sides: int = 6, capped: bool = True) -> Mesh:
    """Return a tube around a polyline of at least two points, shape (P, 3) [m]. Neighbouring points may coincide.

    `radius` is a single radius, or has a radius for each point, shape (P,) [m]. `sides` is the number of corners of a
    section. If `capped` is True, the ends are closed.
    """
    tangents = _tangents(points)
    normals = _transported(tangents)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    across = np.cross(tangents, normals)
    circle = np.cos(angle)[:, None] * normals[:, None] + np.sin(angle)[:, None] * across[:, None]
    rings = points[:, None] + np.broadcast_to(radius, len(points))[:, None, None] * circle
    return rings_mesh(rings, capped=capped)


def rings_mesh(rings: FloatArray, *, capped: bool = True) -> Mesh:
    """Return the mesh between successive rings of vertices, shape (P, sides, 3).

    The vertices of a ring are anticlockwise about the direction to the next ring. The faces are in the order of the
    rings, with 2 * sides faces between two rings. The caps are the last faces.
    """
    count, sides = rings.shape[:2]
    faces = wall_faces(count, sides)
    vertices = rings.reshape(-1, 3)
    if capped:
        vertices = np.vstack([vertices, rings[0].mean(axis=0), rings[-1].mean(axis=0)])
        faces = np.vstack([faces, cap_faces(count, sides)])
    return Mesh(vertices, faces)


def wall_faces(count: int, sides: int) -> NDArray[np.int64]:
    """Return the triangles between `count` rings, shape (2 * sides * (count - 1), 3)."""
    corner = np.arange(sides)
    after = (corner + 1) % sides
    strip = np.stack([[corner, after, after + sides], [corner, after + sides, corner + sides]], axis=0)
    first = sides * np.arange(count - 1)
    return np.asarray(first[:, None, None] + strip.transpose(2, 0, 1).reshape(1, -1, 3)).reshape(-1, 3)


def cap_faces(count: int, sides: int) -> NDArray[np.int64]:
    """Return the triangles that close both ends. The two vertices after the rings are the middles of the ends."""
    corner = np.arange(sides)
    after = (corner + 1) % sides
    middle, last = count * sides, (count - 1) * sides
    start = np.stack([np.full(sides, middle), after, corner], axis=1)
    end = np.stack([np.full(sides, middle + 1), last + corner, last + after], axis=1)
    return np.vstack([start, end])


def _tangents(points: FloatArray) -> FloatArray:
    """Return unit tangents at the points, shape (P, 3). A repeated point has the tangent of the point before."""
    edges = np.gradient(points, axis=0)
    length = np.linalg.norm(edges, axis=1)
    moving = length > 1e-9 * max(float(np.ptp(points, axis=0).max()), 1e-300)
    if not moving.any():
        return np.tile([1.0, 0.0, 0.0], (len(points), 1))
    last = np.maximum.accumulate(np.where(moving, np.arange(len(points)), -1))
    last[last < 0] = np.argmax(moving)
    return np.asarray(edges[last] / length[last, None])


def _transported(tangents: FloatArray) -> FloatArray:
    """Return unit normals along a line, by parallel transport of the first normal, shape (P, 3)."""
    normals = np.empty_like(tangents)
    normal = np.eye(3)[np.argmin(np.abs(tangents[0]))]
    for k, tangent in enumerate(tangents):
        normal = normal - (normal @ tangent) * tangent
        size = np.linalg.norm(normal)
        if size < 1e-6:  # the line has a corner of 90 degrees
            normal = np.cross(tangent, np.eye(3)[np.argmin(np.abs(tangent))])
            size = np.linalg.norm(normal)
        normal = normal / size
        normals[k] = normal
    return normals
