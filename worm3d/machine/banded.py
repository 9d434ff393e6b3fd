"""Banded linear systems in compiled code: root-free Cholesky; LU for unsymmetric ones is in `worm3d.machine.banded_lu`.

A matrix of size n with half bandwidth B stands by rows: entry (i, j) at [i, B + j - i], in an array (n + B, WIDTH)
whose other entries are zero: with columns to spare and B rows below the end every inner loop has the same length, so
that it is a few vector instructions. The cost is linear in n.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from worm3d.machine.compiled import njit
from worm3d.values.arrays import FloatArray

B = 12
"""Half bandwidth: a joint couples 13 coordinates."""
WIDTH = 40
"""Columns: 2 B + 1, some that vector instructions read beyond, and up to a multiple of 8."""
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
