"""What worlds from mesh files look like: their own triangles, where they are not too many."""

from __future__ import annotations

import numpy as np

from worm3d.viewer.world import GROUND, PIPE, WorldMesh, chequered
from worm3d.worlds.base import World
from worm3d.worlds.mesh import Mesh
from worm3d.worlds.scenery.base import MARGIN, Scenery, Window, scenery, tile_size

MOST_FACES = 40_000
"""Of a mesh that is drawn as it is; another is drawn from its distance."""


@scenery.register
def _mesh(world: Mesh, window: Window) -> Scenery:
    vertices, faces = world.triangles()
    margin = MARGIN * window.body_length
    low, high = window.points.min(axis=0) - margin, window.points.max(axis=0) + margin
    corners = vertices[faces]
    near = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
    if near.sum() > MOST_FACES:
        return scenery.dispatch(World)(world, window)
    used, numbers = np.unique(faces[near], return_inverse=True)
    faces = numbers.reshape(-1, 3)
    if world.solid == "outside":
        return Scenery((WorldMesh("tunnel", vertices[used], faces, PIPE, 0.35),))
    terrain = WorldMesh("mesh", vertices[used], faces, GROUND)
    return Scenery(chequered(terrain, tile_size(window.body_length, (high - low)[:2])))
