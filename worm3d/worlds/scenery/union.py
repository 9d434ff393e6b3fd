"""What unions look like: of each world what the others leave solid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from worm3d.viewer.world import WorldMesh
from worm3d.worlds.base import World
from worm3d.worlds.scenery.base import Scenery, Window, scenery
from worm3d.worlds.union import Union

FINE = 0.008
"""Triangles are cut to sides of at most so many body lengths, so that the edges where worlds meet look clean."""

OPACITY = 0.5
"""At most: what is inside one world may lie below another."""


@scenery.register
def _union(world: Union, window: Window) -> Scenery:
    parts = [scenery(each, window) for each in world.worlds]
    meshes = []
    for k, part in enumerate(parts):
        others = [other for j, other in enumerate(world.worlds) if j != k]
        cut = (_cut(mesh, others, FINE * window.body_length) for mesh in part.meshes)
        meshes += [mesh for mesh in cut if len(mesh.faces)]
    lines = [part.centreline for part in parts if part.centreline is not None]
    return Scenery(tuple(meshes), lines[0] if lines else None)


def _cut(mesh: WorldMesh, others: list[World], fine: float) -> WorldMesh:
    """Return a mesh without what lies in the free space of other worlds."""
    vertices, faces = mesh.vertices, mesh.faces
    while len(faces) < 100_000:
        near = np.abs([other.distance(vertices[faces].mean(axis=1)) for other in others]).min(axis=0, initial=np.inf)
        side = np.linalg.norm(vertices[faces] - np.roll(vertices[faces], 1, axis=1), axis=2).max(axis=1)
        coarse = (side > fine) & (near < side)
        if not coarse.any():
            break
        vertices, faces = _quartered(vertices, faces, coarse)
    middle = vertices[faces].mean(axis=1)
    free = np.any([other.distance(middle) > 0.0 for other in others], axis=0) if others else np.zeros(len(faces), bool)
    return replace(mesh, vertices=vertices, faces=faces[~free], opacity=min(mesh.opacity, OPACITY))


def _quartered(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], which: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return triangles of which some are cut into four at the middles of their sides."""
    a, b, c = faces[which].T
    corners = vertices[faces[which]]
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))  # of ab, bc, ca
    ab, bc, ca = (len(vertices) + 3 * np.arange(len(a)) + k for k in range(3))
    four = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return np.concatenate([vertices, middles.reshape(-1, 3)]), np.concatenate([faces[~which], four])
