"""CasADi functions that Python calls many times, without allocation of memory for CasADi in each call."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from worm3d.values.arrays import FloatArray


class Buffered:
    """A function of dense arguments and results with preallocated memory. Only one thread at a time may call it."""

    def __init__(self, function: ca.Function) -> None:
        self._buffer, self._run = function.buffer()
        self._given = [_memory(function.size_in(k)) for k in range(function.n_in())]
        self._found = [_memory(function.size_out(k)) for k in range(function.n_out())]
        for k, given in enumerate(self._given):
            self._buffer.set_arg(k, given.ravel(order="K").data)  # type: ignore[call-arg]  # its size is known
        for k, found in enumerate(self._found):
            self._buffer.set_res(k, found.ravel(order="K").data)  # type: ignore[call-arg]

    def __call__(self, *given: ArrayLike) -> list[FloatArray]:
        """Return the results. A result with one column has the shape (n,)."""
        for memory, value in zip(self._given, given, strict=True):
            memory[...] = value
        self._run()
        return [found.copy() for found in self._found]


def _memory(size: tuple[int, int]) -> FloatArray:
    return np.zeros(size[0]) if size[1] == 1 else np.zeros(size, order="F")
