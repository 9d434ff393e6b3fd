"""The surface where a function on a grid is zero, as triangles: one corner in each cell that it passes through.

Each edge of the grid along which the sign changes is crossed by a quadrilateral between the corners of the four cells
around it ("naive surface nets", Gibson 1998); a corner is the mean of the places where its cell's edges are crossed.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer.tube import Mesh

_CORNERS = np.array(list(product((0, 1), repeat=3)))
_EDGES = [(a, b) for a in range(8) for b in range(a, 8) if np.abs(_CORNERS[b] - _CORNERS[a]).sum() == 1]


def isosurface(values: FloatArray, origin: FloatArray, spacing: float) -> Mesh:
    """Return the surface on which a function is zero, seen from where it is positive; empty if there is none.

    Parameters
    ----------
    values : ndarray, shape (A, B, C)
        The function on a grid, each size at least 2.
    origin : ndarray, shape (3,)
        Place of `values[0, 0, 0]` [m].
    spacing : float
        Of the grid [m].
    """
    cells, places = _crossed_cells(values)
    number = np.full(np.array(values.shape) - 1, -1)
    number[tuple(cells.T)] = np.arange(len(cells))
    faces = [_across(values, number, axis) for axis in range(3)]
    return Mesh(np.asarray(origin) + spacing * places, np.concatenate(faces))


def _crossed_cells(values: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the cells that the surface passes through, shape (V, 3), and the place of the corner in each."""
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
    """Return the triangles that cross the edges of the grid along one axis, shape (F, 3)."""
    value, cell = np.moveaxis(values, axis, 0), np.moveaxis(number, axis, 0)
    solid = value < 0.0
    changes = solid[1:] != solid[:-1]
    changes[:, [0, -1], :] = False  # an edge on the border has no four cells
    changes[:, :, [0, -1]] = False
    k, i, j = np.nonzero(changes)
    quads = np.stack([cell[k, i + a, j + b] for a, b in ((-1, -1), (0, -1), (0, 0), (-1, 0))], axis=1)
    # The other two axes follow in cyclic order for x and z, in the opposite order for y.
    turned = ~solid[k, i, j] if axis != 1 else solid[k, i, j]
    quads[turned] = quads[turned][:, ::-1]
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
