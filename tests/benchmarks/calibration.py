"""A compiled loop whose time tells how fast a machine is, so that figures of two machines can be compared.

One pass factors a symmetric positive definite matrix of 12 rows and solves with it: multiplications, additions,
divisions and square roots on data in the first-level cache, as in a step of the worm. It does not depend on worm3d's
own solver, and must not change: figures in print are divided by it.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from worm3d.machine.compiled import njit
from worm3d.values.arrays import FloatArray

ROWS = 12
PASSES = 20_000


def calibrate() -> float:
    """Return the time of a pass of the calibration loop [µs]."""
    place = np.arange(ROWS)
    matrix = 1.0 / (1.0 + np.abs(place[:, None] - place)) + ROWS * np.eye(ROWS)
    solve_often(matrix, 1)
    times = []
    for _ in range(5):  # the fastest counts
        began = perf_counter()
        solve_often(matrix, PASSES)
        times.append(perf_counter() - began)
    return 1e6 * min(times) / PASSES


def solve_often(matrix: FloatArray, passes: int) -> FloatArray:
    """Solve A x = 1 + x so many times, by Cholesky's factors anew each time, from x = 0; return x, shape (ROWS,)."""
    x = np.zeros(len(matrix))
    _solve_often(matrix, passes, x)
    return x


@njit
def _solve_often(matrix: FloatArray, passes: int, x: FloatArray) -> None:
    n = len(matrix)
    factor = np.zeros((n, n))
    for _ in range(passes):
        for i in range(n):
            for j in range(i + 1):
                total = matrix[i, j]
                for k in range(j):
                    total -= factor[i, k] * factor[j, k]
                factor[i, j] = np.sqrt(total) if i == j else total / factor[j, j]
        for i in range(n):
            total = 1.0 + x[i]
            for k in range(i):
                total -= factor[i, k] * x[k]
            x[i] = total / factor[i, i]
        for i in range(n - 1, -1, -1):
            total = x[i]
            for k in range(i + 1, n):
                total -= factor[k, i] * x[k]
            x[i] = total / factor[i, i]
