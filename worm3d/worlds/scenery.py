"""Meshes of the part of a world around the worm, for pictures.

Each function under `@scenery.register` draws a kind of world. A world without such a function is drawn from its signed
distance. Plane, terrain, mesh and pipe are drawn up to a body length beyond the worm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer.pieces import rounded_up
from worm3d.viewer.world import GROUND, PIPE, Colour, WorldMesh, banded_pipe, chequered, heightfield, isosurface, plane
from worm3d.worlds.base import World
from worm3d.worlds.heightfield import Heightfield
from worm3d.worlds.mesh import Mesh
from worm3d.worlds.pipe import Pipe
from worm3d.worlds.plane import ClampedGround, Plane
from worm3d.worlds.union import Union

TILE = 0.1
"""Approximate side of the square tiles of the ground, in body lengths. The side is rounded up to 1, 2 or 5 times a
power of ten [m]."""

FINEST = 0.02
"""Smallest spacing of the grid from which a signed distance is drawn, in body lengths."""

MOST_FACES = 40_000
"""Largest number of faces of a mesh that is drawn directly. A larger mesh is drawn from its signed distance."""

SLIPPERY_PATCH: Colour = (0.62, 0.78, 0.92)
"""Colour of patches with less friction than the rest."""

ROUGH_PATCH: Colour = (0.72, 0.60, 0.45)
"""Colour of patches with more friction than the rest."""

PIPE_SIDES = 40
"""Number of corners of the polygons that approximate the circular sections of a pipe."""


@dataclass(frozen=True, eq=False)
class Window:
    """The places that a worm visits, which set the part of the world to draw."""

    points: FloatArray
    """Apexes and joints at all instants, shape (K, 3) [m]."""

    body_length: float
    """Length of the body [m]."""


@dataclass(frozen=True, eq=False)
class Scenery:
    """The drawn surroundings of a worm."""

    meshes: tuple[WorldMesh, ...] = ()
    centreline: FloatArray | None = None
    """Path of the camera inside a pipe, shape (P, 3) [m]."""


@singledispatch
def scenery(world: World | None, window: Window) -> Scenery:
    """Return the scenery of a world around the worm."""
    if world is None:
        return Scenery()
    low, high = _limits(window.points, 0.3 * window.body_length)
    tile = tile_size(window.body_length, (high - low)[:2])
    finest = max(FINEST * window.body_length, float(np.prod(high - low) / 200_000) ** (1.0 / 3.0))  # most cells
    # The corners of a level surface lie in the middle of cells. With this grid they lie on the edges of tiles.
    spacing = tile / max(np.floor(tile / finest), 1.0)
    low = tile * np.floor(low / tile) - 0.5 * spacing
    sides = [np.arange(a, b + spacing, spacing) for a, b in zip(low, high, strict=True)]
    distance = world.distance(np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1))
    mesh = isosurface(distance, low, spacing)
    if not len(mesh.faces):
        return Scenery()
    if (distance[:, :, -1] < 0.0).any():  # the surface would hide the worm from above
        return Scenery((WorldMesh("wall", mesh.vertices, mesh.faces, PIPE, 0.35),))
    terrain = WorldMesh("terrain", mesh.vertices, mesh.faces, GROUND)
    return Scenery(chequered(terrain, tile, together=2))


def _limits(places: FloatArray, margin: float) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest coordinates of places, with a margin [m]."""
    return places.min(axis=0) - margin, places.max(axis=0) + margin


def tile_size(body_length: float, sides: FloatArray) -> float:
    """Return the side of the tiles of a rectangular ground, for which there are at most 3000 tiles [m].

    `sides` are the length and width of the ground, shape (2,) [m].
    """
    return rounded_up(max(TILE * body_length, float(np.sqrt(sides.prod() / 3000))))


@scenery.register
def _clamped(world: ClampedGround, window: Window) -> Scenery:
    """Return the transparent level plane through the joints. The lower half of the worm lies below this plane."""
    return Scenery(_floor(Plane(), window, 0.35))


@scenery.register
def _plane(world: Plane, window: Window) -> Scenery:
    return Scenery((*_floor(world, window, 1.0), *_patches(world, window)))


def _floor(world: Plane, window: Window, opacity: float) -> tuple[WorldMesh, ...]:
    """Return the tiles of a plane. Four tiles meet at the origin, so that their positions do not depend on the worm."""
    low, high = _extent(world, window)
    tile = tile_size(window.body_length, high - low)
    low, high = 2.0 * tile * np.floor(low / (2.0 * tile)), 2.0 * tile * np.ceil(high / (2.0 * tile))
    ascent, left, normal = world.axes
    middle, (length, width) = 0.5 * (low + high), map(float, high - low)
    centre = middle[0] * ascent + middle[1] * left
    return plane(centre, normal, length=length, width=width, tile=tile, along=ascent, opacity=opacity)


def _extent(world: Plane, window: Window) -> tuple[FloatArray, FloatArray]:
    """Return the limits of the drawn part of a plane, along the ascent and to the left, each of shape (2,) [m]."""
    return _limits(window.points @ world.axes[:2].T, window.body_length)


def _patches(world: Plane, window: Window) -> list[WorldMesh]:
    """Return patches as coloured sheets just above the ground, later patches above earlier patches."""
    (x, y), (x_end, y_end) = _extent(world, window)
    sheets = []
    for number, patch in enumerate(world.patches):
        x_0, x_1 = max(x, patch.along[0]), min(x_end, patch.along[1])
        y_0, y_1 = max(y, patch.across[0]), min(y_end, patch.across[1])
        if x_0 < x_1 and y_0 < y_1:
            z = 1e-3 * (number + 1) * window.body_length
            corners = np.array([[x_0, y_0, z], [x_1, y_0, z], [x_1, y_1, z], [x_0, y_1, z]]) @ world.axes
            faces, colour = np.array([[0, 1, 2], [0, 2, 3]]), SLIPPERY_PATCH if patch.grip < 1.0 else ROUGH_PATCH
            sheets.append(WorldMesh(f"friction x {patch.grip:g}", corners, faces, colour, 0.7))
    return sheets


