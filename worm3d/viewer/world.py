"""Meshes of the world for pictures: planes, pipes, heightfields, and surfaces where a function is zero.

The function of such a surface is given on a grid ("naive surface nets", Gibson 1998). The mesh has a vertex in each
grid cell that the surface crosses. The vertex is the mean of the points where the surface crosses the edges of
the cell. If the sign of the function changes along an edge of the grid, the vertices of the four cells around this edge
form a quadrilateral of the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import read_only
from worm3d.viewer.shapes import Mesh, tube

Colour = tuple[float, float, float]

GROUND: Colour = (0.80, 0.82, 0.78)
TILE: Colour = (0.70, 0.73, 0.68)
PIPE: Colour = (0.62, 0.72, 0.80)
PIPE_BAND: Colour = (0.36, 0.48, 0.60)

_CORNERS = np.array(list(product((0, 1), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a, 8) if np.abs(_CORNERS[b] - _CORNERS[a]).sum() == 1]


@dataclass(frozen=True, eq=False)
class WorldMesh:
    """A triangle mesh of a part of the world; frozen, with read-only arrays.

    Raises
    ------
    ValueError
        The vertices have the wrong shape, or a coordinate is not finite.
    """

    name: str
    vertices: FloatArray
    """Vertices, shape (V, 3) [m]."""
    faces: NDArray[np.int64]
    """Triangles as rows of `vertices`, shape (F, 3)."""
    colour: Colour = GROUND
    """Red, green, blue, each in [0, 1]."""
    opacity: float = 1.0
    """Opacity from 0 to 1. A mesh with 1 hides everything behind it."""

    def __post_init__(self) -> None:
        vertices = arguments.array(f"world mesh {self.name!r}: vertices", self.vertices, ("V", 3), least=0)
        object.__setattr__(self, "vertices", vertices)
        faces = np.array(self.faces, dtype=np.int64).reshape(-1, 3)
        if faces.size and not (faces.min() >= 0 and faces.max() < len(vertices)):
            raise ValueError(f"world mesh {self.name!r}: faces: must be rows of the {len(vertices)} vertices")
        object.__setattr__(self, "faces", read_only(faces))


def plane(
    centre: FloatArray,
    normal: FloatArray,
    *,
    length: float,
    width: float,
    tile: float,
    along: FloatArray | None = None,
    opacity: float = 1.0,
) -> tuple[WorldMesh, WorldMesh]:
    """Return a rectangle of a plane as a chequerboard, which makes the worm's motion visible.

    The light and the dark tiles are separate meshes.

    Parameters
    ----------
    centre, normal : ndarray, shape (3,)
        Centre of the rectangle [m], and its normal.
    length, width : float
        Lengths of the first and the second side of the rectangle [m], rounded up to whole tiles.
    tile : float
        Side of a tile [m].
    along : ndarray, shape (3,), optional
        Direction of the first side. The default is +x, or +y if the normal is x.
    """
    rows, columns = (max(int(np.ceil(side / tile - 1e-9)), 1) for side in (length, width))
    x, y = (np.arange(count + 1, dtype=float) - count / 2 for count in (rows, columns))
    flat = heightfield(x, y, np.zeros((rows + 1, columns + 1)), opacity=opacity)
    sides = _sides(np.asarray(normal, dtype=float), along)
    mesh = replace(flat, name="ground", vertices=np.asarray(centre) + tile * flat.vertices[:, :2] @ sides)
    dark = np.indices((rows, columns)).sum(axis=0) % 2 == 1
    ground, tiles = _split(mesh, np.repeat(dark, 2), TILE)
    return ground, replace(tiles, name="tiles")


def _sides(normal: FloatArray, along: FloatArray | None) -> FloatArray:
    n = normal / np.linalg.norm(normal)
    first = np.array([1.0, 0.0, 0.0]) if along is None else np.asarray(along, dtype=float)
    first = first - (first @ n) * n
    if np.linalg.norm(first) < 1e-6:
        first = np.array([0.0, 1.0, 0.0]) - n[1] * n
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(n, first)])


def pipe(centreline: FloatArray, radius: float | FloatArray, *, sides: int = 32, opacity: float = 0.25) -> WorldMesh:
    """Return the wall of a pipe along a centre line of shape (P, 3) [m].

    `radius` is a single radius, or has a radius for each point, shape (P,) [m].
    """
    mesh = tube(np.asarray(centreline, dtype=float), radius, sides=sides, capped=False)
    return WorldMesh("pipe", mesh.vertices, mesh.faces, PIPE, opacity)


def banded_pipe(
    centreline: FloatArray, radius: float | FloatArray, *, band: float, sides: int = 32, opacity: float = 0.3
) -> tuple[WorldMesh, WorldMesh]:
    """Return the wall of a `pipe` in light and dark bands, which show the worm's motion and the pipe's bends.

    `band` is the width of a band [m].
    The points of the centre line should be closer together than the bands are wide.
    """
    line = np.asarray(centreline, dtype=float)
    whole = pipe(line, radius, sides=sides, opacity=opacity)
    edges = np.linalg.norm(np.diff(line, axis=0), axis=1)
    middle = np.cumsum(edges) - 0.5 * edges
    dark = np.repeat(np.floor(middle / band) % 2 == 1, 2 * sides)
    return _split(whole, dark, PIPE_BAND)


def chequered(mesh: WorldMesh, tile: float, *, together: int = 1) -> tuple[WorldMesh, WorldMesh]:
    """Divide a mesh into light and dark squares, seen from above, with sides of about `tile` [m].

    Faces are not cut. `together` is the number of successive faces that get the same colour, for example 2 for the
    halves of quadrilaterals.
    """
    x, y, _ = mesh.vertices[mesh.faces].mean(axis=1).reshape(-1, together, 3).mean(axis=1).T
    dark = (np.floor(x / tile) + np.floor(y / tile)) % 2 == 1
    return _split(mesh, np.repeat(dark, together), TILE)


def _split(mesh: WorldMesh, dark: NDArray[np.bool_], colour: Colour) -> tuple[WorldMesh, WorldMesh]:
    """Return the light and the dark faces of a mesh as two meshes with the same vertices."""
    return replace(mesh, faces=mesh.faces[~dark]), replace(
        mesh, name=f"{mesh.name}, dark", faces=mesh.faces[dark], colour=colour
    )


def heightfield(x: FloatArray, y: FloatArray, z: FloatArray, *, opacity: float = 1.0) -> WorldMesh:
    """Return the surface with heights z of shape (A, B) over a grid with x of shape (A,) and y of shape (B,) [m]."""
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    if np.shape(z) != grid_x.shape:
        raise ValueError(f"heightfield: z: got shape {np.shape(z)}, must be {grid_x.shape}, as x and y are long")
    vertices = np.stack([grid_x, grid_y, z], axis=-1).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(grid_x.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    halves = [np.stack(corners, axis=-1) for corners in ((a, b, c), (a, c, d))]
    faces = np.stack(halves, axis=-2).reshape(-1, 3)  # the two halves of a square are successive faces
    return WorldMesh("heightfield", vertices, faces, GROUND, opacity)


def isosurface(values: FloatArray, origin: FloatArray, spacing: float) -> Mesh:
    """Return the surface where a function is zero, oriented towards positive values. The mesh may be empty.

    `values` are the values of the function on a grid, shape (A, B, C), with at least 2 nodes along each axis. `origin`
    is the position of the first node [m].
    """
    cells, places = _crossed_cells(values)
    number = np.full(np.array(values.shape) - 1, -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    faces = [_across(values, number, axis) for axis in range(3)]
    return Mesh(np.asarray(origin) + spacing * places, np.concatenate(faces))


def _crossed_cells(values: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the indices of the cells with a part of the surface, and the position of the vertex in each, in cells.

    Both results have the shape (V, 3).
    """
    inside = np.array(values.shape) - 1
    corners = np.stack([values[tuple(slice(o, o + n) for o, n in zip(c, inside, strict=True))] for c in _CORNERS])
    solid = (corners < 0.0).sum(axis=0)
    cells = np.argwhere((solid > 0) & (solid < 8))
    at = corners[:, *cells.T]
    total, count = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for a, b in _EDGES:
        crossed = (at[a] < 0.0) != (at[b] < 0.0)
        share = at[a][crossed] / (at[a] - at[b])[crossed]
        total[crossed] += _CORNERS[a] + share[:, None] * (_CORNERS[b] - _CORNERS[a])
        count[crossed] += 1.0
    return cells, cells + total / count[:, None]


def _across(values: FloatArray, number: NDArray[np.int64], axis: int) -> NDArray[np.int64]:
    """Return the triangles around the grid edges with a change of sign, for the edges along an axis, shape (F, 3)."""
    value, cell = np.moveaxis(values, axis, 0), np.moveaxis(number, axis, 0)
    solid = value < 0.0
    changes = solid[1:] != solid[:-1]
    changes[:, [0, -1], :] = False  # an edge on the border of the grid has fewer than four cells
    changes[:, :, [0, -1]] = False
    k, i, j = np.nonzero(changes)
    quads = np.stack([cell[k, i + a, j + b] for a, b in ((-1, -1), (0, -1), (0, 0), (-1, 0))], axis=1)
    # The other two axes are in cyclic order for x and z, and in the opposite order for y.
    turned = ~solid[k, i, j] if axis != 1 else solid[k, i, j]
    quads[turned] = quads[turned][:, ::-1]
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
