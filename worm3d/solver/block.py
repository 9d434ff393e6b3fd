"""Many named arrays in one block of memory, so that compiled functions receive few arguments.

Numba passes every array as seven numbers and counts references to it. With a hundred arrays, compilation would take
minutes. Compiled code therefore receives a block as two addresses: the address of the numbers, and the address of a
table with the position of each array. `matrix(block, NAME)` returns an array. `Memory` owns the arrays, and returns
them by name to Python.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worm3d.machine.compiled import inner
from worm3d.machine.later import carray
from worm3d.machine.vectors import doubles_at, integers_at
from worm3d.values.arrays import FloatArray

LINE = 8
"""Doubles in a cache line. Every array begins at the start of a cache line."""


class Block(NamedTuple):
    """Addresses of a block of arrays, for compiled code."""

    memory: int
    """Address of the numbers."""
    table: int
    """Address of (begin, rows, columns) of each array."""


class Plan(NamedTuple):
    """Layout of arrays in a block. Arrays with memory of their own begin at the start of a cache line."""

    names: tuple[str, ...]
    table: NDArray[np.int64]
    """Begin, rows and columns of each array, shape (A, 3)."""
    size: int
    """Number of doubles in the block."""

    @classmethod
    def of(
        cls,
        names: Sequence[str],
        shapes: Sequence[tuple[int, int]],
        inside: Mapping[str, tuple[str, int]] = MappingProxyType({}),
    ) -> Plan:
        """Return the plan of arrays.

        Parameters
        ----------
        names : sequence of str
        shapes : sequence of tuple of int
            Rows and columns of each array.
        inside : mapping of str to (str, int), optional
            For each array that shares memory: the earlier array that contains it, and the offset from the beginning of
            the earlier array.
        """
        places: dict[str, tuple[str, int]] = {}  # array that owns the memory, and the offset in that array
        room = dict.fromkeys((name for name in names if name not in inside), 0)
        for name, (rows, columns) in zip(names, shapes, strict=True):
            host, offset = inside.get(name, (name, 0))
            owner, begin = places.get(host, (name, 0))
            places[name] = owner, begin + offset
            room[owner] = max(room[owner], begin + offset + rows * columns)
        begins, size = {}, 0
        for name in room:
            begins[name], size = size, size + -(-room[name] // LINE) * LINE
        starts = [begins[places[name][0]] + places[name][1] for name in names]
        table = np.array([(start, *shape) for start, shape in zip(starts, shapes, strict=True)], dtype=np.int64)
        return cls(tuple(names), table, size)

    def places(self) -> dict[str, list[int]]:
        """Return begin, rows and columns of each array by name."""
        return dict(zip(self.names, self.table.tolist(), strict=True))


class Memory:
    """A block of arrays. They contain zeros, or arbitrary numbers if `cleared` is False."""

    def __init__(self, plan: Plan, *, cleared: bool = True) -> None:
        self._plan, self.table = plan, plan.table
        raw = np.zeros(plan.size + LINE) if cleared else np.empty(plan.size + LINE)
        first = -raw.ctypes.data % (8 * LINE) // 8
        self._numbers = raw[first : first + plan.size]

    @property
    def block(self) -> Block:
        """Block for compiled code, valid as long as this object lives."""
        return Block(self._numbers.ctypes.data, self.table.ctypes.data)

    def take(self, other: Memory) -> None:
        """Copy the numbers from another block of the same shapes."""
        self._numbers[:] = other._numbers

    def arrays(self) -> dict[str, FloatArray]:
        """Return views of the arrays by name."""
        return {
            name: self._numbers[start : start + rows * columns].reshape(rows, columns)
            for name, (start, rows, columns) in self._plan.places().items()
        }


@inner
def integers(address: int, count: int) -> NDArray[np.int64]:
    """Return a view of `count` integers at an address."""
    found: NDArray[np.int64] = carray(integers_at(address), (count,))
    return found


@inner
def matrix(block: Block, k: int) -> FloatArray:
    """Return a view of array k, shape (rows, columns)."""
    place = integers(block.table + 24 * k, 3)
    found: FloatArray = carray(doubles_at(block.memory + 8 * place[0]), (place[1], place[2]))
    return found


@inner
def vector(block: Block, k: int) -> FloatArray:
    """Return a view of all rows of array k, one after the other, shape (rows * columns,)."""
    place = integers(block.table + 24 * k, 3)
    found: FloatArray = carray(doubles_at(block.memory + 8 * place[0]), (place[1] * place[2],))
    return found


@inner
def rows(block: Block, k: int, first: int, count: int) -> FloatArray:
    """Return a view of `count` rows of array k from row `first` on, one after the other, shape (count * columns,)."""
    place = integers(block.table + 24 * k, 3)
    start = block.memory + 8 * (place[0] + first * place[2])
    found: FloatArray = carray(doubles_at(start), (count * place[2],))
    return found


@inner
def address(block: Block, k: int, row: int) -> int:
    """Return the address where row `row` of array k begins."""
    place = integers(block.table + 24 * k, 3)
    return int(block.memory + 8 * (place[0] + row * place[2]))


# The following functions contain loops, since Numba would compile each array expression for a third of a second.


@inner
def fill(to: FloatArray, value: float) -> None:
    """Set all entries of a vector."""
    for k in range(len(to)):
        to[k] = value


@inner
def copy(to: FloatArray, source: FloatArray) -> None:
    """Copy the vector `source` to `to`."""
    for k in range(len(to)):
        to[k] = source[k]


@inner
def combine(to: FloatArray, u: float, x: FloatArray, v: float, y: FloatArray) -> None:
    """Set `to` to u x + v y. `to` may be x or y."""
    for k in range(len(to)):
        to[k] = u * x[k] + v * y[k]


@inner
def dot(x: FloatArray, y: FloatArray) -> float:
    """Return the scalar product of two vectors. Numba's `dot` imports SciPy, which takes longer than a short run."""
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
