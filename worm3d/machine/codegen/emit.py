"""Writes a `Program` as an LLVM module: one function, `SYMBOL`, that loops over the instances, W at a time.

    int64 SYMBOL(const double *inputs, int64 rows_in, int64 lanes_in,
                 double *outputs, int64 rows_out, int64 lanes_out, int64 count)

It returns `FINE` or `WRONG_SHAPE`. Row r of lane k stands at inputs[r lanes_in + k]. In the last block the lanes beyond
`count` compute the last instance again, whatever their memory holds: no traps, denormals or slow paths of their own.
That costs an instruction for every input; where a program is "padded" these lanes compute what their memory holds.
"""

from __future__ import annotations

from collections.abc import Callable

from worm3d.machine.codegen.lanes import LIBRARY, definitions
from worm3d.machine.codegen.program import Instruction, Program, UnsupportedError
from worm3d.machine.codegen.text import Writer

SYMBOL = "worm3d_kernel"
FINE, WRONG_SHAPE = 0, 1
FLAGS = "contract arcp"
LARGEST_POWER = 16
"""Whole powers up to this are multiplied out."""


class Slot:
    """What a slot of the work vector holds: a number, a truth value, or both, written only when asked for."""

    def __init__(self, w: Writer, number: str = "", mask: str = "", constant: float | None = None) -> None:
        self._w, self._number, self._mask, self.constant = w, number, mask, constant

    def number(self) -> str:
        """Return the value; 1 and 0 for true and false."""
        if not self._number:
            self._number = self._w.select(self._mask, self._w.splat(1.0), self._w.splat(0.0))
        return self._number

    def mask(self) -> str:
        """Return where it is not zero; NaN counts as true, as in C."""
        if not self._mask:
            self._mask = self._w.compare("une", self._number, self._w.splat(0.0))
        return self._mask


Rule = Callable[[Writer, list[Slot]], str]


def _numbers(rule: Callable[..., str]) -> Rule:
    return lambda w, args: rule(w, *(a.number() for a in args))


def _sign(w: Writer, x: str) -> str:
    """-1, 1, or x itself, which is 0 or NaN."""
    zero = w.splat(0.0)
    positive = w.select(w.compare("ogt", x, zero), w.splat(1.0), x)
    return w.select(w.compare("olt", x, zero), w.splat(-1.0), positive)


def _power(w: Writer, args: list[Slot]) -> str:
    """x^n by multiplication for small whole n, by the C library otherwise."""
    exponent = args[1].constant
    if exponent is None or not abs(exponent) <= LARGEST_POWER or exponent != int(exponent):
        return w.lanes("pow", args[0].number(), args[1].number())
    value = _whole_power(w, args[0].number(), abs(int(exponent)))
    return w.div(w.splat(1.0), value) if exponent < 0.0 else value


