"""Compiled kernels of worlds, from formulas and from tables, and their evaluation at given points.

A world's compiled kernel takes points and the world's parameters, as rows of the inputs, and returns as rows

    g               signed distance, negative inside the solid [m]
    n (3)           gradient of g, a unit vector out of the solid
    H (6)           Hessian of g, xx, xy, xz, yy, yz, zz [1/m]; zero is allowed and costs Newton steps only
    grip            multiplier of the friction coefficients at that place

in the layout of `worm3d.machine.codegen`: row r of point k is at [r, k].

A table cannot be a CasADi expression, so kernels with table look-ups are written by hand for Numba, with the signature
of `worm3d.machine.codegen.emit`. Each table takes two of the world's parameters, the halves of the table's address,
each exact in a double.

Cubic B-spline (WS1), for 0 <= t < 1 between nodes 1 and 2 of four (de Boor, A Practical Guide to Splines):

    w(t) = ((1 - t)^3, 3 t^3 - 6 t^2 + 4, -3 t^3 + 3 t^2 + 3 t + 1, t^3)/6
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from worm3d.machine.codegen import Kernel, compile_kernel, evaluate
from worm3d.machine.compiled import cfunc, inner
from worm3d.machine.later import carray
from worm3d.machine.vectors import doubles_at, singles_at
from worm3d.values.arrays import FloatArray

Formula = tuple[ca.Function, FloatArray]
"""A world's rows (11) as a function of a point (3) and parameters (m), and the parameters, shape (m,)."""

Weights = tuple[float, float, float, float]
Jet = tuple[float, float, float, float, float, float, float, float, float, float]
"""Value, gradient (3) and Hessian (6: xx, xy, xz, yy, yz, zz) of a distance."""

WORLD_ROWS = 11
"""Number of rows of the outputs: distance, gradient (3), Hessian (6), grip."""

SPLINE_PADDING = 14
"""Number of nodes added on each side of a grid, so that the ends of its spline have no effect to single precision."""

ON_AXIS = 1e-30
"""Square of the distance below which a point on an axis has no direction to the wall around [m^2]."""

LANES = 8
"""Number of doubles in the widest vector of any processor."""


@dataclass(frozen=True)
class WorldKernel:
    """A compiled world."""

    address: int
    """Address of the C function (`worm3d.machine.codegen.emit`)."""
    parameters: FloatArray
    """Shape (m,): rows of the inputs after the point's coordinates, the same for all points."""
    owner: object
    """Object that is kept alive as long as the address is used."""


def compiled(function: ca.Function, parameters: FloatArray) -> WorldKernel:
    """Return the compiled world of a formula."""
    whole = kernel(function)
    return WorldKernel(whole.address, parameters, whole)


@lru_cache(maxsize=64)
def kernel(function: ca.Function) -> Kernel:
    """Return a compiled function from a cache; the kernel computes the lanes beyond the points too."""
    return compile_kernel(function, padded=True)


@cache
def by_hand(function: Callable[..., int]) -> Any:
    """Return a compiled hand-written kernel from a cache; the kernel has an `address`."""
    return cfunc(function, optimisation=3)  # a lower level doubles the time of a look-up


def kernel_by_hand(function: Callable[..., int], parameters: list[float], owned: object) -> WorldKernel:
    """Return the compiled world of a hand-written kernel, with its parameters and what has to stay in memory."""
    code = by_hand(function)
    return WorldKernel(code.address, np.array(parameters, dtype=float), (code, owned))


