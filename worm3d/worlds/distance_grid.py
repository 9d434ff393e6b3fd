"""Signed distances of a triangle mesh on a regular grid, computed once.

Near the surface each node has its exact distance to the triangles about it; the others have that to the triangle of
the nearest such node, which is the nearest one or almost. The sign is that of the winding number along rows of the
grid, counted by crossings (Bridson's scan conversion): edges and corners that a row hits exactly count once, because
orientations of equal points are broken by one rule for all triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, spline_filter

from worm3d.compiled import inner, njit

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
IntArray = NDArray[np.int64]
Vector = tuple[float, float, float]

NEAR = 3.0
"""Cells from a triangle within which nodes get their exact distance to it."""

MARGIN = 6
"""Cells between the mesh and the edge of its grid."""

PIECE = 8.0
"""Cells: triangles with longer edges are taken in parts, lest the box about one is the whole grid."""

MOST_NODES = 8_000_000
"""Of a grid: 32 MB to keep, ten times as much while it is filled."""

FAR = 1e30


@dataclass(frozen=True, eq=False)
class Grid:
    """A cubic spline of signed distances, negative inside.

    Attributes
    ----------
    coefficients : ndarray of float32, shape (A, B, C)
        Of the spline, in cells.
    first : ndarray, shape (3,)
        Place of the first node [m].
    cell : float
        Distance of nodes [m].
    """

    coefficients: SingleArray
    first: FloatArray
    cell: float


def shape(vertices: FloatArray, cell: float) -> tuple[int, int, int]:
    """Return the number of nodes that a mesh needs along each axis."""
    a, b, c = (int(np.ceil(side / cell)) + 2 * MARGIN + 1 for side in np.ptp(vertices, axis=0))
    return a, b, c


def filled(vertices: FloatArray, faces: IntArray, cell: float) -> Grid:
    """Return the grid of a closed mesh whose faces look outwards."""
    size = shape(vertices, cell)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    first = middle - cell * (np.array(size) - 1.0) / 2.0
    corners = np.ascontiguousarray((vertices[faces] - first) / cell)
    distance, nearest = np.full(size, FAR), np.full(size, -1, dtype=np.int32)
    winding = np.zeros(size, dtype=np.int32)
    _near(corners, distance, nearest)
    _crossings(corners, winding)
    unknown = nearest < 0
    owner = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    places = np.flatnonzero(unknown)
    _far(corners, places, nearest[tuple(axis.ravel()[places] for axis in owner)], distance)
    inside = np.cumsum(winding, axis=0) > 0
    signed = np.where(inside, -1.0, 1.0) * np.sqrt(distance)
    return Grid(spline_filter(signed, order=3).astype(np.float32), first, cell)


@njit
def _near(corners: FloatArray, distance: FloatArray, nearest: NDArray[np.int32]) -> None:
    """Write squared distances and triangles of the nodes near each triangle."""
    pieces = np.empty((256, 3, 3))
    for k in range(len(corners)):
        pieces[0] = corners[k]
        count = 1
        while count > 0:
            count -= 1
            piece = pieces[count].copy()
            edge, longest = 0, 0.0
            for e in range(3):
                length = _squared(piece[e], piece[(e + 1) % 3])
                if length > longest:
                    edge, longest = e, length
            if longest > PIECE**2 and count + 2 <= len(pieces):
                middle = 0.5 * (piece[edge] + piece[(edge + 1) % 3])
                pieces[count] = piece
                pieces[count, edge] = middle
                pieces[count + 1] = piece
                pieces[count + 1, (edge + 1) % 3] = middle
                count += 2
            else:
                _near_one(piece, k, distance, nearest)


@inner
def _near_one(piece: FloatArray, k: int, distance: FloatArray, nearest: NDArray[np.int32]) -> None:
    """Write squared distances to a piece of triangle k where they are the least so far."""
    low, high = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for d in range(3):
        low[d] = max(0, int(np.ceil(min(piece[0, d], piece[1, d], piece[2, d]) - NEAR)))
        high[d] = min(distance.shape[d] - 1, int(np.floor(max(piece[0, d], piece[1, d], piece[2, d]) + NEAR)))
    a, b, c = _vector(piece[0]), _vector(piece[1]), _vector(piece[2])
    for x in range(low[0], high[0] + 1):
        for y in range(low[1], high[1] + 1):
            for z in range(low[2], high[2] + 1):
                square = to_triangle((float(x), float(y), float(z)), a, b, c)
                if square <= NEAR**2 and square < distance[x, y, z]:
                    distance[x, y, z] = square
                    nearest[x, y, z] = k


@njit
def _far(corners: FloatArray, places: IntArray, nearest: NDArray[np.int32], distance: FloatArray) -> None:
    """Write the squared distances of other nodes to the triangles given."""
    rows, columns = distance.shape[1], distance.shape[2]
    for n in range(len(places)):
        x, rest = divmod(places[n], rows * columns)
        y, z = divmod(rest, columns)
        triangle = corners[nearest[n]]
        a, b, c = _vector(triangle[0]), _vector(triangle[1]), _vector(triangle[2])
        distance[x, y, z] = to_triangle((float(x), float(y), float(z)), a, b, c)


@inner
def _vector(row: FloatArray) -> Vector:
    return row[0], row[1], row[2]


@inner
def _squared(a: FloatArray, b: FloatArray) -> float:
    return float((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@inner
def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def _to_segment(p: Vector, a: Vector, edge: Vector) -> float:
    """Return the squared distance of a point to a segment."""
    away, length = _minus(p, a), _dot(edge, edge)
    t = min(1.0, max(0.0, _dot(away, edge) / length)) if length > 0.0 else 0.0
    left = away[0] - t * edge[0], away[1] - t * edge[1], away[2] - t * edge[2]
    return _dot(left, left)


@inner
def to_triangle(p: Vector, a: Vector, b: Vector, c: Vector) -> float:
    """Return the squared distance of a point to a triangle: to its plane over it, else to its nearest edge."""
    ab, bc, ca = _minus(b, a), _minus(c, b), _minus(a, c)
    n = ab[1] * bc[2] - ab[2] * bc[1], ab[2] * bc[0] - ab[0] * bc[2], ab[0] * bc[1] - ab[1] * bc[0]
    area = _dot(n, n)
    if area > 0.0 and _left(p, a, ab, n) and _left(p, b, bc, n) and _left(p, c, ca, n):
        return _dot(_minus(p, a), n) ** 2 / area
    return min(_to_segment(p, a, ab), _to_segment(p, b, bc), _to_segment(p, c, ca))


@inner
def _left(p: Vector, a: Vector, edge: Vector, n: Vector) -> bool:
    """Return whether a point lies on the triangle's side of an edge."""
    x, y, z = _minus(p, a)
    cross = edge[1] * z - edge[2] * y, edge[2] * x - edge[0] * z, edge[0] * y - edge[1] * x
    return _dot(cross, n) >= 0.0


