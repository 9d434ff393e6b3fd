"""Keeps a spline of distances close to them between its nodes too, near the surface.

A spline through the nodes rounds edges and corners, and errs by up to 0.28 of a cell there. Between nodes and half-way
from node to node are eight samples a cell with weights w (T1) of the coefficients c and distances d. Each that the
spline misses by more than a tolerance e is met within it by the least change of the coefficients,

    c <- c - w (r - e sign(r))/|w|^2,    r = w.c - d,                                                          (M3)

one after the other, in a few sweeps (Agmon, "The relaxation method for linear inequalities", 1954). Where the surface
is smooth nothing is missed and nothing changes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from worm3d.machine.compiled import inner, njit
from worm3d.values.arrays import FloatArray, IntArray
from worm3d.worlds import table

Shift = tuple[float, ...]
"""Along x, y and z."""

TOLERANCE = 0.1
"""e of (M3), in cells; what lies between the samples, and (M1), add up to as much."""

SWEEPS = 10
"""At a few corners the tolerance cannot be met; after so many sweeps they are off by little more."""


def fit(coefficients: FloatArray, samples: Sequence[tuple[Shift, IntArray, FloatArray]]) -> None:
    """Change the coefficients of a spline, shape (A, B, C), so that it misses few samples by more than the tolerance.

    Parameters
    ----------
    coefficients : ndarray, shape (A, B, C)
        Changed in place [cells].
    samples : sequence
        How far they lie behind their nodes along each axis, 0 to 1; the nodes, shape (M, 3); and the distances, shape
        (M,) [cells].
    """
    for _ in range(SWEEPS):
        missed = [_sweep(coefficients, shift, nodes, distance) for shift, nodes, distance in samples]
        if not any(missed):
            return


@njit
def _sweep(c: FloatArray, shift: Shift, nodes: IntArray, distance: FloatArray) -> int:
    """Take (M3) for each sample, and return for how many it changed something."""
    w, missed = _weights(shift), 0
    square = np.sum(w * w)
    for m in range(len(nodes)):
        i, j, k = nodes[m, 0] - 1, nodes[m, 1] - 1, nodes[m, 2] - 1
        r = -distance[m]
        for a in range(4):
            for b in range(4):
                for d in range(4):
                    r += w[a, b, d] * c[i + a, j + b, k + d]
        if abs(r) > TOLERANCE:
            missed += 1
            share = (r - np.sign(r) * TOLERANCE) / square
            for a in range(4):
                for b in range(4):
                    for d in range(4):
                        c[i + a, j + b, k + d] -= share * w[a, b, d]
    return missed


@inner
def _weights(shift: Shift) -> FloatArray:
    """Return the weights of the coefficients about a place between nodes, shape (4, 4, 4)."""
    along, across, up = table.cubic(shift[0])[0], table.cubic(shift[1])[0], table.cubic(shift[2])[0]
    w = np.empty((4, 4, 4))
    for a in range(4):
        for b in range(4):
            for d in range(4):
                w[a, b, d] = along[a] * across[b] * up[d]
    return w
