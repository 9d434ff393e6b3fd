"""Worlds whose formulas are symbolic: compiled, and evaluated for points of one's own."""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np

from worm3d.machine.codegen import Kernel, compile_kernel
from worm3d.values.arrays import FloatArray
from worm3d.worlds import table
from worm3d.worlds.base import World, WorldKernel

Formula = tuple[ca.Function, FloatArray]
"""A world's rows (11) as a function of a point (3) and parameters (m), and the parameters, shape (m,)."""


@runtime_checkable
class SymbolicWorld(Protocol):
    """A world that has its kernel's rows as a formula."""

    def symbolic(self) -> Formula | None:
        """Return the formula; None where there is none, or a table is faster."""


def formula(world: World) -> Formula | None:
    """Return a world's formula, if it has one."""
    return world.symbolic() if isinstance(world, SymbolicWorld) else None


def compiled(function: ca.Function, parameters: FloatArray) -> WorldKernel:
    """Return a compiled world."""
    whole = kernel(function)
    return WorldKernel(whole.address, parameters, whole)


def distances(world: WorldKernel, points: FloatArray) -> FloatArray:
    """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""
    distance: FloatArray = rows(world, points)[0]
    return distance


def rows(world: WorldKernel, points: FloatArray) -> FloatArray:
    """Return the rows of a compiled world at points of shape (..., 3), shape (11, ...)."""
    return table.looked_up(world, points).reshape(-1, *np.shape(points)[:-1])


@lru_cache(maxsize=64)
def kernel(function: ca.Function) -> Kernel:
    """Return a compiled function, the same one for the same function; it computes the lanes beyond the points too."""
    return compile_kernel(function, padded=True)
