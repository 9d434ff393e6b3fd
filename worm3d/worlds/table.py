"""What kernels written by hand share: arrays handed over by address, and cubic B-splines.

A table cannot be a CasADi expression, so these kernels are Numba's, with the signature of
`worm3d.machine.codegen.emit`. Their arrays stand among a world's parameters as two numbers, the halves of an address,
each exact in a double.

Cubic B-spline (T1), for 0 <= t < 1 between nodes 1 and 2 of four (de Boor, A Practical Guide to Splines):

    w(t) = ((1 - t)^3, 3 t^3 - 6 t^2 + 4, -3 t^3 + 3 t^2 + 3 t + 1, t^3)/6
"""

from __future__ import annotations

import numpy as np
from numba import carray  # type: ignore[attr-defined]  # not listed in its __all__
from numpy.typing import NDArray

from worm3d.machine.codegen import evaluate
from worm3d.machine.compiled import inner
from worm3d.machine.vectors import doubles_at, singles_at
from worm3d.values.arrays import FloatArray
from worm3d.worlds.base import WorldKernel

Weights = tuple[float, float, float, float]
Jet = tuple[float, float, float, float, float, float, float, float, float, float]
"""Value, gradient (3) and Hessian (6: xx, xy, xz, yy, yz, zz) of a distance."""

SIGNATURE = "int64(int64, int64, int64, int64, int64, int64, int64)"
"""Of a kernel: inputs, rows_in, lanes_in, outputs, rows_out, lanes_out, count."""

WORLD_ROWS = 11
"""Of the outputs: distance, gradient (3), curvature (6), grip."""

LANES = 8
"""The widest vector of any processor."""

OPTIMISATION = 3
"""Of Numba's: less doubles the time of a look-up."""

HALF = 32
"""Bits of an address in one parameter."""


def halves(place: int) -> list[float]:
    """Return an address as two parameters; what stands there has to outlive the kernel."""
    return [float(place >> HALF), float(place & ((1 << HALF) - 1))]


@inner
def address(high: float, low: float) -> int:
    """Return the address of which these are the halves."""
    return (int(high) << HALF) + int(low)


@inner
def doubles(at: int, rows: int, columns: int) -> FloatArray:
    """Return the matrix that stands at an address, not a copy."""
    found: FloatArray = carray(doubles_at(at), (rows, columns))
    return found


@inner
def singles(at: int, count: int) -> NDArray[np.float32]:
    """Return the numbers of single precision that stand at an address, not a copy."""
    found: NDArray[np.float32] = carray(singles_at(at), (count,))
    return found


@inner
def cubic(t: float) -> tuple[Weights, Weights, Weights]:
    """Return the weights of (T1) and their first and second derivatives with respect to t."""
    r = 1.0 - t
    value = (
        r * r * r / 6.0,
        (t * t * (t - 2.0) + 4.0 / 3.0) / 2.0,
        (r * r * (r - 2.0) + 4.0 / 3.0) / 2.0,
        t * t * t / 6.0,
    )
    first = (-0.5 * r * r, 0.5 * t * (3.0 * t - 4.0), 0.5 * r * (4.0 - 3.0 * r), 0.5 * t * t)
    return value, first, (r, 3.0 * t - 2.0, 3.0 * r - 2.0, t)


@inner
def cell(place: float, nodes: int) -> tuple[int, float]:
    """Return the node before a place, counted in nodes, and the way from there: inside, and for NaN any."""
    last = nodes - 2.0 - 1e-9
    inside = place if place > 1.0 else 1.0  # NaN too: a node of it would lie anywhere in memory
    inside = inside if inside < last else last
    node = int(inside)
    return node, inside - node


@inner
def repeats(points: FloatArray, k: int) -> bool:
    """Return whether a point is the one before it, as in the lanes that only fill a vector."""
    if k == 0:
        return False
    return bool(
        points[0, k] == points[0, k - 1] and points[1, k] == points[1, k - 1] and points[2, k] == points[2, k - 1]
    )


@inner
def repeat(out: FloatArray, k: int) -> None:
    """Write the rows of the lane before once more."""
    for r in range(WORLD_ROWS):
        out[r, k] = out[r, k - 1]


@inner
def write(out: FloatArray, k: int, jet: Jet, length: float, side: float, per_length: float, grip: float) -> None:
    """Write a world's rows of lane k, each kind times the factor given."""
    out[0, k] = length * jet[0]
    out[1, k], out[2, k], out[3, k] = side * jet[1], side * jet[2], side * jet[3]
    out[4, k], out[5, k], out[6, k] = per_length * jet[4], per_length * jet[5], per_length * jet[6]
    out[7, k], out[8, k], out[9, k] = per_length * jet[7], per_length * jet[8], per_length * jet[9]
    out[10, k] = grip


def looked_up(kernel: WorldKernel, points: FloatArray) -> FloatArray:
    """Return what a world's kernel says of points of shape (..., 3), shape (11, number of points)."""
    places = np.asarray(points, dtype=float).reshape(-1, 3)
    lanes = -(-max(len(places), 1) // LANES) * LANES
    inputs = np.zeros((3 + len(kernel.parameters), lanes))
    inputs[:3, : len(places)], inputs[3:] = places.T, kernel.parameters[:, None]
    outputs = np.zeros((WORLD_ROWS, lanes))
    evaluate(kernel.address, inputs, outputs, len(places))
    return outputs[:, : len(places)]
