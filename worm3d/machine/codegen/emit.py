"""Translates a CasADi function to an LLVM module with one function, `SYMBOL`, which loops over blocks of W instances.

An SX function is a list of instructions on a work vector of scalars, whose slots are reused. Most instructions have the
form `slot[out] = op(slot[a], slot[b])`. Others load from the inputs and store to the outputs. The function is

    int64 SYMBOL(const double *inputs, int64 rows_in, int64 lanes_in,
                 double *outputs, int64 rows_out, int64 lanes_out, int64 count)

It returns `SHAPES_FIT` or `WRONG_SHAPE`. Row r of lane k is at inputs[r lanes_in + k]. In the last block, the lanes
after `count` compute the last instance again, whatever numbers their memory contains, so that they cannot cause traps,
denormals or slow paths. This takes an instruction for every input. In a "padded" kernel these lanes use the numbers in
their own memory instead.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from typing import Any

import casadi
from llvmlite import ir

from worm3d.machine.codegen.lanes import LIBRARY, define_all, library, sincos
from worm3d.machine.later import utils
from worm3d.machine.writer import BYTES, DOUBLE, INDEX, INT, Writer

POINTER = ir.PointerType()
SYMBOL = "worm3d_kernel"
SHAPES_FIT, WRONG_SHAPE = 0, 1
FLAGS = ("contract", "arcp")
OPERATION_NAMES = {getattr(casadi, key): key[3:].lower() for key in dir(casadi) if key.startswith("OP_")}


class UnsupportedError(ValueError):
    """Raised if a function cannot become a kernel; the message names the unsupported operation or kind of function."""


class Slot:
    """Content of a slot of the work vector: a number, a truth value, or both. Conversions are written when needed."""

    def __init__(self, w: Writer, number: Any = None, mask: Any = None, constant: float | None = None) -> None:
        self._w, self._number, self._mask, self.constant = w, number, mask, constant

    def number(self) -> Any:
        """Return the value as a number; true is 1 and false is 0."""
        if self._number is None:
            self._number = self._w.select(self._mask, self._w.splat(1.0), self._w.splat(0.0))
        return self._number

    def mask(self) -> Any:
        """Return the mask of the nonzero lanes. NaN counts as true, as in C."""
        if self._mask is None:
            self._mask = self._w.compare("une", self._number, self._w.splat(0.0))
        return self._mask


Rule = Callable[[Writer, list[Slot]], Any]


def _numbers(rule: Callable[..., Any]) -> Rule:
    return lambda w, args: rule(w, *(a.number() for a in args))


def _intrinsic(name: str) -> Rule:
    return _numbers(lambda w, *args: w.intrinsic(name, *args))


def _comparison(how: str) -> Rule:
    return _numbers(lambda w, x, y: w.compare(how, x, y))


def _sign(w: Writer, x: Any) -> Any:
    """Return -1 or 1, or x itself if x is 0 or NaN."""
    zero = w.splat(0.0)
    positive = w.select(w.compare("ogt", x, zero), w.splat(1.0), x)
    return w.select(w.compare("olt", x, zero), w.splat(-1.0), positive)


def _power(w: Writer, args: list[Slot]) -> Any:
    """Return x^n, by multiplication if n is a small integer, otherwise by the C library."""
    exponent = args[1].constant
    if exponent is None or not abs(exponent) <= 16.0 or exponent != int(exponent):
        return library(w, "pow", args[0].number(), args[1].number())
    value = _whole_power(w, args[0].number(), abs(int(exponent)))
    return w.div(w.splat(1.0), value) if exponent < 0.0 else value


def _whole_power(w: Writer, x: Any, n: int) -> Any:
    if n == 0:
        return w.splat(1.0)
    half = _whole_power(w, x, n // 2)
    square = w.mul(half, half) if n > 1 else half
    if n == 1:
        return x
    return w.mul(square, x) if n % 2 else square


NUMBER_RULES: dict[str, Rule] = {
    "assign": lambda w, args: args[0].number(),
    "lift": lambda w, args: args[0].number(),
    **{name: _numbers(getattr(Writer, name)) for name in ("add", "sub", "mul", "div", "neg")},
    **{name: _intrinsic(name) for name in ("sqrt", "fabs", "floor", "ceil", "copysign")},
    "fmin": _intrinsic("minnum"),
    "fmax": _intrinsic("maxnum"),
    "sq": _numbers(lambda w, x: w.mul(x, x)),
    "twice": _numbers(lambda w, x: w.add(x, x)),
    "inv": _numbers(lambda w, x: w.div(w.splat(1.0), x)),
    "sign": _numbers(_sign),
    "sin": _numbers(lambda w, x: sincos(w, x)[0]),
    "cos": _numbers(lambda w, x: sincos(w, x)[1]),
    "pow": _power,
    "constpow": _power,
    "if_else_zero": lambda w, args: w.select(args[0].mask(), args[1].number(), w.splat(0.0)),
}
MASKS: dict[str, Rule] = {
    **{name: _comparison(f"o{name}") for name in ("lt", "le", "eq")},
    "ne": _comparison("une"),
    "not": lambda w, args: w.invert(args[0].mask()),
    "and": lambda w, args: w.once("and_", args[0].mask(), args[1].mask()),
    "or": lambda w, args: w.once("or_", args[0].mask(), args[1].mask()),
}
SUPPORTED = {"input", "output", "const", *NUMBER_RULES, *MASKS, *LIBRARY}
"""CasADi's operations that a kernel may contain."""


