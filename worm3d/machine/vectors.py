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


def _type_transpose(order: list[int]) -> Any:
    """Return the typing of the transposition of rows that are read in this order, a multiple of eight."""

    def typed(_context: Any, to: Any, to_stride: Any, source: Any, stride: Any) -> Any:
        def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            for first in range(0, len(order), WIDTH):
                to, to_stride, source, stride = args
                steps = [ir.Constant(_INT, 8 * k) for k in order[first : first + WIDTH]]
                rows = [_load(builder, builder.add(source, builder.mul(stride, step))) for step in steps]
                to = builder.add(to, ir.Constant(_INT, 8 * first))
                for k, row in enumerate(transposed(builder, rows)):
                    _store(builder, row, builder.add(to, builder.mul(to_stride, ir.Constant(_INT, 8 * k))))
            return ir.Constant(_INT, 0)

        return types.int64(types.int64, types.int64, types.int64, types.int64), generate

    return typed


def _type_add(vectors: int) -> Any:
    def typed(_context: Any, to: Any, source: Any) -> Any:
        def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            for k in range(vectors):
                there, here = (builder.add(address, ir.Constant(_INT, 8 * WIDTH * k)) for address in args)
                _store(builder, builder.fadd(_load(builder, there), _load(builder, here)), there)
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


def _spread(builder: Any, number: Any) -> Any:
    """Return a vector of one whole number."""
    empty = ir.Constant(ir.VectorType(_INT, WIDTH), ir.Undefined)
    return _shuffle(builder, builder.insert_element(empty, number, ir.Constant(_INT, 0)), empty, [0] * WIDTH)


def _sums(builder: Any, sources: list[Any], count: Any) -> list[Any]:
    """Return, lane by lane, the sums of the vectors that stand at each address, as far as they count."""
    zero = ir.Constant(_KIND, [0.0] * WIDTH)
    places = [_utils.alloca_once_value(builder, zero) for _ in sources]
    counts = _spread(builder, count)
    with _utils.for_range_slice(builder, ir.Constant(_INT, 0), count, ir.Constant(_INT, WIDTH)) as (k, _):
        lanes = builder.add(_spread(builder, k), ir.Constant(counts.type, list(range(WIDTH))))
        counted = builder.icmp_signed("<", lanes, counts)
        for source, place in zip(sources, places, strict=True):
            here = _load(builder, builder.add(source, builder.mul(k, ir.Constant(_INT, 8))))
            builder.store(builder.fadd(builder.load(place), builder.select(counted, here, zero)), place)
    return [builder.load(place) for place in places]


def _type_total(_context: Any, source: Any, count: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        (lanes,) = _sums(builder, [args[0]], args[1])
        for apart in (4, 2, 1):
            other = [lane + apart if lane < apart else lane for lane in range(WIDTH)]
            lanes = builder.fadd(lanes, _shuffle(builder, lanes, lanes, other))
        return builder.extract_element(lanes, ir.Constant(_INT, 0))

    return types.float64(types.int64, types.int64), generate


def _type_totals(_context: Any, to: Any, source: Any, stride: Any, count: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        to, source, stride, count = args
        steps = [builder.mul(stride, ir.Constant(_INT, 8 * k)) for k in range(WIDTH)]
        sums = transposed(builder, _sums(builder, [builder.add(source, step) for step in steps], count))
        while len(sums) > 1:
            sums = [builder.fadd(x, y) for x, y in zip(sums[::2], sums[1::2], strict=True)]
        _store(builder, sums[0], to)
        return ir.Constant(_INT, 0)

    return types.int64(types.int64, types.int64, types.int64, types.int64), generate


def _type_greatest(_context: Any, source: Any, count: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        source, count = args
        place = _utils.alloca_once_value(builder, ir.Constant(_KIND, [0.0] * WIDTH))
        with _utils.for_range_slice(builder, ir.Constant(_INT, 0), count, ir.Constant(_INT, WIDTH)) as (k, _):
            here, most = _load(builder, builder.add(source, builder.mul(k, ir.Constant(_INT, 8)))), builder.load(place)
            builder.store(builder.select(builder.fcmp_ordered(">", here, most), here, most), place)
        lanes = builder.load(place)
        for apart in (4, 2, 1):
            other = _shuffle(builder, lanes, lanes, [(lane + apart) % WIDTH for lane in range(WIDTH)])
            lanes = builder.select(builder.fcmp_ordered(">", other, lanes), other, lanes)
        return builder.extract_element(lanes, ir.Constant(_INT, 0))

    return types.float64(types.int64, types.int64), generate


def _type_repeat(_context: Any, to: Any, stride: Any, source: Any) -> Any:
    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        to, stride, source = args
        value = _load(builder, source)
        for k in range(WIDTH):
            _store(builder, value, builder.add(to, builder.mul(stride, ir.Constant(_INT, 8 * k))))
        return ir.Constant(_INT, 0)

    return types.int64(types.int64, types.int64, types.int64), generate


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
transpose: Any = intrinsic(_type_transpose(list(range(WIDTH))))
"""(to, stride, source, stride): write 8 rows of 8 doubles as columns; addresses, and strides of rows in doubles."""
transpose_places: Any = intrinsic(_type_transpose([WIDTH * (k % 3) + k // 3 for k in range(3 * WIDTH)]))
"""(to, stride, source, stride): write 24 rows, 8 of each axis, as 8 rows of 8 places, each x, y, z."""
repeat_8: Any = intrinsic(_type_repeat)
"""(to, stride, source): write 8 doubles into each of 8 rows."""
add_8: Any = intrinsic(_type_add(1))
"""(to, source): add 8 doubles to those at an address."""
add_16: Any = intrinsic(_type_add(2))
"""(to, source): add 16 doubles to those at an address."""
move: Any = intrinsic(_type_move)
"""(to, source, count): copy doubles to an address; the two do not overlap."""
clear: Any = intrinsic(_type_clear)
"""(to, count): set doubles at an address to zero."""
total: Any = intrinsic(_type_total)
"""(source, count): the sum of doubles; up to seven more behind them are read, and ignored."""
totals: Any = intrinsic(_type_totals)
"""(to, source, stride, count): write the sums of 8 rows, likewise."""
greatest: Any = intrinsic(_type_greatest)
"""(source, count): the greatest of doubles, a multiple of eight, and 0."""
