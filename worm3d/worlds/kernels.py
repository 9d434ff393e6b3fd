"""Compiled kernels of worlds, from formulas and from tables, and their evaluation at given points.

The kernel of a world is a compiled function. The rows of its inputs are the coordinates of the points and the world's
parameters. The rows of its outputs are

    g               signed distance, negative inside the solid [m]
    n (3)           gradient of g, a unit vector out of the solid
    H (6)           Hessian of g, xx, xy, xz, yy, yz, zz [1/m]; a world may give 0, but Newton then takes more steps
    grip            multiplier of the friction coefficients at that place

in the layout of `worm3d.machine.codegen`: row r of point k is at [r, k].

A look-up in a table cannot be written as a CasADi expression. Kernels with tables are therefore written by hand for
Numba, with the signature of `worm3d.machine.codegen.emit`. The address of each table is passed as two parameters, its
upper and its lower 32 bits, because a double represents each half exactly.

The weights of four neighbouring nodes 0 to 3 in a cubic B-spline, at a fraction 0 <= t < 1 between nodes 1 and 2, are
(de Boor, A Practical Guide to Splines)

    w(t) = ((1 - t)^3, 3 t^3 - 6 t^2 + 4, -3 t^3 + 3 t^2 + 3 t + 1, t^3)/6                           (WS1)
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
"""A function of a point (3) and m parameters that returns the rows of a world (11), and the parameters, shape (m,)."""

Weights = tuple[float, float, float, float]
Jet = tuple[float, float, float, float, float, float, float, float, float, float]
"""Value, gradient (3) and Hessian (6: xx, xy, xz, yy, yz, zz) of a distance."""

WORLD_ROWS = 11
"""Number of rows of the outputs: distance, gradient (3), Hessian (6), grip."""

SPLINE_PADDING = 14
"""Number of nodes added on each side of a grid. With this number, the conditions at the ends of the spline have no
effect on the grid itself in single precision."""

ON_AXIS = 1e-30
"""Number added to the squared distance from an axis, so that dividing by the distance is possible on the axis [m^2]."""

LANES = 8
"""Number of doubles in the widest vector of any processor."""


@dataclass(frozen=True)
class WorldKernel:
    """A compiled world."""

    address: int
    """Address of the C function (`worm3d.machine.codegen.emit`)."""
    parameters: FloatArray
    """Rows of the inputs after the coordinates of the point, the same for all points, shape (m,)."""
    owner: object
    """Object that must stay in memory as long as the address is used."""


def compiled(function: ca.Function, parameters: FloatArray) -> WorldKernel:
    """Return the compiled world of a formula."""
    whole = kernel(function)
    return WorldKernel(whole.address, parameters, whole)


@lru_cache(maxsize=64)
def kernel(function: ca.Function) -> Kernel:
    """Return a compiled function from a cache.

    The kernel computes whole vectors of lanes, also the lanes after the last point.
    """
    return compile_kernel(function, padded=True)


@cache
def by_hand(function: Callable[..., int]) -> Any:
    """Return a compiled hand-written kernel from a cache. The attribute `address` is the address of the kernel."""
    return cfunc(function, optimisation=3)  # a lower level doubles the time of a look-up


def kernel_by_hand(function: Callable[..., int], parameters: list[float], owned: object) -> WorldKernel:
    """Return the compiled world of a hand-written kernel with parameters. The kernel reads `owned`."""
    code = by_hand(function)
    return WorldKernel(code.address, np.array(parameters, dtype=float), (code, owned))


def looked_up(kernel: WorldKernel, points: FloatArray) -> FloatArray:
    """Return the rows of a compiled world at points of shape (..., 3). The result has the shape (11, ...)."""
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
    """Return each address as two parameters. The memory at the addresses must exist as long as the kernel."""
    return [float(half) for place in places for half in divmod(place, 2**32)]


@inner
def address(high: float, low: float) -> int:
    """Return the address with the given upper and lower 32 bits."""
    return (int(high) << 32) + int(low)


@inner
def doubles(at: int, rows: int, columns: int) -> FloatArray:
    """Return the matrix at an address, without copying it."""
    found: FloatArray = carray(doubles_at(at), (rows, columns))
    return found


@inner
def table(points: FloatArray, row: int, rows: int, columns: int) -> FloatArray:
    """Return the matrix whose address is in rows `row` and `row + 1` of a kernel's inputs, without copying it."""
    return doubles(address(points[row, 0], points[row + 1, 0]), rows, columns)


@inner
def singles(at: int, count: int) -> NDArray[np.float32]:
    """Return the numbers in single precision at an address, without copying them."""
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
    """Return the node before a place, and the distance of the place from this node, in spacings.

    `place` is the coordinate in spacings from node 0. The node always has the neighbours that a spline needs, also for
    a place outside the grid and for NaN.
    """
    last = nodes - 2.0 - 1e-9
    inside = place if place > 1.0 else 1.0  # also for NaN, which would be converted to an arbitrary node
    inside = inside if inside < last else last
    node = int(inside)
    return node, inside - node


@inner
def repeats(points: FloatArray, k: int) -> bool:
    """Return whether point k equals point k - 1. The lanes that fill up a vector repeat the last point."""
    same = k > 0
    for d in range(3):
        same = same and points[d, k] == points[d, k - 1]
    return same


@inner
def repeat(out: FloatArray, k: int) -> None:
    """Copy the rows of lane k - 1 to lane k."""
    for r in range(WORLD_ROWS):
        out[r, k] = out[r, k - 1]


@inner
def write(out: FloatArray, k: int, jet: Jet, length: float, side: float, per_length: float, grip: float) -> None:
    """Write a world's rows of lane k.

    The distance is multiplied by `length`, the gradient by `side`, and the Hessian by `per_length`.
    """
    out[0, k] = length * jet[0]
    out[1, k], out[2, k], out[3, k] = side * jet[1], side * jet[2], side * jet[3]
    out[4, k], out[5, k], out[6, k] = per_length * jet[4], per_length * jet[5], per_length * jet[6]
    out[7, k], out[8, k], out[9, k] = per_length * jet[7], per_length * jet[8], per_length * jet[9]
    out[10, k] = grip
