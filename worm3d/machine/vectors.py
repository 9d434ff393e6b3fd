"""Pointers and vector instructions for compiled code. Arguments are addresses; strides and counts are in doubles.

Numba would compile loops over eight doubles to code that is several times slower.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir

from worm3d.machine.later import placeholder, utils
from worm3d.machine.writer import BYTES, LANES, Writer, on_addresses

VECTOR_WIDTH = LANES
"""Number of doubles in a vector."""
BLOCK_SIZE = 5
"""Number of coordinates of a joint's block: p (3), and the roll and bend of the segment ahead of the joint."""


def _pointer(name: str) -> Any:
    from numba.core import types
    from numba.extending import intrinsic

    to = getattr(types, name)

    def typed(_context: Any, _address: Any) -> Any:
        def generate(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(to).as_pointer())

        pointer: Any = types.CPointer
        return pointer(to)(types.int64), generate

    return intrinsic(typed)


doubles_at: Any = placeholder(lambda: _pointer("float64"))
"""(address): pointer to doubles at the address, for `carray`."""
singles_at: Any = placeholder(lambda: _pointer("float32"))
"""(address): pointer to numbers of single precision at the address."""
integers_at: Any = placeholder(lambda: _pointer("int64"))
"""(address): pointer to whole numbers at the address."""
indices_at: Any = placeholder(lambda: _pointer("int32"))
"""(address): pointer to whole numbers of 32 bits at the address."""


def _transpose(w: Writer, to: Any, to_stride: Any, source: Any, stride: Any, order: Sequence[int]) -> None:
    """Write rows, which are read in the given order, as columns. The number of rows is a multiple of eight."""
    for first in range(0, len(order), VECTOR_WIDTH):
        rows = [w.load(w.shifted(source, k, stride)) for k in order[first : first + VECTOR_WIDTH]]
        for k, row in enumerate(w.transposed(rows)):
            w.store(row, w.shifted(to, k, to_stride), first)


@on_addresses()
def transpose(w: Writer, to: Any, to_stride: Any, source: Any, stride: Any) -> None:
    """Write 8 rows of 8 doubles as columns."""
    _transpose(w, to, to_stride, source, stride, range(VECTOR_WIDTH))