@scenery.register
def _heightfield(world: Heightfield, window: Window) -> Scenery:
    low, high = _limits(window.points[:, :2], window.body_length)
    tile = tile_size(window.body_length, high - low)
    low, high = tile * np.floor(low / tile), tile * np.ceil(high / tile)
    parts = int(np.ceil(tile / max(min(FINEST * window.body_length, world.spacing), 0.1 * tile)))
    x, y = (np.linspace(a, b, round((b - a) / tile) * parts + 1) for a, b in zip(low, high, strict=True))
    height = world.height(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
    return Scenery(chequered(heightfield(x, y, height), tile, together=2))


@scenery.register
def _mesh(world: Mesh, window: Window) -> Scenery:
    vertices, faces = world.triangles()
    low, high = _limits(window.points, window.body_length)
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


@scenery.register
def _pipe(world: Pipe, window: Window) -> Scenery:
    some = window.points[:: max(len(window.points) // 300, 1)]  # enough to find the stretch
    begin, end = map(float, _limits(world.along(some), window.body_length))
    begin = max(begin, 0.0) if world.start_wall else begin
    end = min(end, world.centreline.total) if world.end_wall else end
    band = rounded_up(TILE * window.body_length)
    count = 5 * max(int(np.ceil((end - begin) / band)), 1) + 1  # rings of corners
    # The positions of the bands do not depend on the worm.
    s = np.linspace(band * np.floor(begin / band) if not world.start_wall else begin, end, count)
    points, radius = world.centreline.at(s)[0], world.radius_at(s)
    walls = [(k, s[k]) for k, closed in ((0, world.start_wall), (-1, world.end_wall)) if closed]
    caps = tuple(_cap(world, points[k], place, float(radius[k])) for k, place in walls)
    return Scenery((*banded_pipe(points, radius, band=band, sides=PIPE_SIDES, opacity=0.3), *caps), points)


def _cap(world: Pipe, middle: FloatArray, place: float, radius: float) -> WorldMesh:
    """Return the flat wall that closes the pipe at a place along the centre line."""
    _, tangent = world.centreline.at(place)
    across = np.linalg.svd(tangent[None])[2][1:]
    angle = 2.0 * np.pi * np.arange(PIPE_SIDES) / PIPE_SIDES
    rim = middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across
    corner = np.arange(PIPE_SIDES)
    faces = np.stack([np.full(PIPE_SIDES, PIPE_SIDES), corner, (corner + 1) % PIPE_SIDES], axis=1)
    return WorldMesh("end of the pipe", np.vstack([rim, middle]), faces, PIPE, 0.3)


@scenery.register
def _union(world: Union, window: Window) -> Scenery:
    parts = [scenery(each, window) for each in world.worlds]
    meshes = []
    for k, part in enumerate(parts):
        others = [other for j, other in enumerate(world.worlds) if j != k]
        cut = (_cut(mesh, others, 0.008 * window.body_length) for mesh in part.meshes)
        meshes += [mesh for mesh in cut if len(mesh.faces)]
    lines = [part.centreline for part in parts if part.centreline is not None]
    return Scenery(tuple(meshes), lines[0] if lines else None)


def _cut(mesh: WorldMesh, others: list[World], fine: float) -> WorldMesh:
    """Return a mesh of a world of a union without the parts that lie in the free space of the other worlds.

    Triangles next to an edge where worlds meet are divided until their sides are at most `fine` [m], so that the edge
    looks clean. The mesh becomes transparent, so that a pipe below the ground can be seen.
    """
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
    return replace(mesh, vertices=vertices, faces=faces[~free], opacity=min(mesh.opacity, 0.5))


def _quartered(
    vertices: FloatArray, faces: NDArray[np.int64], which: NDArray[np.bool_]
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Divide the selected triangles into four at the midpoints of their sides; return all vertices and faces."""
    a, b, c = faces[which].T
    corners = vertices[faces[which]]
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))  # of ab, bc, ca
    ab, bc, ca = (len(vertices) + 3 * np.arange(len(a)) + k for k in range(3))
    four = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return np.concatenate([vertices, middles.reshape(-1, 3)]), np.concatenate([faces[~which], four])


def on_ground(world: World | None, places: FloatArray, body_length: float, above: float = 0.0) -> FloatArray:
    """Return places moved vertically to a height `above` [m] over the ground, so that lines on the ground are visible.

    A place without ground within a body length above or below it is not moved. Places and results have the shape
    (..., 3) [m].

    Each step moves a place down by its distance from the world, and therefore never beyond the nearest surface ("sphere
    tracing", Hart 1996, The Visual Computer 12, 527). A place below the ground moves up. On a plane of 60 degrees a
    step covers half of the remaining height, and on a plane of 80 degrees a sixth.
    """
    result = np.array(places, dtype=float).reshape(-1, 3)
    moving, searched = result.copy(), np.arange(len(result))
    for _ in range(80):
        if world is None or not len(searched):
            break
        distance = world.distance(moving[searched])
        far = np.abs(distance) > 1e-6 * body_length
        moving[searched[far], 2] -= distance[far]
        near = np.abs(moving[searched, 2] - result[searched, 2]) <= body_length
        found = searched[~far & near]
        result[found] = moving[found] + [0.0, 0.0, above]
        searched = searched[far & near]
    return result.reshape(np.shape(places))
