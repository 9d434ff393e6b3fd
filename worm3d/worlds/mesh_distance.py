"""Signed distances of a triangle mesh on a regular grid, computed once.

The distance of a node near the surface is its exact distance from the nearest triangle. The distance of any other node
is measured to the triangle of the nearest such node. This triangle is the nearest, or almost the nearest, triangle.
A node lies inside the mesh if its winding number is positive. The winding number is found by counting the triangles
that a row of the grid crosses before the node (Bridson's scan conversion). If a row hits an edge or a corner exactly,
the crossing counts once, because the same rule decides ties for all triangles. The spline through the nodes is then
fitted to exact distances between the nodes (`worm3d.worlds.sampled.fit`).
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from worm3d.machine.compiled import inner, njit
from worm3d.values.arrays import FloatArray, IntArray
from worm3d.worlds.sampled import FITTED, Grid, fit, node_counts

Vector = tuple[float, float, float]

GRID_MARGIN_CELLS = 6
"""Number of cells between the mesh and the edge of its grid."""


def filled(vertices: FloatArray, faces: IntArray, cell: float) -> Grid:
    """Return the grid of a closed mesh whose faces are oriented outwards. `cell` is the spacing of the grid [m]."""
    import scipy  # slow to import, and rarely needed

    size = node_counts(np.ptp(vertices, axis=0), cell, GRID_MARGIN_CELLS)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    first = middle - cell * (np.array(size) - 1.0) / 2.0
    corners = np.ascontiguousarray((vertices[faces] - first) / cell)
    coefficients = scipy.ndimage.spline_filter(_everywhere(corners, size), order=3)
    fit(coefficients, [(shift, *_close(corners - shift, size)) for shift in product((0.0, 0.5), repeat=3)])
    return Grid(coefficients.astype(np.float32), first, cell)


def _everywhere(corners: FloatArray, size: tuple[int, int, int]) -> FloatArray:
    """Return the signed distance of all nodes, exact within three cells of a triangle."""
    import scipy  # slow to import, and rarely needed

    distance, nearest, sign = _within(corners, 3.0, size)
    unknown = nearest < 0
    owner = scipy.ndimage.distance_transform_edt(unknown, return_distances=False, return_indices=True)
    places = np.flatnonzero(unknown)
    _far(corners, places, nearest[tuple(axis.ravel()[places] for axis in owner)], distance)
    return np.asarray(sign * np.sqrt(distance))


def _close(corners: FloatArray, size: tuple[int, int, int]) -> tuple[IntArray, FloatArray]:
    """Return the nodes where the spline is fitted, shape (M, 3), and their signed distances, shape (M,)."""
    distance, nearest, sign = _within(corners, FITTED, size)
    nodes = np.argwhere(nearest >= 0)
    at = tuple(nodes.T)
    return nodes, sign[at] * np.sqrt(distance[at])


def _within(
    corners: FloatArray, reach: float, size: tuple[int, int, int]
) -> tuple[FloatArray, NDArray[np.int32], FloatArray]:
    """Return, for each node, squared distance and number of the nearest triangle, and the sign of the distance.

    If no triangle is within `reach`, the squared distance is infinite and the number is -1.
    """
    distance, nearest, winding = np.full(size, np.inf), np.full(size, -1, np.int32), np.zeros(size, np.int32)
    _near(corners, reach, distance, nearest)
    _crossings(corners, winding)
    return distance, nearest, np.where(np.cumsum(winding, axis=0, dtype=np.int32) > 0, -1.0, 1.0)


@njit
def _near(corners: FloatArray, reach: float, distance: FloatArray, nearest: NDArray[np.int32]) -> None:
    """Write the squared distance and the number of the nearest triangle for all nodes within `reach` of a triangle.

    Triangles with an edge longer than 8 cells are divided, because the box around a larger triangle might contain most
    of the grid.
    """
    pieces = np.empty((256, 3, 3))
    for k in range(len(corners)):
        pieces[0], count = corners[k], 1
        while count > 0:
            count -= 1
            edge, longest = _longest_edge(pieces, count)
            if longest > 8.0**2 and count + 2 <= len(pieces):
                pieces[count + 1] = pieces[count]
                for d in range(3):
                    middle = 0.5 * (pieces[count, edge, d] + pieces[count, (edge + 1) % 3, d])
                    pieces[count, edge, d] = pieces[count + 1, (edge + 1) % 3, d] = middle
                count += 2
            else:
                _near_one(pieces, count, k, reach, distance, nearest)


@inner
def _longest_edge(pieces: FloatArray, i: int) -> tuple[int, float]:
    """Return the corner where the longest edge of a piece begins, and the square of its length."""
    edge, longest = 0, 0.0
    for e in range(3):
        side = _minus(_corner(pieces, i, e), _corner(pieces, i, (e + 1) % 3))
        length = _dot(side, side)
        if length > longest:
            edge, longest = e, length
    return edge, longest


@inner
def _span(corners: FloatArray, k: int, d: int, reach: float, nodes: int) -> tuple[int, int]:
    """Return the first node along axis d within `reach` of triangle k, and the node after the last such node."""
    low = min(corners[k, 0, d], corners[k, 1, d], corners[k, 2, d]) - reach
    high = max(corners[k, 0, d], corners[k, 1, d], corners[k, 2, d]) + reach
    return max(0, int(np.ceil(low))), min(nodes - 1, int(np.floor(high))) + 1


@inner
def _near_one(
    pieces: FloatArray, i: int, k: int, reach: float, distance: FloatArray, nearest: NDArray[np.int32]
) -> None:
    """Write the squared distances to piece i of triangle k at the nodes where they are the smallest so far."""
    nodes = distance.shape
    a, b, c = _corner(pieces, i, 0), _corner(pieces, i, 1), _corner(pieces, i, 2)
    (x_0, x_1), (y_0, y_1) = _span(pieces, i, 0, reach, nodes[0]), _span(pieces, i, 1, reach, nodes[1])
    z_0, z_1 = _span(pieces, i, 2, reach, nodes[2])
    for x in range(x_0, x_1):
        for y in range(y_0, y_1):
            for z in range(z_0, z_1):
                square = _to_triangle((float(x), float(y), float(z)), a, b, c)
                if square <= reach**2 and square < distance[x, y, z]:
                    distance[x, y, z] = square
                    nearest[x, y, z] = k


@njit
def _far(corners: FloatArray, places: IntArray, nearest: NDArray[np.int32], distance: FloatArray) -> None:
    """Write the squared distances of the nodes `places` to the triangles `nearest`."""
    rows, columns = distance.shape[1], distance.shape[2]
    for n in range(len(places)):
        x, rest = divmod(places[n], rows * columns)
        y, z = divmod(rest, columns)
        k = nearest[n]
        a, b, c = _corner(corners, k, 0), _corner(corners, k, 1), _corner(corners, k, 2)
        distance[x, y, z] = _to_triangle((float(x), float(y), float(z)), a, b, c)


@inner
def _corner(corners: FloatArray, k: int, e: int) -> Vector:
    return corners[k, e, 0], corners[k, e, 1], corners[k, e, 2]


@inner
def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner
def _to_segment(p: Vector, a: Vector, edge: Vector) -> float:
    """Return the squared distance of a point to a segment."""
    away, length = _minus(p, a), _dot(edge, edge)
    t = min(1.0, max(0.0, _dot(away, edge) / length)) if length > 0.0 else 0.0
    left = away[0] - t * edge[0], away[1] - t * edge[1], away[2] - t * edge[2]
    return _dot(left, left)


@inner
def _to_triangle(p: Vector, a: Vector, b: Vector, c: Vector) -> float:
    """Return the squared distance of a point to a triangle.

    It is the distance to the plane of the triangle if the point projects into the triangle, and otherwise the distance
    to the nearest edge.
    """
    ab, bc, ca = _minus(b, a), _minus(c, b), _minus(a, c)
    n = _cross(ab, bc)
    area = _dot(n, n)
    if area > 0.0 and _left(p, a, ab, n) and _left(p, b, bc, n) and _left(p, c, ca, n):
        return _dot(_minus(p, a), n) ** 2 / area
    return min(_to_segment(p, a, ab), _to_segment(p, b, bc), _to_segment(p, c, ca))


@inner
def _left(p: Vector, a: Vector, edge: Vector, n: Vector) -> bool:
    """Return whether a point lies on the triangle's side of an edge."""
    return _dot(_cross(edge, _minus(p, a)), n) >= 0.0


