"""Banded linear systems in compiled code: root-free Cholesky, and LU with pivoting for unsymmetric ones.

A matrix of size n with half bandwidth B stands by rows: entry (i, j) at [i, B + j - i], in an array (n + B, WIDTH)
whose other entries are zero: the last columns take the fill-in of pivoting, and with B rows below the end every inner
loop has the same length, so that it is a few vector instructions. The cost is linear in n.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from worm3d.compiled import njit

FloatArray = NDArray[np.float64]

B = 12
"""Half bandwidth: a joint couples 13 coordinates."""
WIDTH = 40
"""Columns: 2 B + 1, B more for pivoting, and up to a multiple of 8."""
SMALLEST_PIVOT = 1e-14
"""Of the diagonal entry: below this a matrix is not positive definite."""
_LANES = 8
"""Doubles in a vector instruction; LLVM splits it where the processor has shorter ones."""


def _type_subtract(vectors: int) -> Any:
    """Return the typing of `to[k] -= factor * source[k]` for a fixed number of vectors from two places of an array."""

    def typed(_context: Any, band: Any, to: Any, source: Any, factor: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            data = context.make_array(signature.args[0])(context, builder, args[0]).data
            kind = ir.VectorType(ir.DoubleType(), _LANES)
            one = builder.insert_element(ir.Constant(kind, ir.Undefined), args[3], ir.Constant(ir.IntType(32), 0))
            zeros = ir.Constant(ir.VectorType(ir.IntType(32), _LANES), None)
            spread = builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), zeros)
            insert: Any = cgutils.get_or_insert_function
            fma = insert(builder.module, ir.FunctionType(kind, [kind] * 3), f"llvm.fma.v{_LANES}f64")
            minus = builder.fneg(spread)
            for k in range(vectors):
                shift = ir.Constant(ir.IntType(64), _LANES * k)
                begins = [builder.gep(data, [builder.add(place, shift)]) for place in args[1:3]]
                places = [builder.bitcast(begin, kind.as_pointer()) for begin in begins]
                old, row = (builder.load(place, align=8) for place in places)
                builder.store(builder.call(fma, [minus, row, old]), places[0], align=8)
            return context.get_dummy_value()

        return types.void(band, types.int64, types.int64, types.float64), generate

    return typed


_subtract_16: Any = intrinsic(_type_subtract(2))
_subtract_24: Any = intrinsic(_type_subtract(3))


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
    n, flat = len(x), band.ravel()
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
                _subtract_16(flat, (j + m) * WIDTH + B, j * WIDTH + B + m, factor)
    for j in range(n - 1, -1, -1):
        total = x[j]
        for m in range(1, min(B, n - 1 - j) + 1):
            total -= band[j, B + m] * x[j + m]
        x[j] = total / band[j, B]
    return True


@njit
def lu_factor(band: FloatArray, pivots: FloatArray) -> bool:
    """Factorise A in place by elimination with partial pivoting; return whether it is regular.

    Parameters
    ----------
    band : ndarray, shape (n + B, WIDTH)
        Columns from 2 B + 1 on must be zero; overwritten by the factors.
    pivots : ndarray, shape (n,)
        Overwritten by the rows' exchanges, as distances.
    """
    n, flat = len(pivots), band.ravel()
    for k in range(n):
        below, best = min(B, n - 1 - k), 0
        for r in range(1, below + 1):
            if abs(band[k + r, B - r]) > abs(band[k + best, B - best]):
                best = r
        pivots[k] = best
        if not abs(band[k + best, B - best]) > 0.0:
            return False
        if best > 0:
            for c in range(2 * B + 1):
                band[k, B + c], band[k + best, B + c - best] = band[k + best, B + c - best], band[k, B + c]
        inverse = 1.0 / band[k, B]
        for r in range(1, below + 1):
            factor = band[k + r, B - r] * inverse
            band[k + r, B - r] = factor
            if factor != 0.0:
                _subtract_24(flat, (k + r) * WIDTH + B - r + 1, k * WIDTH + B + 1, factor)
    return True


@njit
def lu_solve(band: FloatArray, pivots: FloatArray, x: FloatArray) -> None:
    """Solve A x = b in place with the factors of `lu_factor`; x holds b."""
    n = len(x)
    for k in range(n):
        best = int(pivots[k])
        if best > 0:
            x[k], x[k + best] = x[k + best], x[k]
        for r in range(1, min(B, n - 1 - k) + 1):
            x[k + r] -= band[k + r, B - r] * x[k]
    for k in range(n - 1, -1, -1):
        total = x[k]
        for c in range(1, min(2 * B, n - 1 - k) + 1):
            total -= band[k, B + c] * x[k + c]
        x[k] = total / band[k, B]
