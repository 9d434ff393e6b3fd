"""Many named arrays in one block of memory, for compiled code: what a function receives stays small.

Numba passes every array as seven numbers; a hundred arrays make its compile time minutes. A block is one vector of
numbers and a table that says where each array stands; inside compiled code `matrix(block, NAME)` is the array itself,
and `named(block, NAMES)` gives them to Python.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worm3d.compiled import njit

FloatArray = NDArray[np.float64]

LINE = 8
"""Doubles in a cache line; every array begins on one."""


class Block(NamedTuple):
    """Arrays in one piece of memory."""

    memory: FloatArray
    table: NDArray[np.int64]
    """(arrays, 3): where it begins, rows, columns."""


@njit
def matrix(block: Block, k: int) -> FloatArray:
    """Return array k, shape (rows, columns), not a copy."""
    start, rows, columns = block.table[k]
    return block.memory[start : start + rows * columns].reshape(rows, columns)


@njit
def vector(block: Block, k: int) -> FloatArray:
    """Return array k, all rows one after the other, not a copy."""
    start, rows, columns = block.table[k]
    return block.memory[start : start + rows * columns]


def allocate(shapes: Sequence[tuple[int, int]]) -> Block:
    """Return a block of zero arrays of the given shapes, each on a cache line."""
    table = np.zeros((len(shapes), 3), dtype=np.int64)
    start = 0
    for k, (rows, columns) in enumerate(shapes):
        table[k] = start, rows, columns
        start += -(-rows * columns // LINE) * LINE
    raw = np.zeros(start + LINE)
    first = -raw.ctypes.data % (8 * LINE) // 8
    return Block(raw[first : first + start], table)


def named(block: Block, names: Sequence[str]) -> Mapping[str, FloatArray]:
    """Return the arrays of a block by name, not copies."""
    views = {}
    for name, (start, rows, columns) in zip(names, block.table, strict=True):
        views[name] = block.memory[start : start + rows * columns].reshape(rows, columns)
    return views
