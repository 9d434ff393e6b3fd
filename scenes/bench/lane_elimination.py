"""Elimination of several banded systems at once, one in each lane: how fast a batch's linear solver could be.

Entry (i, j) of the matrix in lane w stands at [B + i, B + j - i, w]; the first B rows are zero. It is elimination
without pivoting, row by row: a row stays in registers until it is finished. Pivots are not looked at, and zeros within
the band, which `worm3d.machine.banded_lu` leaves out, are computed with.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from worm3d.machine.banded import B
from worm3d.values.arrays import FloatArray

Loop = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, bool, int], None]

COLUMNS = 2 * B + 1
_INT = ir.IntType(64)


def side_by_side(bands: Sequence[FloatArray]) -> FloatArray:
    """Return matrices of `worm3d.machine.banded`, each of shape (n + B, WIDTH), as lanes, shape (B + n, 2 B + 1, W)."""
    return np.stack([np.roll(band[:, :COLUMNS], B, axis=0) for band in bands], axis=2)


@cache
def elimination(lanes: int) -> Loop:
    """Return what solves so many systems side by side, over and over, compiled.

    It is called with the matrices; the right-hand sides, shape (n, W); room for the solutions, shape (n + 2 B, W), of
    which the first and last B rows are zero; room for the factors, shaped as the matrices, its first B rows zero;
    whether to make new factors; and how often.
    """
    reduce, below, above = _reduce(lanes), _subtract_sum(lanes, 0, False), _subtract_sum(lanes, B + 1, True)
    row, entry = 8 * COLUMNS * lanes, 8 * lanes

    @numba.njit(error_model="numpy", nogil=True)
    def loop(bands: FloatArray, b: FloatArray, x: FloatArray, factors: FloatArray, renew: bool, times: int) -> None:
        n, matrix, first = len(b), bands.ctypes.data + B * row, factors.ctypes.data + B * row
        start = x.ctypes.data + B * entry
        for _ in range(times):
            if renew:
                for k in range(n):
                    reduce(first + k * row, matrix + k * row)
            x[B : B + n] = b
            for k in range(n):
                below(start + k * entry, first + k * row, start + (k - B) * entry)
            for k in range(n - 1, -1, -1):
                above(start + k * entry, first + k * row, start + (k + 1) * entry)

    found: Loop = loop
    return found


class _Writer:
    """Writes code on vectors of so many doubles."""

    def __init__(self, builder: Any, lanes: int) -> None:
        self._builder, self._lanes, self.kind = builder, lanes, ir.VectorType(ir.DoubleType(), lanes)

    def place(self, address: Any, entries: int) -> Any:
        """Return where the vector so many entries on stands."""
        shift = ir.Constant(_INT, 8 * self._lanes * entries)
        return self._builder.inttoptr(self._builder.add(address, shift), self.kind.as_pointer())

    def load(self, address: Any, entries: int) -> Any:
        return self._builder.load(self.place(address, entries), align=8)

    def store(self, value: Any, address: Any, entries: int) -> None:
        self._builder.store(value, self.place(address, entries), align=8)

    def less(self, value: Any, factor: Any, other: Any) -> Any:
        """Return value - factor other."""
        insert: Any = cgutils.get_or_insert_function
        kind = ir.FunctionType(self.kind, [self.kind] * 3)
        fma = insert(self._builder.module, kind, f"llvm.fma.v{self._lanes}f64")
        return self._builder.call(fma, [self._builder.fneg(factor), other, value])

    def times(self, x: Any, y: Any) -> Any:
        return self._builder.fmul(x, y)

    def inverse(self, x: Any) -> Any:
        return self._builder.fdiv(ir.Constant(self.kind, [1.0] * self._lanes), x)


def _reduce(lanes: int) -> Any:
    """(row, source): make a row of the matrix one of the factors; the rows before it are there."""

    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        w, (row, source) = _Writer(builder, lanes), args
        values = [w.load(source, c) for c in range(COLUMNS)]
        for m in range(B):
            other = (m - B) * COLUMNS + B
            values[m] = w.times(values[m], w.load(row, other))
            for c in range(1, B + 1):
                values[m + c] = w.less(values[m + c], values[m], w.load(row, other + c))
        values[B] = w.inverse(values[B])
        for c, value in enumerate(values):
            w.store(value, row, c)
        return ir.Constant(_INT, 0)

    def typed(_context: Any, row: Any, source: Any) -> Any:
        return types.int64(types.int64, types.int64), generate

    return intrinsic(typed)


def _subtract_sum(lanes: int, first: int, scaled: bool) -> Any:
    """(x, row, others): x -= the sum of B entries of a row times others; perhaps times its diagonal's inverse."""

    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        w, (x, row, others) = _Writer(builder, lanes), args
        value = w.load(x, 0)
        for c in reversed(range(B)) if scaled else range(B):
            value = w.less(value, w.load(row, first + c), w.load(others, c))
        w.store(w.times(value, w.load(row, B)) if scaled else value, x, 0)
        return ir.Constant(_INT, 0)

    def typed(_context: Any, x: Any, row: Any, others: Any) -> Any:
        return types.int64(types.int64, types.int64, types.int64), generate

    return intrinsic(typed)
