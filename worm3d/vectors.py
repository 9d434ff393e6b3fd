"""Pointers and vector instructions for compiled code, on addresses.

Numba makes of loops over eight doubles what is several times slower. Vectors are of eight doubles; LLVM splits them
where the processor has shorter ones.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_utils: Any = cgutils  # without types
WIDTH = 8
"""Doubles in a vector."""
_KIND = ir.VectorType(ir.DoubleType(), WIDTH)
_INT = ir.IntType(64)


def _pointer(builder: Any, address: Any) -> Any:
    return builder.inttoptr(address, _KIND.as_pointer())


def _load(builder: Any, address: Any) -> Any:
    return builder.load(_pointer(builder, address), align=8)


def _store(builder: Any, value: Any, address: Any) -> None:
    builder.store(value, _pointer(builder, address), align=8)


def _shuffle(builder: Any, x: Any, y: Any, lanes: list[int]) -> Any:
    mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), lanes)
    return builder.shuffle_vector(x, y, mask)


def transposed(builder: Any, rows: list[Any]) -> list[Any]:
    """Return the columns of 8 rows: exchange, in three rounds, the lanes of rows 1, 2 and 4 apart."""
    for apart in (1, 2, 4):
        low = [lane if not lane & apart else WIDTH + lane - apart for lane in range(WIDTH)]
        high = [lane + apart if not lane & apart else WIDTH + lane for lane in range(WIDTH)]
        for k in range(WIDTH):
            if not k & apart:
                x, y = rows[k], rows[k + apart]
                rows[k], rows[k + apart] = _shuffle(builder, x, y, low), _shuffle(builder, x, y, high)
    return rows


def _type_transpose(_context: Any, to: Any, to_stride: Any, source: Any, stride: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        to, to_stride, source, stride = args
        eight = [ir.Constant(_INT, 8 * k) for k in range(WIDTH)]
        rows = [_load(builder, builder.add(source, builder.mul(stride, step))) for step in eight]
        for row, step in zip(transposed(builder, rows), eight, strict=True):
            _store(builder, row, builder.add(to, builder.mul(to_stride, step)))
        return ir.Constant(_INT, 0)

    return types.int64(types.int64, types.int64, types.int64, types.int64), generate


def _type_add(vectors: int, operation: str) -> Any:
    def typed(_context: Any, to: Any, source: Any) -> Any:
        def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            for k in range(vectors):
                there, here = (builder.add(address, ir.Constant(_INT, 8 * WIDTH * k)) for address in args)
                value = getattr(builder, operation)(_load(builder, there), _load(builder, here))
                _store(builder, value, there)
            return ir.Constant(_INT, 0)

        return types.int64(types.int64, types.int64), generate

    return typed


def _type_move(_context: Any, to: Any, source: Any, count: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        byte = ir.IntType(8).as_pointer()
        to, source = (builder.inttoptr(address, byte) for address in args[:2])
        _utils.raw_memcpy(builder, to, source, args[2], ir.Constant(_INT, 8))
        return ir.Constant(_INT, 0)

    return types.int64(types.int64, types.int64, types.int64), generate


def _type_clear(_context: Any, to: Any, count: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        to = builder.inttoptr(args[0], ir.IntType(8).as_pointer())
        _utils.memset(builder, to, builder.mul(args[1], ir.Constant(_INT, 8)), 0)
        return ir.Constant(_INT, 0)

    return types.int64(types.int64, types.int64), generate


def _type_total(_context: Any, source: Any, count: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        source, count = args
        numbers = ir.VectorType(_INT, WIDTH)
        zero = ir.Constant(_KIND, [0.0] * WIDTH)
        place = _utils.alloca_once_value(builder, zero)
        first = builder.insert_element(ir.Constant(numbers, ir.Undefined), count, ir.Constant(_INT, 0))
        counts = _shuffle(builder, first, ir.Constant(numbers, ir.Undefined), [0] * WIDTH)
        with _utils.for_range_slice(builder, ir.Constant(_INT, 0), count, ir.Constant(_INT, WIDTH)) as (k, _):
            at = builder.insert_element(ir.Constant(numbers, ir.Undefined), k, ir.Constant(_INT, 0))
            lanes = _shuffle(builder, at, ir.Constant(numbers, ir.Undefined), [0] * WIDTH)
            lanes = builder.add(lanes, ir.Constant(numbers, list(range(WIDTH))))
            here = _load(builder, builder.add(source, builder.mul(k, ir.Constant(_INT, 8))))
            here = builder.select(builder.icmp_signed("<", lanes, counts), here, zero)
            builder.store(builder.fadd(builder.load(place), here), place)
        lanes = builder.load(place)
        for apart in (4, 2, 1):
            other = [lane + apart if lane < apart else lane for lane in range(WIDTH)]
            lanes = builder.fadd(lanes, _shuffle(builder, lanes, lanes, other))
        return builder.extract_element(lanes, ir.Constant(_INT, 0))

    return types.float64(types.int64, types.int64), generate


def _type_pointer(to: Any) -> Any:
    def typed(_context: Any, _address: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(to).as_pointer())

        pointer: Any = types.CPointer
        return pointer(to)(types.int64), generate

    return typed


doubles_at: Any = intrinsic(_type_pointer(types.float64))
"""(address): the pointer to doubles there, for `numba.carray`."""
singles_at: Any = intrinsic(_type_pointer(types.float32))
"""(address): the pointer to numbers of single precision there."""
integers_at: Any = intrinsic(_type_pointer(types.int64))
"""(address): the pointer to whole numbers there."""
transpose: Any = intrinsic(_type_transpose)
"""(to, stride, source, stride): write 8 rows of 8 doubles as columns; addresses, and strides of rows in doubles."""
add_8: Any = intrinsic(_type_add(1, "fadd"))
"""(to, source): add 8 doubles to those at an address."""
subtract_8: Any = intrinsic(_type_add(1, "fsub"))
"""(to, source): subtract 8 doubles from those at an address."""
add_16: Any = intrinsic(_type_add(2, "fadd"))
"""(to, source): add 16 doubles to those at an address."""
move: Any = intrinsic(_type_move)
"""(to, source, count): copy doubles to an address; the two do not overlap."""
clear: Any = intrinsic(_type_clear)
"""(to, count): set doubles at an address to zero."""
total: Any = intrinsic(_type_total)
"""(source, count): the sum of doubles; up to seven more behind them are read, and ignored."""
