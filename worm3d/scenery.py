"""What worlds look like: the part of each that surrounds a worm, as meshes for pictures.

A further world is a further function under `@scenery.register`. A world without one is drawn from its signed distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from worm3d.viewer.isosurface import isosurface
from worm3d.viewer.pieces import rounded_up
from worm3d.viewer.world import GROUND, PIPE, Colour, WorldMesh, chequered, plane
from worm3d.worlds import ClampedGround, Patch, Plane, World

FloatArray = NDArray[np.float64]

MARGIN = 1.0
"""How far the world is drawn beyond the worm, in body lengths."""

TILE = 0.1
"""Side of a tile of the ground in body lengths, roughly: it is 1, 2 or 5 times a power of ten [m]."""

MOST_TILES = 3000

FINEST, MOST_CELLS = 0.02, 200_000
"""Spacing of the grid on which a distance is taken, in body lengths, and how many cells it has at most."""

SLIPPERY: Colour = (0.62, 0.78, 0.92)
ROUGH: Colour = (0.72, 0.60, 0.45)
"""Patches with less and with more friction than the rest."""


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


def tile_size(body_length: float, sides: FloatArray) -> float:
    """Return the side of a tile for a ground of these sides, shape (2,) [m]."""
    return rounded_up(max(TILE * body_length, float(np.sqrt(sides.prod() / MOST_TILES))))


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
