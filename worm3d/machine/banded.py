"""Banded linear systems in compiled code: root-free Cholesky factors, and LU factors by blocks without pivoting.

A matrix of size n with the half bandwidth B is stored by rows. Entry (i, j) is at [i, B + j - i] of an array of shape
(n + B, BAND_COLUMNS), whose other entries are zero. Because of the spare columns, and of the B rows after the last row,
every inner loop has the same length and becomes a few vector instructions. The cost is linear in n.

LU factors are for the unsymmetric matrices of Newton's method. Coordinates come in blocks of five. Each block is
coupled with the next 8 coordinates only. Entries of the matrix outside these groups of 13 coordinates must be zero.
Elimination of a block therefore changes only the next 8 coordinates. With A after elimination of the earlier blocks,

    [A11 A12]   A11 (5, 5)   H = A11^-1 A12
    [A21 A22]   A22 (8, 8)   G = A21 A11^-1   A22 - A21 H remains for the next block

Rows of 8 numbers stay in registers. The solution of a system is arranged in such a way that few operations of a block
wait for the previous block. In the forward pass, y denotes the five numbers of a block of the right-hand side, and G y
is subtracted from the next 8 numbers. In the backward pass, the numbers of the block become A11^-1 y - H x, where x are
the next 8 numbers of the solution.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from llvmlite import ir

from worm3d.machine.compiled import njit
from worm3d.machine.later import utils
from worm3d.machine.vectors import BLOCK_SIZE, subtract_16
from worm3d.machine.writer import DOUBLE, LANES, Writer, on_addresses
from worm3d.values.arrays import FloatArray

B = 12
"""Half bandwidth: each group of coupled coordinates has 13 coordinates."""
BAND_COLUMNS = 40
"""Number of columns: 2 B + 1, and spare columns that vector instructions read, rounded up to a multiple of 8."""
SMALLEST_PIVOT = 1e-14
"""Smallest pivot of a positive definite matrix, as a fraction of the diagonal entry."""
_SHARED = LANES - BLOCK_SIZE
"""Number of coordinates of the block after the next that are among the 8 coordinates after a block."""
_ROOM = BLOCK_SIZE * BAND_COLUMNS
"""Numbers that a block takes in the array of the factors."""
_INVERSE, _H, _G, _CORNER, _Y = (LANES * k for k in (0, 5, 10, 15, 23))
"""Offset of each part of a block's factors: 5 rows of A11^-1 with the first columns of H; 5 rows of H; 5 columns of G;
the corner, which is the first 8 rows and columns of A; and the right-hand side of the block."""


@njit
def cholesky_solve(band: FloatArray, x: FloatArray) -> bool:
    """Solve A x = b in place for a symmetric A. x contains b first; only the upper triangle of A is used.

    Parameters
    ----------
    band : ndarray, shape (n + B, BAND_COLUMNS)
        The matrix A. It is overwritten by L D L^T. Columns from 2 B + 1 on must be zero.
    x : ndarray, shape (n,)
        The right-hand side b, which is overwritten by the solution.

    Returns
    -------
    bool
        Whether A is positive definite; otherwise x has no meaning.
    """
    n, start = len(x), band.ctypes.data + 8 * B
    for j in range(n):
        band[j, 0] = band[j, B]  # entries below the diagonal are not read
    for j in range(n):
        last, pivot = min(B, n - 1 - j), band[j, B]
        if not pivot > SMALLEST_PIVOT * band[j, 0]:
            return False
        inverse = 1.0 / pivot
        for m in range(1, last + 1):
            factor = band[j, B + m] * inverse
            if factor != 0.0:
                x[j + m] -= factor * x[j]
                subtract_16(start + 8 * BAND_COLUMNS * (j + m), start + 8 * (BAND_COLUMNS * j + m), factor)
    for j in range(n - 1, -1, -1):
        total = x[j]
        for m in range(1, min(B, n - 1 - j) + 1):
            total -= band[j, B + m] * x[j + m]
        x[j] = total / band[j, B]
    return True


def _of_matrix(row: int, column: int) -> int:
    """Return the offset in memory of entry (row, column) relative to entry (0, 0), which is on the diagonal."""
    return row * (BAND_COLUMNS - 1) + column


def _inverse(w: Writer, pivot: Any, diagonal: Any) -> Any:
    """Return 1/pivot, or zero if the pivot is negligible compared with the diagonal entry."""
    least = w.builder.fmul(w.size(diagonal), ir.Constant(DOUBLE, SMALLEST_PIVOT))
    one, zero = (ir.Constant(DOUBLE, value) for value in (1.0, 0.0))
    return w.select(w.compare("ole", w.size(pivot), least), zero, w.div(one, pivot))  # a NaN does not count as vanished


def _eliminated(w: Writer, factors: Any, band: Any, between: Callable[[int], None]) -> tuple[list[Any], list[Any]]:
    """Return the rows of A11^-1 with the first columns of H, and the rows of H, by Gauss-Jordan elimination.

    The instructions that `between` writes after each pivot run while the elimination waits for the next pivot.
    """
    near = [w.load(factors, _CORNER + LANES * r) for r in range(BLOCK_SIZE)]
    far = [w.load(band, _of_matrix(r, LANES)) for r in range(BLOCK_SIZE)]
    pivot = w.lane(near[0], 0)
    for k in range(BLOCK_SIZE):
        inverse = _inverse(w, pivot, w.number(band, _of_matrix(k, k)))
        if k + 1 < BLOCK_SIZE:  # before the rows, since the next inverse takes longest
            product = w.mul(w.lane(near[k + 1], k), w.lane(near[k], k + 1))
            pivot = w.less(w.lane(near[k + 1], k + 1), product, inverse)
        own = [w.mul(w.spread_number(inverse), row) for row in (w.exchanged(near[k], w.splat(1.0), k), far[k])]
        for r in range(BLOCK_SIZE):
            if r != k:
                factor = w.spread(near[r], k)
                near[r] = w.less(w.exchanged(near[r], w.splat(0.0), k), factor, own[0])
                far[r] = w.less(far[r], factor, own[1])
        near[k], far[k] = own
        between(k)
    return near, [w.lanes(x, y, list(range(BLOCK_SIZE, BLOCK_SIZE + LANES))) for x, y in zip(near, far, strict=True)]


def _below(w: Writer, factors: Any, band: Any, r: int) -> list[Any]:
    """Return the numbers of row r of A21; the first three rows are in the corner."""
    if r < _SHARED:
        return [w.spread_number(w.number(factors, _CORNER + LANES * (BLOCK_SIZE + r) + j)) for j in range(BLOCK_SIZE)]
    return [w.spread_number(w.number(band, _of_matrix(BLOCK_SIZE + r, j))) for j in range(BLOCK_SIZE)]


def _behind(w: Writer, factors: Any, band: Any, r: int) -> Any:
    """Return row r of A22; three numbers of each of the first three rows are in the corner."""
    row = w.load(band, _of_matrix(BLOCK_SIZE + r, BLOCK_SIZE))
    if r >= _SHARED:
        return row
    return w.lanes(w.load(factors, _CORNER + LANES * (BLOCK_SIZE + r)), row, [5, 6, 7, 11, 12, 13, 14, 15])


def _write_corner(w: Writer, factors: Any, band: Any, h: list[Any]) -> None:
    """Write the corner of the next block."""
    for r in range(LANES):
        row = w.less_sum(_behind(w, factors, band, r), _below(w, factors, band, r), h)
        w.store(row, factors, _ROOM + _CORNER + LANES * r)


@on_addresses()
def _begin(w: Writer, factors: Any, band: Any) -> None:
    """Copy the corner of the first block from the matrix."""
    for r in range(LANES):
        w.store(w.load(band, _of_matrix(r, 0)), factors, _CORNER + LANES * r)


@on_addresses()
def _eliminate(w: Writer, factors: Any, band: Any, before: Any, band_before: Any) -> None:
    """Write A11^-1 and H of a block, the corner of the next block, and G of the previous block at the same time."""
    places = [(before, _CORNER + LANES * (BLOCK_SIZE + r)) for r in range(_SHARED)]
    places += [(band_before, _of_matrix(BLOCK_SIZE + r, 0)) for r in range(_SHARED, LANES)]
    below = w.transposed([w.load(*place) for place in places])[:BLOCK_SIZE]

    def between(k: int) -> None:
        inverse = [w.spread_number(w.number(before, _INVERSE + LANES * r + k)) for r in range(BLOCK_SIZE)]
        w.store(w.sum(inverse, below), before, _G + LANES * k)

    near, h = _eliminated(w, factors, band, between)
    _write_corner(w, factors, band, h)
    for r in range(BLOCK_SIZE):
        w.store(near[r], factors, _INVERSE + LANES * r)
        w.store(h[r], factors, _H + LANES * r)


@on_addresses()
def _forwards(w: Writer, factors: Any, x: Any, n: Any) -> None:
    """Compute y of each block of a right-hand side in the forward pass."""
    place = utils.alloca_once_value(w.builder, w.load_some(x, n))
    with _blocks(w.builder, n) as block:
        here, y = w.shifted(factors, block, _ROOM), w.builder.load(place)
        done = w.builder.mul(w.builder.add(block, w.count(1)), w.count(BLOCK_SIZE))
        w.store(y, here, _Y)
        ahead = w.load_some(w.shifted(x, done), w.builder.sub(n, done))
        ahead = w.lanes(y, ahead, [5, 6, 7, 11, 12, 13, 14, 15])
        g = [w.load(here, _G + LANES * j) for j in range(BLOCK_SIZE)]
        w.builder.store(w.less_sum(ahead, [w.spread(y, j) for j in range(BLOCK_SIZE)], g), place)


@on_addresses()
def _backwards(w: Writer, factors: Any, x: Any, n: Any) -> None:
    """Compute the solution in the backward pass, from the last block to the first."""
    place = utils.alloca_once_value(w.builder, w.splat(0.0))
    with _blocks(w.builder, n, backwards=True) as block:
        here, done = w.shifted(factors, block, _ROOM), w.builder.mul(block, w.count(BLOCK_SIZE))
        y = w.lanes(w.load(here, _Y), w.splat(0.0), [0, 1, 2, 3, 4, 13, 14, 15])
        behind = w.builder.load(place)
        own = [w.mul(w.load(here, _INVERSE + LANES * r), y) for r in range(BLOCK_SIZE)]
        found = _totals(w, [w.less(own[r], w.load(here, _H + LANES * r), behind) for r in range(BLOCK_SIZE)], behind)
        w.builder.store(found, place)
        w.store_some(found, w.shifted(x, done), w.builder.sub(n, done))


_ODD = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]
_HALVES = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
_QUARTERS = [0, 1, 4, 5, 8, 9, 12, 13], [2, 3, 6, 7, 10, 11, 14, 15]
"""Lanes of two vectors, in two lists; the lanes of the first list are added to the lanes of the second list."""


def _totals(w: Writer, rows: list[Any], rest: Any) -> Any:
    """Return a vector with the sums over the lanes of five vectors, and then the first three lanes of `rest`."""
    a, b, c = (_folded(w, x, y, _ODD) for x, y in ((rows[0], rows[1]), (rows[2], rows[3]), (rows[4], rows[4])))
    low = w.lanes(c, w.lanes(rest, w.splat(0.0), [8, 0, 8, 8, 1, 2, 8, 8]), [0, 9, 2, 11, 12, 13, 14, 15])
    c = w.add(low, w.lanes(c, w.splat(0.0), [4, 8, 6, 8, 8, 8, 8, 8]))
    return _folded(w, _folded(w, a, b, _HALVES), c, _QUARTERS)


def _folded(w: Writer, x: Any, y: Any, parts: tuple[list[int], list[int]]) -> Any:
    return w.add(*(w.lanes(x, y, part) for part in parts))


@contextmanager
def _blocks(builder: Any, n: Any, *, backwards: bool = False) -> Iterator[Any]:
    count = builder.sdiv(builder.add(n, ir.Constant(n.type, BLOCK_SIZE - 1)), ir.Constant(n.type, BLOCK_SIZE))
    with utils.for_range(builder, count) as loop:
        last = builder.sub(count, ir.Constant(n.type, 1))
        yield builder.sub(last, loop.index) if backwards else loop.index


@njit
def lu_factor(band: FloatArray, factors: FloatArray) -> None:
    """Factorise A by elimination without pivoting.

    The matrices of a step are nearly positive definite. In other cases, any loss of accuracy shows in the next residual
    of Newton's method. The solution is 0 for a coordinate without mass and stiffness, such as the roll of a body
    without apex masses.

    Parameters
    ----------
    band : ndarray, shape (n + B, BAND_COLUMNS)
        The matrix A.
    factors : ndarray, shape (n + B, BAND_COLUMNS)
        Overwritten by the factors, in an order of their own.
    """
    blocks = (len(band) - B + BLOCK_SIZE - 1) // BLOCK_SIZE
    to, source = factors.ctypes.data, band.ctypes.data + 8 * B
    room, rows = 8 * _ROOM, 8 * BLOCK_SIZE * BAND_COLUMNS
    _begin(to, source)
    for k in range(blocks):
        before = max(k - 1, 0)  # with k = 0, G of the first block is meaningless; k = 1 overwrites it
        _eliminate(to + k * room, source + k * rows, to + before * room, source + before * rows)


@njit
def lu_solve(factors: FloatArray, x: FloatArray) -> None:
    """Solve A x = b in place with the factors of `lu_factor`. x contains b first.

    Parameters
    ----------
    factors : ndarray, shape (n + B, BAND_COLUMNS)
        The factors, with room for working memory that is overwritten.
    x : ndarray, shape (n,)
        The right-hand side b, which is overwritten by the solution.
    """
    _forwards(factors.ctypes.data, x.ctypes.data, len(x))
    _backwards(factors.ctypes.data, x.ctypes.data, len(x))
