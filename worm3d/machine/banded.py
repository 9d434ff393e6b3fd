"""Banded linear systems in compiled code: root-free Cholesky; LU for unsymmetric ones is in `worm3d.machine.banded_lu`.

A matrix of size n with half bandwidth B stands by rows: entry (i, j) at [i, B + j - i], in an array (n + B, WIDTH)
whose other entries are zero: with columns to spare and B rows below the end every inner loop has the same length, so
that it is a few vector instructions. The cost is linear in n.
"""

from __future__ import annotations

from worm3d.machine.compiled import njit
from worm3d.machine.vectors import subtract_16
from worm3d.values.arrays import FloatArray

B = 12
"""Half bandwidth: a joint couples 13 coordinates."""
WIDTH = 40
"""Columns: 2 B + 1, some that vector instructions read beyond, and up to a multiple of 8."""
SMALLEST_PIVOT = 1e-14
"""Least pivot of a positive definite matrix, as a fraction of the diagonal entry."""


@njit
def cholesky_solve(band: FloatArray, x: FloatArray) -> bool:
    """Solve A x = b in place for a symmetric A, of which the upper triangle is used; x holds b.

    Parameters
    ----------
    band : ndarray, shape (n + B, WIDTH)
        Overwritten by L D L^T; columns from 2 B + 1 on must be zero.
    x : ndarray, shape (n,)

    Returns
    -------
    bool
        Whether A is positive definite; otherwise x means nothing.
    """
    n, start = len(x), band.ctypes.data + 8 * B
    for j in range(n):
        band[j, 0] = band[j, B]  # below the diagonal nothing is read
    for j in range(n):
        last, pivot = min(B, n - 1 - j), band[j, B]
        if not pivot > SMALLEST_PIVOT * band[j, 0]:
            return False
        inverse = 1.0 / pivot
        for m in range(1, last + 1):
            factor = band[j, B + m] * inverse
            if factor != 0.0:
                x[j + m] -= factor * x[j]
                subtract_16(start + 8 * WIDTH * (j + m), start + 8 * (WIDTH * j + m), factor)
    for j in range(n - 1, -1, -1):
        total = x[j]
        for m in range(1, min(B, n - 1 - j) + 1):
            total -= band[j, B + m] * x[j + m]
        x[j] = total / band[j, B]
    return True
