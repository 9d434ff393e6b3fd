"""Meshes of the world for pictures, in plain NumPy: planes, pipes and heightfields."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer.arrays import frozen
from worm3d.viewer.tube import tube

Colour = tuple[float, float, float]

GROUND: Colour = (0.80, 0.82, 0.78)
TILE: Colour = (0.70, 0.73, 0.68)
PIPE: Colour = (0.62, 0.72, 0.80)
BAND: Colour = (0.36, 0.48, 0.60)


@dataclass(frozen=True, eq=False)
class WorldMesh:
    """A triangle mesh of something the worm crawls on or in; frozen, validated, with read-only arrays.

    Attributes
    ----------
    name : str
    vertices : ndarray, shape (V, 3)
        [m].
    faces : ndarray, shape (F, 3)
        Rows of `vertices`.
    colour : tuple of float
        Red, green, blue, each in [0, 1].
    opacity : float
        In [0, 1]; 1 hides what is behind.

    Raises
    ------
    ValueError
        An array of the wrong shape, a value that is not finite, a face that names a vertex that does not exist.
    """

    name: str
    vertices: FloatArray
    faces: NDArray[np.int64]
    colour: Colour = GROUND
    opacity: float = 1.0

    def __post_init__(self) -> None:
        what = f"world mesh {self.name!r}"
        vertices = frozen(f"{what}: vertices", self.vertices, ("V", 3), {})
        faces = np.array(self.faces)
        if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
            raise ValueError(
                f"{what}: faces: got {faces.dtype} of shape {faces.shape}, must be integers of shape (F, 3)"
            )
        if faces.size and not 0 <= faces.min() <= faces.max() < len(vertices):
            raise ValueError(
                f"{what}: faces: got vertices {faces.min()} to {faces.max()}, must be in [0, {len(vertices) - 1}]"
            )
        fractions = np.array([*self.colour, self.opacity], dtype=float)
        if fractions.shape != (4,) or not np.all((fractions >= 0.0) & (fractions <= 1.0)):
            raise ValueError(
                f"{what}: got colour {self.colour!r} and opacity {self.opacity!r}, "
                "must be (red, green, blue) and a number, each in [0, 1]"
            )
        faces = faces.astype(np.int64)
        faces.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)


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
    """Return a rectangle of a plane as a chequerboard, so that one sees the worm move: its light and its dark tiles.

    Parameters
    ----------
    centre, normal : ndarray, shape (3,)
        A point of the plane [m] and its normal.
    length, width : float
        Along the first side of the rectangle, and across [m]; rounded up to whole tiles.
    tile : float
        Side of a tile [m].
    along : ndarray, shape (3,), optional
        Direction of the first side; +x if left out (+y where the normal is x).
    """
    rows, columns = (max(int(np.ceil(side / tile - 1e-9)), 1) for side in (length, width))
    i, j = (index.ravel() for index in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    corners = np.stack(
        [np.stack([i + a - rows / 2, j + b - columns / 2], axis=-1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))],
        axis=1,
    )
    vertices = np.asarray(centre) + tile * corners @ _sides(np.asarray(normal, dtype=float), along)
    dark = (i + j) % 2 == 1
    return _tiles("ground", vertices[~dark], GROUND, opacity), _tiles("tiles", vertices[dark], TILE, opacity)


def _sides(normal: FloatArray, along: FloatArray | None) -> FloatArray:
    n = normal / np.linalg.norm(normal)
    first = np.array([1.0, 0.0, 0.0]) if along is None else np.asarray(along, dtype=float)
    first = first - (first @ n) * n
    if np.linalg.norm(first) < 1e-6:
        first = np.array([0.0, 1.0, 0.0]) - n[1] * n
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(n, first)])


def _tiles(name: str, corners: FloatArray, colour: Colour, opacity: float) -> WorldMesh:
    first = 4 * np.arange(len(corners))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return WorldMesh(name, corners.reshape(-1, 3), faces, colour, opacity)


def pipe(
    centreline: FloatArray, radius: float | FloatArray, *, sides: int = 32, colour: Colour = PIPE, opacity: float = 0.25
) -> WorldMesh:
    """Return the wall of a pipe along a centre line.

    Parameters
    ----------
    centreline : ndarray, shape (P, 3)
        [m].
    radius : float or ndarray, shape (P,)
        [m].
    """
    mesh = tube(np.asarray(centreline, dtype=float), radius, sides=sides, capped=False)
    return WorldMesh("pipe", mesh.vertices, mesh.faces, colour, opacity)


def banded_pipe(
    centreline: FloatArray, radius: float | FloatArray, *, band: float, sides: int = 32, opacity: float = 0.3
) -> tuple[WorldMesh, WorldMesh]:
    """Return the wall of a pipe in light and dark bands, so that one sees the worm move and the pipe bend.

    Parameters
    ----------
    centreline : ndarray, shape (P, 3)
        [m]; its points should be closer together than the bands are wide.
    radius : float or ndarray, shape (P,)
        [m].
    band : float
        Width of a band [m].
    """
    line = np.asarray(centreline, dtype=float)
    whole = pipe(line, radius, sides=sides, opacity=opacity)
    edges = np.linalg.norm(np.diff(line, axis=0), axis=1)
    middle = np.cumsum(edges) - 0.5 * edges
    dark = np.repeat(np.floor(middle / band) % 2 == 1, 2 * sides)
    return _split(whole, dark, BAND)


def chequered(mesh: WorldMesh, tile: float, *, together: int = 1) -> tuple[WorldMesh, WorldMesh]:
    """Return a mesh in light and dark squares, seen from above, as its faces allow.

    Parameters
    ----------
    mesh : WorldMesh
    tile : float
        Side of a square [m].
    together : int
        How many successive faces stay together: 2 where they are the halves of quadrilaterals.
    """
    x, y, _ = mesh.vertices[mesh.faces].mean(axis=1).reshape(-1, together, 3).mean(axis=1).T
    dark = (np.floor(x / tile) + np.floor(y / tile)) % 2 == 1
    return _split(mesh, np.repeat(dark, together), TILE)


def _split(mesh: WorldMesh, dark: NDArray[np.bool_], colour: Colour) -> tuple[WorldMesh, WorldMesh]:
    """Return the light and the dark faces of a mesh, each shaded as if they were one."""
    return replace(mesh, faces=mesh.faces[~dark]), replace(
        mesh, name=f"{mesh.name}, dark", faces=mesh.faces[dark], colour=colour
    )


def mesh(
    vertices: FloatArray, faces: NDArray[np.int64], *, colour: Colour = GROUND, opacity: float = 1.0, most: int = 50_000
) -> WorldMesh:
    """Return triangles as they are, or, of more than `most`, about as many: near vertices become one, their mean.

    Parameters
    ----------
    vertices : ndarray, shape (V, 3)
        [m].
    faces : ndarray, shape (F, 3)
        Rows of `vertices`.
    """
    vertices, faces = np.asarray(vertices, dtype=float), np.asarray(faces)
    cell = float(np.ptp(vertices, axis=0).max()) / np.sqrt(max(most, 1))
    thinned = vertices, faces
    while len(thinned[1]) > most:
        thinned = _clustered(vertices, faces, cell)
        cell *= 1.25
    return WorldMesh("mesh", *thinned, colour, opacity)


def _clustered(vertices: FloatArray, faces: NDArray[np.int64], cell: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return a mesh in which the vertices in each cubic cell are one, without the faces that have lost their area."""
    places = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
    _, cluster, count = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    means = np.zeros((len(count), 3))
    np.add.at(means, cluster.ravel(), vertices)
    joined = cluster.ravel()[faces]
    a, b, c = joined.T
    kept = joined[(a != b) & (b != c) & (c != a)]
    turned = np.take_along_axis(kept, (kept.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)  # each face once
    return means / count[:, None], np.unique(turned, axis=0).astype(np.int64)


def heightfield(
    x: FloatArray, y: FloatArray, z: FloatArray, *, colour: Colour = GROUND, opacity: float = 1.0
) -> WorldMesh:
    """Return the surface z(x, y) over a grid.

    Parameters
    ----------
    x, y : ndarray, shape (A,), (B,)
        [m].
    z : ndarray, shape (A, B)
        [m].
    """
    grid_x, grid_y = np.meshgrid(x, y, indexing="ij")
    if np.shape(z) != grid_x.shape:
        raise ValueError(f"heightfield: z: got shape {np.shape(z)}, must be {grid_x.shape}, as x and y are long")
    vertices = np.stack([grid_x, grid_y, z], axis=-1).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(grid_x.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    halves = [np.stack(corners, axis=-1) for corners in ((a, b, c), (a, c, d))]
    faces = np.stack(halves, axis=-2).reshape(-1, 3)  # halves of a square follow each other
    return WorldMesh("heightfield", vertices, faces, colour, opacity)
