"""What surrounds a worm, and the dispatch on the world; an unknown one is drawn from its distance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.viewer.isosurface import isosurface
from worm3d.viewer.pieces import rounded_up
from worm3d.viewer.world import GROUND, PIPE, WorldMesh, chequered
from worm3d.worlds.base import World

MARGIN = 1.0
"""How far the world is drawn beyond the worm, in body lengths."""

TILE = 0.1
"""Side of a tile of the ground in body lengths, roughly: it is 1, 2 or 5 times a power of ten [m]."""

MOST_TILES = 3000

FINEST, MOST_CELLS = 0.02, 200_000
"""Spacing of the grid on which a distance is taken, in body lengths, and how many cells it has at most."""


@dataclass(frozen=True, eq=False)
class Window:
    """Where a worm has been.

    Attributes
    ----------
    points : ndarray, shape (K, 3)
        Its apexes and joints at all instants [m].
    body_length : float
        [m]
    """

    points: FloatArray
    body_length: float


@dataclass(frozen=True, eq=False)
class Scenery:
    """What surrounds the worm.

    Attributes
    ----------
    meshes : tuple of WorldMesh
    centreline : ndarray, shape (P, 3), optional
        Of a pipe: where the camera inside it moves [m].
    """

    meshes: tuple[WorldMesh, ...] = ()
    centreline: FloatArray | None = None


@singledispatch
def scenery(world: World | None, window: Window) -> Scenery:
    """Return what a world looks like around the worm.

    Parameters
    ----------
    world : World or None
    window : Window
    """
    if world is None:
        return Scenery()
    low, high = window.points.min(axis=0), window.points.max(axis=0)
    margin = 0.3 * MARGIN * window.body_length
    low, high = low - margin, high + margin
    tile = tile_size(window.body_length, (high - low)[:2])
    finest = max(FINEST * window.body_length, float(np.prod(high - low) / MOST_CELLS) ** (1.0 / 3.0))
    # The corners of a level surface lie in the middle of cells: these then meet at the edges of tiles.
    spacing = tile / max(np.floor(tile / finest), 1.0)
    low = tile * np.floor(low / tile) - 0.5 * spacing
    sides = [np.arange(a, b + spacing, spacing) for a, b in zip(low, high, strict=True)]
    distance = world.distance(np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1))
    mesh = isosurface(distance, low, spacing)
    if not len(mesh.faces):
        return Scenery()
    covers = bool((distance[:, :, -1] < 0.0).any())  # it would hide the worm from above
    if covers:
        return Scenery((WorldMesh("wall", mesh.vertices, mesh.faces, PIPE, 0.35),))
    terrain = WorldMesh("terrain", mesh.vertices, mesh.faces, GROUND)
    return Scenery(chequered(terrain, tile, together=2))


def tile_size(body_length: float, sides: FloatArray) -> float:
    """Return the side of a tile for a ground of these sides, shape (2,) [m]."""
    return rounded_up(max(TILE * body_length, float(np.sqrt(sides.prod() / MOST_TILES))))
