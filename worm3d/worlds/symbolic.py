"""Worlds whose formulas are symbolic: compiled, and evaluated for points of one's own."""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from worm3d.codegen import Kernel, compile_kernel
from worm3d.worlds.base import WorldKernel

FloatArray = NDArray[np.float64]


@runtime_checkable
class SymbolicWorld(Protocol):
    """A world that has its kernel's rows as a function."""

    def symbolic(self) -> tuple[ca.Function, FloatArray]:
        """Return the rows (11) as a function of a point (3) and parameters (m), and the parameters, shape (m,)."""


def compiled(function: ca.Function, parameters: FloatArray) -> WorldKernel:
    """Return a compiled world."""
    kernel = _kernel(function)
    return WorldKernel(kernel.address, parameters, kernel)


def distances(world: WorldKernel, points: FloatArray) -> FloatArray:
    """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""
    distance: FloatArray = rows(world, points)[0]
    return distance


def rows(world: WorldKernel, points: FloatArray) -> FloatArray:
    """Return the rows of a compiled world at points of shape (..., 3), shape (11, ...)."""
    kernel = world.owner
    assert isinstance(kernel, Kernel)
    flat = np.asarray(points, dtype=float).reshape(-1, 3)
    inputs, outputs = kernel.allocate(len(flat))
    inputs[:3, : len(flat)], inputs[3:] = flat.T, world.parameters[:, None]
    kernel(inputs, outputs, len(flat))
    return outputs[:, : len(flat)].reshape(-1, *np.shape(points)[:-1])


@lru_cache(maxsize=64)
def _kernel(function: ca.Function) -> Kernel:
    return compile_kernel(function)