@inner
def _orientation(x_1: float, y_1: float, x_2: float, y_2: float) -> tuple[int, float]:
    """Return the sense of rotation from the first to the second point about the origin, and twice the triangle's area.

    If the points and the origin lie on a line, the order of the coordinates decides the sense.
    """
    area = y_1 * x_2 - x_1 * y_2
    tie = y_2 - y_1 if y_2 != y_1 else x_1 - x_2
    return int(np.sign(area if area != 0.0 else tie)), area


@njit
def _crossings(corners: FloatArray, winding: NDArray[np.int32]) -> None:
    """Add the crossings of the rows of nodes along x with the triangles, each at the next node.

    A crossing counts +1 where the row enters the solid, and -1 where the row leaves the solid.
    """
    for k in range(len(corners)):
        y_0, y_1 = _span(corners, k, 1, 0.0, winding.shape[1])
        z_0, z_1 = _span(corners, k, 2, 0.0, winding.shape[2])
        for y in range(y_0, y_1):
            for z in range(z_0, z_1):
                sign, x = _crossing(corners, k, float(y), float(z))
                node = max(0, int(np.ceil(x)))
                if sign != 0 and node < winding.shape[0]:
                    winding[node, y, z] += sign


@inner
def _crossing(corners: FloatArray, k: int, y: float, z: float) -> tuple[int, float]:
    """Return +1 or -1 and x if the row along x at (y, z) enters or leaves through triangle k, otherwise 0 and 0."""
    y_0, y_1, y_2 = corners[k, 0, 1] - y, corners[k, 1, 1] - y, corners[k, 2, 1] - y
    z_0, z_1, z_2 = corners[k, 0, 2] - z, corners[k, 1, 2] - z, corners[k, 2, 2] - z
    side_0, a = _orientation(y_1, z_1, y_2, z_2)
    side_1, b = _orientation(y_2, z_2, y_0, z_0)
    side_2, c = _orientation(y_0, z_0, y_1, z_1)
    total = a + b + c
    if side_0 == 0 or side_1 != side_0 or side_2 != side_0 or total == 0.0:
        return 0, 0.0
    return side_0, (a * corners[k, 0, 0] + b * corners[k, 1, 0] + c * corners[k, 2, 0]) / total
