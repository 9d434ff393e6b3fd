"""LU factors of the matrices of Newton's steps, in compiled code, block by block without pivoting.

A matrix stands as in `worm3d.banded`. The coordinates come in blocks of `BLOCK`; what couples them are groups of 13 that
begin with a block: an entry outside all of these must be zero. When a block is eliminated, 8 coordinates behind it
are concerned: with A the matrix as the blocks before have left it,

    [A11 A12]   A11 (5, 5), of the block         H = A11^-1 A12
    [A21 A22]   A22 (8, 8), of what it changes   G = A21 A11^-1      A22 - A21 H is what it leaves

so that rows of 8 numbers stay in registers, and in a solution a block waits for the one before it by a few operations:
forwards its 8 numbers lose G times those of the block, backwards the block is A11^-1 y - H x.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from worm3d import vectors
from worm3d.banded import SMALLEST_PIVOT, WIDTH, B
from worm3d.compiled import njit

FloatArray = NDArray[np.float64]

BLOCK = 5
"""Coordinates of a block."""
_LANES = 8
"""Doubles in a vector instruction; LLVM splits it where the processor has shorter ones."""
_ROOM = BLOCK * WIDTH
"""Numbers that a block has in the array of the factors."""
_INVERSE, _H, _G, _CORNER, _Y = (_LANES * k for k in (0, 5, 10, 15, 23))
"""Where they begin: 5 rows of A11^-1 and the first columns of H; 5 rows of H; 5 columns of G; the first 8 rows and
columns of A, as the blocks before have left it; y of the solution, which goes on with that of the next block."""
_ALIGN = ir.Constant(ir.IntType(32), 8)
_INT, _DOUBLE = ir.IntType(64), ir.DoubleType()
_KIND = ir.VectorType(_DOUBLE, _LANES)
_NUMBERS = ir.VectorType(_INT, _LANES)
_ZERO, _ONE = (ir.Constant(_KIND, [value] * _LANES) for value in (0.0, 1.0))
_SHARED = _LANES - BLOCK
"""Coordinates that a block concerns in the second block behind it."""


_ODD = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]
_HALVES = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]
_QUARTERS = [0, 1, 4, 5, 8, 9, 12, 13], [2, 3, 6, 7, 10, 11, 14, 15]
"""Lanes of two vectors that are added to each other, to sum them up."""


def _of_matrix(row: int, column: int) -> int:
    """Return where an entry stands, counted from one on the diagonal."""
    return row * (WIDTH - 1) + column


class _Writer:
    """Writes code on vectors of 8 doubles; places are addresses and doubles from there."""

    def __init__(self, builder: Any) -> None:
        self.builder = builder

    def place(self, address: Any, shift: int, kind: Any = _KIND) -> Any:
        return self.builder.inttoptr(self.builder.add(address, ir.Constant(_INT, 8 * shift)), kind.as_pointer())

    def load(self, address: Any, shift: int) -> Any:
        return self.builder.load(self.place(address, shift), align=8)

    def load_some(self, address: Any, count: Any) -> Any:
        """Return the first numbers, at most so many, and zeros."""
        return self._masked("load", _KIND, [self.place(address, 0), _ALIGN, self._first(count), _ZERO])

    def store_some(self, value: Any, address: Any, count: Any) -> None:
        """Store the first numbers, at most so many."""
        self._masked("store", ir.VoidType(), [value, self.place(address, 0), _ALIGN, self._first(count)])

    def _first(self, count: Any) -> Any:
        counts = self.spread_number(count, _NUMBERS)
        return self.builder.icmp_signed("<", ir.Constant(_NUMBERS, list(range(_LANES))), counts)

    def _masked(self, what: str, to: Any, args: list[Any]) -> Any:
        insert: Any = cgutils.get_or_insert_function
        kind = ir.FunctionType(to, [arg.type for arg in args])
        return self.builder.call(insert(self.builder.module, kind, f"llvm.masked.{what}.v{_LANES}f64.p0"), args)

    def store(self, value: Any, address: Any, shift: int) -> None:
        self.builder.store(value, self.place(address, shift), align=8)

    def lanes(self, x: Any, y: Any, lanes: list[int]) -> Any:
        """Return a vector of these lanes of two, of which the second one's count from 8 on."""
        return self.builder.shuffle_vector(x, y, ir.Constant(ir.VectorType(ir.IntType(32), _LANES), lanes))

    def exchanged(self, x: Any, y: Any, lane: int) -> Any:
        """Return x with one lane of y."""
        return self.lanes(x, y, [k + _LANES if k == lane else k for k in range(_LANES)])

    def totals(self, rows: list[Any], rest: Any) -> Any:
        """Return the sums of the lanes of five vectors, and the first three lanes of another one."""
        a, b, c = (self._folded(x, y, _ODD) for x, y in ((rows[0], rows[1]), (rows[2], rows[3]), (rows[4], rows[4])))
        low = self.lanes(c, self.lanes(rest, _ZERO, [8, 0, 8, 8, 1, 2, 8, 8]), [0, 9, 2, 11, 12, 13, 14, 15])
        c = self.builder.fadd(low, self.lanes(c, _ZERO, [4, 8, 6, 8, 8, 8, 8, 8]))
        return self._folded(self._folded(a, b, _HALVES), c, _QUARTERS)

    def _folded(self, x: Any, y: Any, parts: tuple[list[int], list[int]]) -> Any:
        """Return the sum of two choices of lanes."""
        return self.builder.fadd(*(self.lanes(x, y, part) for part in parts))

    def spread(self, x: Any, lane: int) -> Any:
        return self.lanes(x, x, [lane] * _LANES)

    def spread_number(self, number: Any, kind: Any = _KIND) -> Any:
        one = self.builder.insert_element(ir.Constant(kind, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
        return self.spread(one, 0)

    def number(self, address: Any, shift: int) -> Any:
        return self.builder.load(self.place(address, shift, _DOUBLE), align=8)

    def lane(self, x: Any, lane: int) -> Any:
        return self.builder.extract_element(x, ir.Constant(ir.IntType(32), lane))

    def plus(self, value: Any, x: Any, y: Any) -> Any:
        """Return value + x y."""
        return self._call("fma", [x, y, value])

    def less(self, value: Any, x: Any, y: Any) -> Any:
        """Return value - x y."""
        return self.plus(value, self.builder.fneg(x), y)

    def less_sum(self, value: Any, numbers: list[Any], vectors: list[Any]) -> Any:
        """Return value - the sum of five products, in two chains that do not wait for each other."""
        for x, y in zip(numbers[:2], vectors[:2], strict=True):
            value = self.less(value, x, y)
        return self.builder.fsub(value, self.sum(numbers[2:], vectors[2:]))

    def sum(self, numbers: list[Any], vectors: list[Any]) -> Any:
        """Return a sum of products."""
        value = self.builder.fmul(numbers[0], vectors[0])
        for x, y in zip(numbers[1:], vectors[1:], strict=True):
            value = self.plus(value, x, y)
        return value

    def inverse(self, pivot: Any, diagonal: Any) -> Any:
        """Return 1/pivot, zero where the pivot has vanished."""
        size, least = (self._call("fabs", [x]) for x in (pivot, diagonal))
        least = self.builder.fmul(least, ir.Constant(_DOUBLE, SMALLEST_PIVOT))
        vanished = self.builder.fcmp_ordered("<=", size, least)  # a NaN has not
        one, zero = (ir.Constant(_DOUBLE, value) for value in (1.0, 0.0))
        return self.builder.select(vanished, zero, self.builder.fdiv(one, pivot))

    def _call(self, name: str, args: list[Any]) -> Any:
        """Call one of LLVM's functions of numbers, or of vectors of them."""
        insert: Any = cgutils.get_or_insert_function
        kind = args[0].type
        size = f"v{_LANES}f64" if kind == _KIND else "f64"
        function = insert(self.builder.module, ir.FunctionType(kind, [kind] * len(args)), f"llvm.{name}.{size}")
        return self.builder.call(function, args)


def _eliminated(w: _Writer, factors: Any, band: Any, between: Callable[[int], None]) -> tuple[list[Any], list[Any]]:
    """Return the rows of A11^-1, with the first columns of H, and of H: Gauss and Jordan."""
    near = [w.load(factors, _CORNER + _LANES * r) for r in range(BLOCK)]
    far = [w.load(band, _of_matrix(r, _LANES)) for r in range(BLOCK)]
    pivot = w.lane(near[0], 0)
    for k in range(BLOCK):
        inverse = w.inverse(pivot, w.number(band, _of_matrix(k, k)))
        if k + 1 < BLOCK:  # ahead of the rows, for the next inverse takes longest
            product = w.builder.fmul(w.lane(near[k + 1], k), w.lane(near[k], k + 1))
            pivot = w.less(w.lane(near[k + 1], k + 1), product, inverse)
        own = [w.builder.fmul(w.spread_number(inverse), row) for row in (w.exchanged(near[k], _ONE, k), far[k])]
        for r in range(BLOCK):
            if r != k:
                factor = w.spread(near[r], k)
                near[r] = w.less(w.exchanged(near[r], _ZERO, k), factor, own[0])
                far[r] = w.less(far[r], factor, own[1])
        near[k], far[k] = own
        between(k)
    return near, [w.lanes(x, y, list(range(BLOCK, BLOCK + _LANES))) for x, y in zip(near, far, strict=True)]


def _below(w: _Writer, factors: Any, band: Any, r: int) -> list[Any]:
    """Return the numbers of a row of A21; the blocks before have changed the first three."""
    if r < _SHARED:
        return [w.spread_number(w.number(factors, _CORNER + _LANES * (BLOCK + r) + j)) for j in range(BLOCK)]
    return [w.spread_number(w.number(band, _of_matrix(BLOCK + r, j))) for j in range(BLOCK)]


def _behind(w: _Writer, factors: Any, band: Any, r: int) -> Any:
    """Return a row of A22; the blocks before have changed three numbers in the first three."""
    row = w.load(band, _of_matrix(BLOCK + r, BLOCK))
    if r >= _SHARED:
        return row
    return w.lanes(w.load(factors, _CORNER + _LANES * (BLOCK + r)), row, [5, 6, 7, 11, 12, 13, 14, 15])


def _write_corner(w: _Writer, factors: Any, band: Any, h: list[Any]) -> None:
    for r in range(_LANES):
        row = w.less_sum(_behind(w, factors, band, r), _below(w, factors, band, r), h)
        w.store(row, factors, _ROOM + _CORNER + _LANES * r)


def _intrinsic(write: Any) -> Any:
    """Return the intrinsic (factors, band) of two addresses, for which code is written so."""

    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        write(_Writer(builder), *args)
        return ir.Constant(_INT, 0)

    def typed(_context: Any, factors: Any, band: Any) -> Any:
        return types.int64(types.int64, types.int64), generate

    return intrinsic(typed)


@_intrinsic
def _begin(w: _Writer, factors: Any, band: Any) -> None:
    """Put down the corner of a block that others have not changed."""
    for r in range(_LANES):
        w.store(w.load(band, _of_matrix(r, 0)), factors, _CORNER + _LANES * r)


@_intrinsic
def _again(w: _Writer, factors: Any, band: Any) -> None:
    """Put down the corner that a block leaves for the next one, of factors that are there."""
    _write_corner(w, factors, band, [w.load(factors, _H + _LANES * r) for r in range(BLOCK)])


def _write_elimination(w: _Writer, factors: Any, band: Any, before: Any, band_before: Any) -> None:
    """Put down the factors of a block, and the corner that it leaves for the next one."""
    inverse = [w.load(before, _INVERSE + _LANES * r) for r in range(BLOCK)]
    rows: list[Any] = []

    def between(k: int) -> None:
        for r in range(*ROWS[k]):
            rows.append(w.sum(_below(w, before, band_before, r), inverse))
        if k == GK:
            g = vectors.transposed(w.builder, rows)
            for j in range(BLOCK):
                w.store(g[j], before, _G + _LANES * j)

    near, h = _eliminated(w, factors, band, between)
    _write_corner(w, factors, band, h)
    for r in range(BLOCK):
        w.store(near[r], factors, _INVERSE + _LANES * r)
        w.store(h[r], factors, _H + _LANES * r)

ROWS = [(0,2),(2,4),(4,6),(6,8),(8,8)]
GK=4

def _type_eliminate(_context: Any, factors: Any, band: Any, before: Any, band_before: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        _write_elimination(_Writer(builder), *args)
        return ir.Constant(_INT, 0)

    return types.int64(types.int64, types.int64, types.int64, types.int64), generate


_eliminate: Any = intrinsic(_type_eliminate)


def _type_forwards(_context: Any, factors: Any, x: Any, n: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        w, (factors, x, n) = _Writer(builder), args
        place = cgutils.alloca_once_value(builder, w.load_some(x, n))
        with _blocks(builder, n) as block:
            here = builder.add(factors, builder.mul(block, ir.Constant(_INT, 8 * _ROOM)))
            done = builder.mul(builder.add(block, ir.Constant(_INT, 1)), ir.Constant(_INT, BLOCK))
            y = builder.load(place)
            w.store(y, here, _Y)
            ahead = w.load_some(builder.add(x, builder.mul(done, ir.Constant(_INT, 8))), builder.sub(n, done))
            ahead = w.lanes(y, ahead, [5, 6, 7, 11, 12, 13, 14, 15])
            g = [w.load(here, _G + _LANES * j) for j in range(BLOCK)]
            builder.store(w.less_sum(ahead, [w.spread(y, j) for j in range(BLOCK)], g), place)
        return ir.Constant(_INT, 0)

    return types.int64(types.int64, types.int64, types.int64), generate


def _type_backwards(_context: Any, factors: Any, x: Any, n: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        w, (factors, x, n) = _Writer(builder), args
        place = cgutils.alloca_once_value(builder, _ZERO)
        with _blocks(builder, n, backwards=True) as block:
            here = builder.add(factors, builder.mul(block, ir.Constant(_INT, 8 * _ROOM)))
            done = builder.mul(block, ir.Constant(_INT, BLOCK))
            y, behind = w.lanes(w.load(here, _Y), _ZERO, [0, 1, 2, 3, 4, 13, 14, 15]), builder.load(place)
            own = [builder.fmul(w.load(here, _INVERSE + _LANES * r), y) for r in range(BLOCK)]
            rows = [w.less(own[r], w.load(here, _H + _LANES * r), behind) for r in range(BLOCK)]
            found = w.totals(rows, behind)
            builder.store(found, place)
            w.store_some(found, builder.add(x, builder.mul(done, ir.Constant(_INT, 8))), builder.sub(n, done))
        return ir.Constant(_INT, 0)

    return types.int64(types.int64, types.int64, types.int64), generate


@contextmanager
def _blocks(builder: Any, n: Any, *, backwards: bool = False) -> Iterator[Any]:
    """Write a loop over the blocks of n coordinates."""
    count = builder.sdiv(builder.add(n, ir.Constant(_INT, BLOCK - 1)), ir.Constant(_INT, BLOCK))
    with cgutils.for_range(builder, count) as loop:
        last = builder.sub(count, ir.Constant(_INT, 1))
        yield builder.sub(last, loop.index) if backwards else loop.index


_forwards: Any = intrinsic(_type_forwards)
_backwards: Any = intrinsic(_type_backwards)


@njit
def lu_factor(band: FloatArray, factors: FloatArray, start: int) -> None:
    """Factorise A by elimination without pivoting.

    The matrices of a step are close to positive definite ones; what is lost where they are not, Newton's next residual
    shows. A coordinate with neither mass nor stiffness left, such as the roll of a body without apex masses, stays.

    Parameters
    ----------
    band : ndarray, shape (n + B, WIDTH)
    factors : ndarray, shape (n + B, WIDTH)
        Overwritten by the factors, in an order of their own.
    start : int
        The first coordinate of a block: those of the blocks before it are there already; A is as it was then, but for
        rows and columns from here on.
    """
    blocks, first = (len(band) - B + BLOCK - 1) // BLOCK, start // BLOCK
    to, source = factors.ctypes.data, band.ctypes.data + 8 * B
    room, rows = 8 * _ROOM, 8 * BLOCK * WIDTH
    known = max(0, first - 2)
    _begin(to + known * room, source + known * rows)
    for k in range(known, first):
        _again(to + k * room, source + k * rows)
    for k in range(first, blocks):
        before = max(k - 1, first)
        _eliminate(to + k * room, source + k * rows, to + before * room, source + before * rows)


@njit
def lu_solve(factors: FloatArray, x: FloatArray) -> None:
    """Solve A x = b in place with the factors of `lu_factor`; x holds b.

    Parameters
    ----------
    factors : ndarray, shape (n + B, WIDTH)
        Working memory too.
    x : ndarray, shape (n,)
    """
    _forwards(factors.ctypes.data, x.ctypes.data, len(x))
    _backwards(factors.ctypes.data, x.ctypes.data, len(x))