def require_sx(function: casadi.Function) -> None:
    """Raise UnsupportedError unless `function` is an SX function without free variables."""
    if not function.is_a("SXFunction"):
        raise UnsupportedError(
            f"kernel {function.name()!r}: got a {function.class_name()}, need an SXFunction; "
            "write it with SX symbols, or call its expand() first"
        )
    if function.has_free():
        raise UnsupportedError(
            f"kernel {function.name()!r}: the variables {function.get_free()} are no inputs; add them to its inputs"
        )


def module(
    source: casadi.Function, width: int, fused: bool, flags: tuple[str, ...] = FLAGS, padded: bool = False
) -> str:
    """Return the text of the module for vectors of `width` doubles; raise UnsupportedError for unknown operations."""
    unit = ir.Module()
    block = _block_function(unit, source, width, flags, padded)
    define_all(unit, width, fused)
    _driver(unit, source, width, block)
    return str(unit)


def _function(unit: Any, name: str, result: Any, args: dict[str, Any]) -> Any:
    """Return a function, with its arguments by name, and its first block."""
    function = ir.Function(unit, ir.FunctionType(result, list(args.values())), name)
    for arg, own in zip(function.args, args, strict=True):
        arg.name = own
    function.attributes.add("nounwind")
    return function


def _block_function(unit: Any, source: casadi.Function, width: int, flags: tuple[str, ...], padded: bool) -> Any:
    """Write `block`, which computes W instances. Its argument `last` is the index of the last valid lane."""
    args = {"in": POINTER, "stride_in": INT, "out": POINTER, "stride_out": INT, "last": INT}
    function = _function(unit, "block", ir.VoidType(), args)
    function.linkage = "internal"
    function.attributes.add("noinline")
    for pointer in (function.args[0], function.args[2]):
        pointer.add_attribute("noalias")
    builder = ir.IRBuilder(function.append_basic_block())
    w, kind = Writer(builder, width, flags), ir.VectorType(INDEX, width)
    order = ir.Constant(kind, list(range(width)))
    last = Writer(builder, width).spread_number(builder.trunc(function.args[4], INDEX))
    none = ir.Constant(kind, None)
    valid = builder.icmp_unsigned(">=", order, none) if padded else builder.icmp_unsigned("<=", order, last)
    first_in = _offsets([source.nnz_in(k) for k in range(source.n_in())])
    first_out = _offsets([source.nnz_out(k) for k in range(source.n_out())])
    slots: dict[int, Slot] = {}
    for k in range(source.n_instructions()):
        name = OPERATION_NAMES[source.instruction_id(k)]
        out, given = source.instruction_output(k), source.instruction_input(k)
        if name == "output":
            value, place = slots[given[0]].number(), _row(w, "out", first_out[out[0]] + out[1])
            w.do("store", value, place, align=BYTES)
        elif name == "input":
            slots[out[0]] = Slot(w, number=_load(w, first_in[given[0]] + given[1], valid))
        elif name == "const":
            constant = source.instruction_constant(k)
            slots[out[0]] = Slot(w, number=w.splat(constant), constant=constant)
        else:
            slots[out[0]] = _computed(w, source, name, [slots[each] for each in given])
    builder.ret_void()
    return function


