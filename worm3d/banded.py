"""Banded linear systems in compiled code: root-free Cholesky, and LU with pivoting for unsymmetric ones.

A matrix of size n with half bandwidth B stands by rows: entry (i, j) at [i, B + j - i], in an array (n, WIDTH) whose
last columns take the fill-in of pivoting. The cost is linear in n.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.compiled import njit

FloatArray = NDArray[np.float64]

B = 12
"""Half bandwidth: a joint couples 13 coordinates."""
WIDTH = 40
"""Columns: 2 B + 1, B more for pivoting, and up to a multiple of 8."""
SMALLEST_PIVOT = 1e-14
"""Of the diagonal entry: below this a matrix is not positive definite."""


@njit
def cholesky_solve(band: FloatArray, x: FloatArray) -> bool:
    """Solve A x = b in place for a symmetric A, of which the upper triangle is used; x holds b.

    Parameters
    ----------
    band : ndarray, shape (n, WIDTH)
        Overwritten by L D L^T.
    x : ndarray, shape (n,)

    Returns
    -------
    bool
        Whether A is positive definite; otherwise x means nothing.
    """
    n = len(x)
    for j in range(n):
        band[j, WIDTH - 1] = band[j, B]
    for j in range(n):
        last = min(B, n - 1 - j)
        pivot = band[j, B]
        if not pivot > SMALLEST_PIVOT * band[j, WIDTH - 1]:
            return False
        for m in range(1, last + 1):
            factor = band[j, B + m] / pivot
            x[j + m] -= factor * x[j]
            for c in range(m, last + 1):
                band[j + m, B + c - m] -= factor * band[j, B + c]
    for j in range(n - 1, -1, -1):
        total = x[j]
        for m in range(1, min(B, n - 1 - j) + 1):
            total -= band[j, B + m] * x[j + m]
        x[j] = total / band[j, B]
    return True


@njit
def lu_solve(band: FloatArray, x: FloatArray) -> bool:
    """Solve A x = b in place by elimination with partial pivoting; x holds b.

    Parameters
    ----------
    band : ndarray, shape (n, WIDTH)
        Columns from 2 B + 1 on must be zero; overwritten.
    x : ndarray, shape (n,)

    Returns
    -------
    bool
        Whether A is regular; otherwise x means nothing.
    """
    n = len(x)
    for k in range(n):
        below, right = min(B, n - 1 - k), min(2 * B, n - 1 - k)
        best = 0
        for r in range(1, below + 1):
            if abs(band[k + r, B - r]) > abs(band[k + best, B - best]):
                best = r
        pivot = band[k + best, B - best]
        if not abs(pivot) > 0.0:
            return False
        if best > 0:
            x[k], x[k + best] = x[k + best], x[k]
            for c in range(right + 1):
                band[k, B + c], band[k + best, B + c - best] = band[k + best, B + c - best], band[k, B + c]
        for r in range(1, below + 1):
            factor = band[k + r, B - r] / pivot
            if factor != 0.0:
                x[k + r] -= factor * x[k]
                for c in range(1, right + 1):
                    band[k + r, B + c - r] -= factor * band[k, B + c]
    for k in range(n - 1, -1, -1):
        total = x[k]
        for c in range(1, min(2 * B, n - 1 - k) + 1):
            total -= band[k, B + c] * x[k + c]
        x[k] = total / band[k, B]
    return True