@on_addresses()
def transpose_places(w: Writer, to: Any, to_stride: Any, source: Any, stride: Any) -> None:
    """Write 24 rows, 8 for each axis, as 8 rows of 8 positions. A position is x, y, z."""
    _transpose(w, to, to_stride, source, stride, [VECTOR_WIDTH * (k % 3) + k // 3 for k in range(3 * VECTOR_WIDTH)])


@on_addresses()
def repeat_8(w: Writer, to: Any, stride: Any, source: Any) -> None:
    """Write 8 doubles into each of 8 rows."""
    value = w.load(source)
    for k in range(VECTOR_WIDTH):
        w.store(value, w.shifted(to, k, stride))


@on_addresses()
def add_rows(w: Writer, to: Any, pitch: Any, source: Any, stride: Any, count: Any) -> None:
    """Add `count` rows of 8 doubles at `source`, `stride` apart, to rows at `to`, `pitch` apart."""
    with utils.for_range(w.builder, count) as loop:
        there = w.shifted(to, loop.index, pitch)
        w.store(w.add(w.load(there), w.load(w.shifted(source, loop.index, stride))), there)


@on_addresses()
def subtract_16(w: Writer, to: Any, source: Any, factor: Any) -> None:
    """Subtract a factor times the 16 doubles at `source` from the 16 doubles at `to`."""
    minus = w.neg(w.spread_number(factor))
    for shift in (0, VECTOR_WIDTH):
        w.store(w.fma(minus, w.load(source, shift), w.load(to, shift)), to, shift)


@on_addresses()
def all_equal(w: Writer, source: Any, value: Any) -> Any:
    """Return 1 if all 8 doubles at `source` equal `value`, otherwise 0."""
    equal = w.compare("oeq", w.load(source), w.spread_number(value))
    every = w.builder.icmp_signed(
        "==", w.builder.bitcast(equal, ir.IntType(VECTOR_WIDTH)), ir.Constant(ir.IntType(VECTOR_WIDTH), -1)
    )
    return w.builder.zext(every, ir.IntType(64))


@on_addresses()
def add_congruent(w: Writer, to: Any, pitch: Any, jacobian: Any, stiffness: Any, stride: Any) -> None:
    """Add J^T K J to 8 rows of 8 doubles at `to`, which begin `pitch` bytes apart.

    `jacobian` is the address of J, which has 3 rows of 8 doubles. `stiffness` is the address of K, whose 9 doubles
    follow each other row by row, `stride` bytes apart.
    """
    axes = range(3)
    J = [w.load(jacobian, VECTOR_WIDTH * axis) for axis in axes]
    places = [w.builder.add(stiffness, w.builder.mul(stride, w.count(k))) for k in range(9)]
    K = [w.spread_number(w.number(place, 0)) for place in places]
    KJ = [w.sum(K[3 * axis : 3 * (axis + 1)], J) for axis in axes]
    for r in range(VECTOR_WIDTH):
        here = w.builder.add(to, w.builder.mul(pitch, w.count(r)))
        row = w.load(here)
        for axis in axes:
            row = w.fma(w.spread(J[axis], r), KJ[axis], row)
        w.store(row, here)


@on_addresses()
def move(w: Writer, to: Any, source: Any, count: Any) -> None:
    """Copy `count` doubles from `source` to `to`. The two must not overlap."""
    byte = ir.IntType(8)
    utils.raw_memcpy(w.builder, w.pointer(to, byte), w.pointer(source, byte), count, w.count(BYTES))


@on_addresses()
def clear(w: Writer, to: Any, count: Any) -> None:
    """Set doubles at an address to zero."""
    utils.memset(w.builder, w.pointer(to, ir.IntType(8)), w.builder.mul(count, w.count(BYTES)), 0)


def _sums(w: Writer, sources: list[Any], count: Any) -> list[Any]:
    """Return, lane by lane, the sums of the first `count` doubles at each address."""
    zero = w.splat(0.0)
    places = [utils.alloca_once_value(w.builder, zero) for _ in sources]
    counts = w.spread_number(count)
    with utils.for_range_slice(w.builder, w.count(0), count, w.count(VECTOR_WIDTH)) as (k, _):
        lanes = w.builder.add(w.spread_number(k), ir.Constant(counts.type, list(range(VECTOR_WIDTH))))
        counted = w.builder.icmp_signed("<", lanes, counts)
        for source, place in zip(sources, places, strict=True):
            here = w.load(w.shifted(source, k))
            w.builder.store(w.add(w.builder.load(place), w.select(counted, here, zero)), place)
    return [w.builder.load(place) for place in places]


@on_addresses(float)
def total(w: Writer, source: Any, count: Any) -> Any:
    """Return the sum of `count` doubles. Up to seven doubles after them are read, but not added."""
    (lanes,) = _sums(w, [source], count)
    for apart in (4, 2, 1):
        lanes = w.add(lanes, w.lanes(lanes, lanes, [k + apart if k < apart else k for k in range(VECTOR_WIDTH)]))
    return w.lane(lanes, 0)


@on_addresses()
def totals(w: Writer, to: Any, source: Any, stride: Any, count: Any) -> None:
    """Write the sums of 8 rows of `count` doubles, which are `stride` apart, to `to`."""
    sums = w.transposed(_sums(w, [w.shifted(source, k, stride) for k in range(VECTOR_WIDTH)], count))
    while len(sums) > 1:
        sums = [w.add(x, y) for x, y in zip(sums[::2], sums[1::2], strict=True)]
    w.store(sums[0], to)


@on_addresses(float)
def greatest(w: Writer, source: Any, count: Any) -> Any:
    """Return the greatest of `count` doubles, or 0 if all are negative. `count` is a multiple of eight."""
    place = utils.alloca_once_value(w.builder, w.splat(0.0))
    with utils.for_range_slice(w.builder, w.count(0), count, w.count(VECTOR_WIDTH)) as (k, _):
        here, most = w.load(w.shifted(source, k)), w.builder.load(place)
        w.builder.store(w.select(w.compare("ogt", here, most), here, most), place)
    return _greatest_lane(w, w.builder.load(place))


def _greatest_lane(w: Writer, lanes: Any) -> Any:
    """Return the greatest number, or NaN if a lane is NaN."""
    for apart in (4, 2, 1):
        other = w.lanes(lanes, lanes, [(k + apart) % VECTOR_WIDTH for k in range(VECTOR_WIDTH)])
        lanes = w.select(w.compare("ugt", other, lanes), other, lanes)
    return w.lane(lanes, 0)


@on_addresses(float)
def largest(w: Writer, source: Any, count: Any, lever: Any) -> Any:
    """Return the largest absolute double in blocks of five, whose last two are multiplied by a lever; NaN if any is."""
    place = utils.alloca_once_value(w.builder, w.splat(0.0))
    bad, lever = utils.alloca_once_value(w.builder, w.splat(0.0)), w.spread_number(lever)
    with utils.for_range_slice(w.builder, w.count(0), count, w.count(BLOCK_SIZE * VECTOR_WIDTH)) as (k, _):
        for first in range(0, BLOCK_SIZE * VECTOR_WIDTH, VECTOR_WIDTH):
            begin = w.builder.add(k, w.count(first))
            here = w.load_some(w.shifted(source, begin), w.builder.sub(count, begin))
            turns = [(first + lane) % BLOCK_SIZE > 2 for lane in range(VECTOR_WIDTH)]
            size = w.size(w.mul(here, w.select(ir.Constant(w.mask, turns), lever, w.splat(1.0))))
            most = w.builder.load(place)
            w.builder.store(w.select(w.compare("ogt", size, most), size, most), place)
            w.builder.store(w.add(w.builder.load(bad), w.sub(size, size)), bad)
    return _greatest_lane(w, w.add(w.builder.load(place), w.builder.load(bad)))
