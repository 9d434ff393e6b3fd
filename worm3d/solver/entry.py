"""Boundaries inside the compiled code: functions that are compiled on their own and called through their address.

Numba optimises everything that a function calls once more with that function; in a deep tree compile time becomes
minutes. An entry is a C function `double f(int64 handle, double value, int64 a, int64 b)`; its handle is the address of
`Core.handle`, from which `opened` makes the core again.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from worm3d.compiled import njit
from worm3d.solver.arrays import Core
from worm3d.solver.block import Block

SIGNATURE = "float64(int64, float64, int64, int64)"


def _type_call(_context: Any, address: Any, handle: Any, value: Any, a: Any, b: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        integer, number = ir.IntType(64), ir.DoubleType()
        kind = ir.FunctionType(number, [integer, number, integer, integer])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])

    return types.float64(types.int64, types.int64, types.float64, types.int64, types.int64), generate


def _pointer_type(to: Any) -> Any:
    def type_pointer(_context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return builder.inttoptr(
                args[0], cgutils.voidptr_t if to is None else context.get_value_type(to).as_pointer()
            )

        return types.CPointer(to)(types.int64), generate

    return type_pointer


call: Any = intrinsic(_type_call)
"""Call the entry at an address: (address, handle, value, a, b) -> float."""
_numbers_at: Any = intrinsic(_pointer_type(types.float64))
_integers_at: Any = intrinsic(_pointer_type(types.int64))


@njit
def opened(address: int) -> Core:
    """Return the core whose handle stands at an address."""
    handle = numba.carray(_integers_at(address), (9,))
    memory = numba.carray(_numbers_at(handle[1]), (handle[2],))
    table = numba.carray(_integers_at(handle[3]), (handle[4], 3))
    kernels = numba.carray(_integers_at(handle[5]), (handle[6],))
    counters = numba.carray(_integers_at(handle[7]), (handle[8],))
    return Core(handle[0], kernels, Block(memory, table), counters, handle)