@inner
def _orientation(x_1: float, y_1: float, x_2: float, y_2: float) -> tuple[int, float]:
    """Return the side on which the second point lies of the first, seen from 0, ties broken, and twice the area."""
    area = y_1 * x_2 - x_1 * y_2
    if area != 0.0:
        return (1 if area > 0.0 else -1), area
    if y_2 != y_1:
        return (1 if y_2 > y_1 else -1), area
    if x_1 != x_2:
        return (1 if x_1 > x_2 else -1), area
    return 0, area


@njit
def _crossings(corners: FloatArray, winding: NDArray[np.int32]) -> None:
    """Add, for each row of nodes along x, +1 where it enters the solid and -1 where it leaves, at the next node."""
    for k in range(len(corners)):
        t = corners[k]
        low_y, high_y = int(np.ceil(t[:, 1].min())), int(np.floor(t[:, 1].max()))
        low_z, high_z = int(np.ceil(t[:, 2].min())), int(np.floor(t[:, 2].max()))
        for y in range(max(0, low_y), min(winding.shape[1] - 1, high_y) + 1):
            for z in range(max(0, low_z), min(winding.shape[2] - 1, high_z) + 1):
                sign, x = _crossing(t, float(y), float(z))
                node = max(0, int(np.ceil(x)))
                if sign != 0 and node < winding.shape[0]:
                    winding[node, y, z] += sign


@inner
def _crossing(t: FloatArray, y: float, z: float) -> tuple[int, float]:
    """Return how a triangle is crossed by a row along x (0: it is not), and where."""
    y_0, y_1, y_2 = t[0, 1] - y, t[1, 1] - y, t[2, 1] - y
    z_0, z_1, z_2 = t[0, 2] - z, t[1, 2] - z, t[2, 2] - z
    side_0, a = _orientation(y_1, z_1, y_2, z_2)
    side_1, b = _orientation(y_2, z_2, y_0, z_0)
    side_2, c = _orientation(y_0, z_0, y_1, z_1)
    total = a + b + c
    if side_0 == 0 or side_1 != side_0 or side_2 != side_0 or total == 0.0:
        return 0, 0.0
    return side_0, (a * t[0, 0] + b * t[1, 0] + c * t[2, 0]) / total
