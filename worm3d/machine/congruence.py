"""J^T K J of a point, added to a matrix in bands: straight code on vectors for compiled functions."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from worm3d.machine.vector_writer import INT, LANES, Writer

AXES = 3
"""Rows of J."""


def _type_add_congruent(_context: Any, to: Any, pitch: Any, jacobian: Any, more: Any, stride: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        w, (to, pitch, jacobian, more, stride) = Writer(builder), args
        J = [w.load(jacobian, LANES * axis) for axis in range(AXES)]
        places = [builder.add(more, builder.mul(stride, ir.Constant(INT, k))) for k in range(AXES**2)]
        K = [w.spread_number(w.number(place, 0)) for place in places]
        KJ = [w.sum(K[AXES * axis : AXES * (axis + 1)], J) for axis in range(AXES)]
        for r in range(LANES):
            here = builder.add(to, builder.mul(pitch, ir.Constant(INT, r)))
            row = w.load(here, 0)
            for axis in range(AXES):
                row = w.plus(row, w.spread(J[axis], r), KJ[axis])
            w.store(row, here, 0)
        return ir.Constant(INT, 0)

    return types.int64(types.int64, types.int64, types.int64, types.int64, types.int64), generate


add_congruent: Any = intrinsic(_type_add_congruent)
"""(to, pitch, jacobian, more, stride): add J^T K J to 8 rows of 8 doubles that begin a pitch apart. J are 3 rows of 8
doubles at an address; the 9 doubles of K stand, row by row, a stride apart. Pitch and stride in bytes."""