def looked_up(kernel: WorldKernel, points: FloatArray) -> FloatArray:
    """Return the rows of a compiled world at points of shape (..., 3), shape (11, ...)."""
    places = np.asarray(points, dtype=float).reshape(-1, 3)
    lanes = -(-max(len(places), 1) // LANES) * LANES
    inputs, outputs = inputs_of(kernel, lanes), np.zeros((WORLD_ROWS, lanes))
    inputs[:3, : len(places)] = places.T
    evaluate(kernel.address, inputs, outputs, len(places))
    return outputs[:, : len(places)].reshape(WORLD_ROWS, *np.shape(points)[:-1])


def inputs_of(kernel: WorldKernel, lanes: int) -> FloatArray:
    """Return the inputs of a compiled world for points at the origin, shape (3 + m, lanes)."""
    inputs = np.zeros((3 + len(kernel.parameters), lanes))
    inputs[3:] = kernel.parameters[:, None]
    return inputs


def rows(g: ca.SX, n: ca.SX, H: ca.SX, grip: ca.SX | float) -> ca.SX:
    """Return a world's rows from distance, gradient (3), Hessian (3, 3) and multiplier."""
    return ca.densify(ca.vertcat(g, n, H[0, 0], H[0, 1], H[0, 2], H[1, 1], H[1, 2], H[2, 2], grip))


def halves(*places: int) -> list[float]:
    """Return addresses as two parameters each; the memory there has to outlive the kernel."""
    return [float(half) for place in places for half in divmod(place, 2**32)]


@inner
def address(high: float, low: float) -> int:
    """Return the address with these halves."""
    return (int(high) << 32) + int(low)


@inner
def doubles(at: int, rows: int, columns: int) -> FloatArray:
    """Return the matrix at an address, not a copy."""
    found: FloatArray = carray(doubles_at(at), (rows, columns))
    return found


@inner
def table(points: FloatArray, row: int, rows: int, columns: int) -> FloatArray:
    """Return the matrix whose address is in two rows of the inputs of a kernel, not a copy."""
    return doubles(address(points[row, 0], points[row + 1, 0]), rows, columns)


@inner
def singles(at: int, count: int) -> NDArray[np.float32]:
    """Return the numbers of single precision at an address, not a copy."""
    found: NDArray[np.float32] = carray(singles_at(at), (count,))
    return found


@inner
def cubic(t: float) -> tuple[Weights, Weights, Weights]:
    """Return the weights of (WS1) and their first and second derivatives with respect to t."""
    r = 1.0 - t
    before, after = (t * t * (t - 2.0) + 4.0 / 3.0) / 2.0, (r * r * (r - 2.0) + 4.0 / 3.0) / 2.0
    value = (r * r * r / 6.0, before, after, t * t * t / 6.0)
    first = (-0.5 * r * r, 0.5 * t * (3.0 * t - 4.0), 0.5 * r * (4.0 - 3.0 * r), 0.5 * t * t)
    return value, first, (r, 3.0 * t - 2.0, 3.0 * r - 2.0, t)


@inner
def cell(place: float, nodes: int) -> tuple[int, float]:
    """Return the node before a place, counted in nodes, and the distance from there; a node inside also for NaN."""
    last = nodes - 2.0 - 1e-9
    inside = place if place > 1.0 else 1.0  # NaN too: the node of NaN would lie anywhere in memory
    inside = inside if inside < last else last
    node = int(inside)
    return node, inside - node


@inner
def repeats(points: FloatArray, k: int) -> bool:
    """Return whether a point equals the point before, as in lanes that only fill a vector."""
    same = k > 0
    for d in range(3):
        same = same and points[d, k] == points[d, k - 1]
    return same


@inner
def repeat(out: FloatArray, k: int) -> None:
    """Copy the rows of the lane before."""
    for r in range(WORLD_ROWS):
        out[r, k] = out[r, k - 1]


@inner
def write(out: FloatArray, k: int, jet: Jet, length: float, side: float, per_length: float, grip: float) -> None:
    """Write a world's rows of lane k, with lengths, components and curvatures times the given factors."""
    out[0, k] = length * jet[0]
    out[1, k], out[2, k], out[3, k] = side * jet[1], side * jet[2], side * jet[3]
    out[4, k], out[5, k], out[6, k] = per_length * jet[4], per_length * jet[5], per_length * jet[6]
    out[7, k], out[8, k], out[9, k] = per_length * jet[7], per_length * jet[8], per_length * jet[9]
    out[10, k] = grip