def _whole_power(w: Writer, x: str, n: int) -> str:
    if n == 0:
        return w.splat(1.0)
    half = _whole_power(w, x, n // 2)
    square = w.mul(half, half) if n > 1 else half
    if n == 1:
        return x
    return w.mul(square, x) if n % 2 else square


NUMBERS: dict[str, Rule] = {
    "assign": lambda w, args: args[0].number(),
    "lift": lambda w, args: args[0].number(),
    "add": _numbers(Writer.add),
    "sub": _numbers(Writer.sub),
    "mul": _numbers(Writer.mul),
    "div": _numbers(Writer.div),
    "neg": _numbers(Writer.neg),
    "sq": _numbers(lambda w, x: w.mul(x, x)),
    "twice": _numbers(lambda w, x: w.add(x, x)),
    "inv": _numbers(lambda w, x: w.div(w.splat(1.0), x)),
    "sign": _numbers(_sign),
    "sqrt": _numbers(lambda w, x: w.intrinsic("sqrt", x)),
    "fabs": _numbers(lambda w, x: w.intrinsic("fabs", x)),
    "floor": _numbers(lambda w, x: w.intrinsic("floor", x)),
    "ceil": _numbers(lambda w, x: w.intrinsic("ceil", x)),
    "fmin": _numbers(lambda w, x, y: w.intrinsic("minnum", x, y)),
    "fmax": _numbers(lambda w, x, y: w.intrinsic("maxnum", x, y)),
    "copysign": _numbers(lambda w, x, y: w.intrinsic("copysign", x, y)),
    "sin": _numbers(lambda w, x: w.sincos(x)[0]),
    "cos": _numbers(lambda w, x: w.sincos(x)[1]),
    "pow": _power,
    "constpow": _power,
    "if_else_zero": lambda w, args: w.select(args[0].mask(), args[1].number(), w.splat(0.0)),
}
MASKS: dict[str, Rule] = {
    "lt": _numbers(lambda w, x, y: w.compare("olt", x, y)),
    "le": _numbers(lambda w, x, y: w.compare("ole", x, y)),
    "eq": _numbers(lambda w, x, y: w.compare("oeq", x, y)),
    "ne": _numbers(lambda w, x, y: w.compare("une", x, y)),
    "not": lambda w, args: w.invert(args[0].mask()),
    "and": lambda w, args: w.logic("and", args[0].mask(), args[1].mask()),
    "or": lambda w, args: w.logic("or", args[0].mask(), args[1].mask()),
}
SUPPORTED = {"input", "output", "const", *NUMBERS, *MASKS, *LIBRARY}
"""CasADi's operations that a kernel may contain."""


def module(program: Program, width: int, fused: bool, flags: str = FLAGS, padded: bool = False) -> str:
    """Return the module's text for vectors of `width` doubles, with or without fused multiply-add.

    Raises
    ------
    UnsupportedError
        If an operation has no rule here.
    """
    body = Writer(width, flags)
    _block(body, program)
    return "\n".join([definitions(body.calls, width, fused), _driver(program, width), _block_function(body, padded)])


def _block(w: Writer, program: Program) -> None:
    slots: dict[int, Slot] = {}
    for instruction in program.instructions:
        if instruction.name == "output":
            value, place = slots[instruction.args[0]].number(), _row(w, "out", instruction.out)
            w.do(f"store {w.vector} {value}, ptr {place}, align 8")
        else:
            slots[instruction.out] = _slot(w, program, instruction, slots)


def _slot(w: Writer, program: Program, instruction: Instruction, slots: dict[int, Slot]) -> Slot:
    name, args = instruction.name, instruction.args
    if name == "input":
        return Slot(w, number=_load(w, args[0]))
    if name == "const":
        return Slot(w, number=w.splat(instruction.constant), constant=instruction.constant)
    values = [slots[a] for a in args]
    if name in NUMBERS:
        return Slot(w, number=NUMBERS[name](w, values))
    if name in MASKS:
        return Slot(w, mask=MASKS[name](w, values))
    if name in LIBRARY:
        return Slot(w, number=w.lanes(name, *(v.number() for v in values)))
    raise UnsupportedError(
        f"kernel {program.name!r}: the operation {name!r} has no native form; "
        f"write it with {', '.join(sorted(SUPPORTED))}, or ask for backend='casadi'"
    )


def _row(w: Writer, side: str, row: int) -> str:
    offset = w.new(f"mul i64 %stride_{side}, {row}")
    return w.new(f"getelementptr double, ptr %{side}, i64 {offset}")


def _load(w: Writer, row: int) -> str:
    """Load a row of the inputs, with the last instance also in the lanes beyond it."""
    place = _row(w, "in", row)
    values = w.new(f"load {w.vector}, ptr {place}, align 8")
    last = w.new(f"load double, ptr {w.new(f'getelementptr double, ptr {place}, i64 %last')}, align 8")
    one = w.new(f"insertelement {w.vector} poison, double {last}, i32 0")
    spread = w.new(f"shufflevector {w.vector} {one}, {w.vector} poison, <{w.width} x i32> zeroinitializer")
    return w.select("%valid", values, spread)


def _block_function(w: Writer, padded: bool) -> str:
    """`block`: W instances; %last is the index of the last valid lane."""
    indices = ", ".join(f"i32 {lane}" for lane in range(w.width))
    last = "zeroinitializer" if padded else "%last_all"
    order = "uge" if padded else "ule"
    return f"""
define internal void @block(ptr noalias %in, i64 %stride_in, ptr noalias %out, i64 %stride_out, i64 %last)
noinline nounwind {{
  %last32 = trunc i64 %last to i32
  %last_one = insertelement <{w.width} x i32> poison, i32 %last32, i32 0
  %last_all = shufflevector <{w.width} x i32> %last_one, <{w.width} x i32> poison, <{w.width} x i32> zeroinitializer
  %valid = icmp {order} <{w.width} x i32> <{indices}>, {last}
{w.body()}
  ret void
}}
"""


def _driver(program: Program, width: int) -> str:
    """`SYMBOL`: checks the shapes and calls `block` for W instances after W."""
    return f"""
define i64 @{SYMBOL}(ptr %in, i64 %rows_in, i64 %lanes_in, ptr %out, i64 %rows_out, i64 %lanes_out, i64 %count)
nounwind {{
entry:
  %in_rows_right = icmp eq i64 %rows_in, {program.rows_in}
  %out_rows_right = icmp eq i64 %rows_out, {program.rows_out}
  %lanes = call i64 @llvm.smin.i64(i64 %lanes_in, i64 %lanes_out)
  %rounded_up = add i64 %count, {width - 1}
  %needed = and i64 %rounded_up, -{width}
  %room = icmp sle i64 %needed, %lanes
  %sign = icmp sge i64 %count, 0
  %rows_right = and i1 %in_rows_right, %out_rows_right
  %count_right = and i1 %room, %sign
  %right = and i1 %rows_right, %count_right
  br i1 %right, label %next, label %wrong
next:
  %first = phi i64 [ 0, %entry ], [ %after, %work ]
  %left = sub i64 %count, %first
  %more = icmp sgt i64 %left, 0
  br i1 %more, label %work, label %fine
work:
  %lanes_left = call i64 @llvm.smin.i64(i64 %left, i64 {width})
  %last = sub i64 %lanes_left, 1
  %in_here = getelementptr double, ptr %in, i64 %first
  %out_here = getelementptr double, ptr %out, i64 %first
  call void @block(ptr %in_here, i64 %lanes_in, ptr %out_here, i64 %lanes_out, i64 %last)
  %after = add i64 %first, {width}
  br label %next
fine:
  ret i64 {FINE}
wrong:
  ret i64 {WRONG_SHAPE}
}}
"""
