"""Many named arrays in one block of memory, for compiled code: what a function receives stays small.

Numba passes every array as seven numbers and counts its references; a hundred arrays make its compile time minutes.
Compiled code gets a block as two addresses, of the numbers and of a table that says where each array stands:
`matrix(block, NAME)` is the array itself. Python gets the same arrays by name from `Memory`, which owns them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import carray  # type: ignore[attr-defined]  # not listed in its __all__
from numpy.typing import NDArray

from worm3d.machine.compiled import inner
from worm3d.machine.vectors import doubles_at, integers_at
from worm3d.values.arrays import FloatArray

LINE = 8
"""Doubles in a cache line; every array begins on one."""


class Block(NamedTuple):
    """Where a block of arrays stands, for compiled code."""

    memory: int
    """Address of its numbers."""
    table: int
    """Address of (begin, rows, columns) of each array."""


class Memory:
    """A block of arrays of zeros, each on a cache line.

    Parameters
    ----------
    names : sequence of str
    shapes : sequence of tuple of int
        Rows and columns of each array.
    cleared : bool
        False leaves in them what the memory holds: all of it is to be written before it is read.
    """

    def __init__(self, names: Sequence[str], shapes: Sequence[tuple[int, int]], *, cleared: bool = True) -> None:
        self._names = tuple(names)
        places, start = [], 0
        for rows, columns in shapes:
            places.append((start, rows, columns))
            start += -(-rows * columns // LINE) * LINE
        self.table = np.array(places, dtype=np.int64)
        raw = np.zeros(start + LINE) if cleared else np.empty(start + LINE)
        first = -raw.ctypes.data % (8 * LINE) // 8
        self._numbers = raw[first : first + start]

    @property
    def block(self) -> Block:
        """For compiled code, as long as this object lives."""
        return Block(self._numbers.ctypes.data, self.table.ctypes.data)

    def take(self, other: Memory) -> None:
        """Take over the numbers of a block of the same shapes."""
        self._numbers[:] = other._numbers

    def arrays(self) -> dict[str, FloatArray]:
        """Return the arrays by name, not copies."""
        views = {}
        for name, (start, rows, columns) in zip(self._names, self.table.tolist(), strict=True):
            views[name] = self._numbers[start : start + rows * columns].reshape(rows, columns)
        return views


@inner
def integers(address: int, count: int) -> NDArray[np.int64]:
    """Return the whole numbers that stand at an address, not a copy."""
    found: NDArray[np.int64] = carray(integers_at(address), (count,))
    return found


@inner
def matrix(block: Block, k: int) -> FloatArray:
    """Return array k, shape (rows, columns), not a copy."""
    place = integers(block.table + 24 * k, 3)
    found: FloatArray = carray(doubles_at(block.memory + 8 * place[0]), (place[1], place[2]))
    return found


@inner
def vector(block: Block, k: int) -> FloatArray:
    """Return array k, all rows one after the other, not a copy."""
    place = integers(block.table + 24 * k, 3)
    found: FloatArray = carray(doubles_at(block.memory + 8 * place[0]), (place[1] * place[2],))
    return found


@inner
def rows(block: Block, k: int, first: int, count: int) -> FloatArray:
    """Return some rows of array k, one after the other, not a copy, shape (count * columns,)."""
    place = integers(block.table + 24 * k, 3)
    start = block.memory + 8 * (place[0] + first * place[2])
    found: FloatArray = carray(doubles_at(start), (count * place[2],))
    return found


@inner
def address(block: Block, k: int, row: int) -> int:
    """Return where row `row` of array k begins."""
    place = integers(block.table + 24 * k, 3)
    return int(block.memory + 8 * (place[0] + row * place[2]))


# Loops rather than array expressions, each of which would take Numba a third of a second to compile.


@inner
def fill(to: FloatArray, value: float) -> None:
    """Set all entries of a vector."""
    for k in range(len(to)):
        to[k] = value


@inner
def copy(to: FloatArray, source: FloatArray) -> None:
    """Copy a vector."""
    for k in range(len(to)):
        to[k] = source[k]


@inner
def combine(to: FloatArray, u: float, x: FloatArray, v: float, y: FloatArray) -> None:
    """Set a vector to u x + v y; it may be one of them."""
    for k in range(len(to)):
        to[k] = u * x[k] + v * y[k]


@inner
def dot(x: FloatArray, y: FloatArray) -> float:
    """Return the scalar product of two vectors; Numba's own imports SciPy, which takes longer than a short run."""
    value = 0.0
    for k in range(len(x)):
        value += x[k] * y[k]
    return value


@inner
def total(x: FloatArray) -> float:
    """Return the sum of a vector."""
    value = 0.0
    for k in range(len(x)):
        value += x[k]
    return value