def _offsets(sizes: list[int]) -> list[int]:
    """Return the first row of each input or output. Rows are the nonzero entries, one after the other."""
    return list(accumulate(sizes, initial=0))


def _computed(w: Writer, source: casadi.Function, name: str, values: list[Slot]) -> Slot:
    if name in NUMBER_RULES:
        return Slot(w, number=NUMBER_RULES[name](w, values))
    if name in MASKS:
        return Slot(w, mask=MASKS[name](w, values))
    if name in LIBRARY:
        return Slot(w, number=library(w, name, *(v.number() for v in values)))
    raise UnsupportedError(
        f"kernel {source.name()!r}: the operation {name!r} has no native form; "
        f"write it with {', '.join(sorted(SUPPORTED))}"
    )


def _row(w: Writer, side: str, row: int) -> Any:
    pointer, stride = w.builder.function.args[{"in": 0, "out": 2}[side] :][:2]
    return _gep(w, pointer, w.once("mul", stride, w.count(row)))


def _gep(w: Writer, pointer: Any, offset: Any) -> Any:
    return w.once("gep", pointer, (offset,), source_etype=DOUBLE)


def _load(w: Writer, row: int, valid: Any) -> Any:
    """Load a row of the inputs. Lanes after the last instance get the numbers of the last instance."""
    place = _row(w, "in", row)
    values = w.once("load", place, align=BYTES, typ=w.vector)
    last = w.once("load", _gep(w, place, w.builder.function.args[4]), align=BYTES, typ=DOUBLE)
    return w.select(valid, values, w.spread_number(last))


def _driver(unit: Any, source: casadi.Function, width: int, block: Any) -> None:
    """Write `SYMBOL`, which checks the shapes and then calls `block` for each group of W instances."""
    args = {"in": POINTER, "rows_in": INT, "lanes_in": INT, "out": POINTER, "rows_out": INT, "lanes_out": INT}
    function = _function(unit, SYMBOL, INT, {**args, "count": INT})
    inputs, rows_in, lanes_in, outputs, rows_out, lanes_out, count = function.args
    entry, head, work, fine, wrong = (
        function.append_basic_block(name) for name in ("entry", "next", "work", "fine", "wrong")
    )
    least = utils.get_or_insert_function(unit, ir.FunctionType(INT, [INT, INT]), "llvm.smin.i64")
    builder = ir.IRBuilder(entry)
    zero, step = ir.Constant(INT, 0), ir.Constant(INT, width)
    needed = builder.and_(builder.add(count, ir.Constant(INT, width - 1)), ir.Constant(INT, -width))
    rows = builder.and_(
        builder.icmp_signed("==", rows_in, ir.Constant(INT, source.nnz_in())),
        builder.icmp_signed("==", rows_out, ir.Constant(INT, source.nnz_out())),
    )
    lanes = builder.icmp_signed("<=", needed, builder.call(least, [lanes_in, lanes_out]))
    builder.cbranch(builder.and_(rows, builder.and_(lanes, builder.icmp_signed(">=", count, zero))), head, wrong)
    builder.position_at_end(head)
    first = builder.phi(INT)
    left = builder.sub(count, first)
    builder.cbranch(builder.icmp_signed(">", left, zero), work, fine)
    builder.position_at_end(work)
    last = builder.sub(builder.call(least, [left, step]), ir.Constant(INT, 1))
    here, there = (builder.gep(pointer, [first], source_etype=DOUBLE) for pointer in (inputs, outputs))
    builder.call(block, [here, lanes_in, there, lanes_out, last])
    first.add_incoming(zero, entry)
    first.add_incoming(builder.add(first, step), work)
    builder.branch(head)
    for end, status in ((fine, SHAPES_FIT), (wrong, WRONG_SHAPE)):
        builder.position_at_end(end)
        builder.ret(ir.Constant(INT, status))
