"""Writer of LLVM's intermediate language: straight-line code on vectors of doubles.

Kernels and intrinsics of Numba are written with it. LLVM splits vectors that are longer than the processor's vectors.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir

from worm3d.machine.later import placeholder, utils

LANES = 8
"""Number of doubles in a vector of Numba's intrinsics."""
BYTES = 8
"""Size of a double and of an address in bytes."""
INT, INDEX, BOOL, DOUBLE = ir.IntType(64), ir.IntType(32), ir.IntType(1), ir.DoubleType()


class Writer:
    """Writes instructions at the position of an llvmlite builder. The methods return LLVM values.

    If a block already has the same instruction without side effects, its value is reused, because derivatives repeat
    many subexpressions. Addresses are integers in bytes; offsets from an address are in doubles.

    Parameters
    ----------
    builder : llvmlite.ir.IRBuilder
    width : int
        Number of doubles in a vector.
    flags : sequence of str
        Fast-math flags of the arithmetic, such as "contract".
    """

    def __init__(self, builder: Any, width: int = LANES, flags: Sequence[str] = ()) -> None:
        self.builder, self.width, self.flags = builder, width, tuple(flags)
        self.vector, self.mask = ir.VectorType(DOUBLE, width), ir.VectorType(BOOL, width)
        self._known: dict[Any, Any] = {}
        self._constants: dict[str, Any] = {}
        self._block = builder.block
        self._written = 0

    def once(self, op: str, *args: Any, **given: Any) -> Any:
        """Return the value of the builder's instruction `op`, which is written unless the block already has it."""
        if self.builder.block is not self._block:
            self._known, self._block = {}, self.builder.block
        key = (op, *(tuple(map(_identity, arg)) if isinstance(arg, tuple) else _identity(arg) for arg in args))
        if key not in self._known:
            self._known[key] = getattr(self.builder, op)(*args, name=f"v{self._written}", **given)
            self._written += 1
        return self._known[key]

    def do(self, op: str, *args: Any, **given: Any) -> None:
        """Write an instruction without a result."""
        getattr(self.builder, op)(*args, **given)
        self._written += 1

    def begin(self, block: Any) -> None:
        """Continue at the end of another block."""
        self.builder.position_at_end(block)
        self._written += 1

    def call(self, function: str, result: Any, *args: Any) -> Any:
        """Call a function without side effects of the module, after declaring the function if needed."""
        kind = ir.FunctionType(result, [arg.type for arg in args])
        return self.once("call", utils.get_or_insert_function(self.builder.module, kind, function), args)

    def splat(self, value: float, kind: Any = DOUBLE) -> Any:
        """Return a vector with a constant, a double or an integer, in all lanes."""
        key = f"{kind} {value!r}"
        if key not in self._constants:
            self._constants[key] = ir.Constant(ir.VectorType(kind, self.width), [value] * self.width)
        return self._constants[key]

    def add(self, a: Any, b: Any) -> Any:
        """Return a + b."""
        return self.once("fadd", *sorted((a, b), key=_order), flags=self.flags)

    def sub(self, a: Any, b: Any) -> Any:
        """Return a - b."""
        return self.once("fsub", a, b, flags=self.flags)

    def mul(self, a: Any, b: Any) -> Any:
        """Return a b."""
        return self.once("fmul", *sorted((a, b), key=_order), flags=self.flags)

    def div(self, a: Any, b: Any) -> Any:
        """Return a / b."""
        return self.once("fdiv", a, b, flags=self.flags)

    def neg(self, a: Any) -> Any:
        """Return -a."""
        return self.once("fneg", a, flags=self.flags)

    def compare(self, how: str, a: Any, b: Any) -> Any:
        """Return a mask. `how` is LLVM's condition; for NaN arguments "o.." is false and "u.." is true."""
        return self.once("fcmp_ordered", how, a, b)

    def count(self, value: int) -> Any:
        """Return an integer constant."""
        return self._constants.setdefault(f"i64 {value}", ir.Constant(INT, value))

    def invert(self, mask: Any) -> Any:
        """Return the opposite mask."""
        return self.once("xor", mask, self.splat(True, BOOL))

    def select(self, mask: Any, a: Any, b: Any) -> Any:
        """Return a where the mask is true, and b elsewhere."""
        return self.once("select", mask, a, b)

    def invoke(self, address: Any, result: Any, *args: Any) -> Any:
        """Call the C function at an address."""
        kind = ir.FunctionType(result, [arg.type for arg in args])
        return self.builder.call(self.builder.inttoptr(address, kind.as_pointer()), args)

    def intrinsic(self, name: str, *args: Any) -> Any:
        """Call one of LLVM's own functions of doubles or vectors, such as "sqrt"."""
        kind = args[0].type
        size = f"v{kind.count}f64" if isinstance(kind, ir.VectorType) else "f64"
        return self.call(f"llvm.{name}.{size}", kind, *args)

    def fma(self, x: Any, y: Any, z: Any) -> Any:
        """Return x y + z, rounded once."""
        return self.intrinsic("fma", x, y, z)

    def less(self, value: Any, x: Any, y: Any) -> Any:
        """Return value - x y, rounded once."""
        return self.fma(self.neg(x), y, value)

    def sum(self, xs: Sequence[Any], ys: Sequence[Any]) -> Any:
        """Return the sum of the products of the entries of two lists."""
        value = self.mul(xs[0], ys[0])
        for x, y in zip(xs[1:], ys[1:], strict=True):
            value = self.fma(x, y, value)
        return value

    def less_sum(self, value: Any, xs: Sequence[Any], ys: Sequence[Any]) -> Any:
        """Return a value minus the sum of five products, computed in two chains that do not wait for each other."""
        for x, y in zip(xs[:2], ys[:2], strict=True):
            value = self.less(value, x, y)
        return self.sub(value, self.sum(xs[2:], ys[2:]))

    def horner(self, x: Any, coefficients: Sequence[float]) -> Any:
        """Return a polynomial in x. The coefficients start with the highest power."""
        value = self.splat(coefficients[0])
        for c in coefficients[1:]:
            value = self.fma(value, x, self.splat(c))
        return value

    def size(self, x: Any) -> Any:
        """Return |x|."""
        return self.intrinsic("fabs", x)

    def lanes(self, x: Any, y: Any, lanes: Sequence[int]) -> Any:
        """Return a vector of some lanes of two vectors. Numbers of lanes of y start at the width."""
        return self.builder.shuffle_vector(x, y, ir.Constant(ir.VectorType(INDEX, len(lanes)), list(lanes)))

    def lane(self, x: Any, lane: int) -> Any:
        """Return the number in a lane."""
        return self.once("extract_element", x, ir.Constant(INDEX, lane))

    def exchanged(self, x: Any, y: Any, lane: int) -> Any:
        """Return x with one lane replaced by the lane of y."""
        return self.lanes(x, y, [k + self.width if k == lane else k for k in range(self.width)])

    def spread(self, x: Any, lane: int) -> Any:
        """Return a vector with one lane of x in every lane."""
        return self.lanes(x, x, [lane] * self.width)

    def spread_number(self, number: Any) -> Any:
        """Return a vector with a double or an integer in every lane."""
        empty = ir.Constant(ir.VectorType(number.type, self.width), ir.Undefined)
        one = self.once("insert_element", empty, number, ir.Constant(INDEX, 0))
        return self.once("shuffle_vector", one, empty, ir.Constant(ir.VectorType(INDEX, self.width), None))

    def transposed(self, rows: list[Any]) -> list[Any]:
        """Return the columns of `width` rows. Lanes of rows that are 1, 2, 4, ... apart are exchanged."""
        rows, width = list(rows), self.width
        for apart in (1 << k for k in range(width.bit_length() - 1)):
            low = [lane if not lane & apart else width + lane - apart for lane in range(width)]
            high = [lane + apart if not lane & apart else width + lane for lane in range(width)]
            for k in range(width):
                if not k & apart:
                    x, y = rows[k], rows[k + apart]
                    rows[k], rows[k + apart] = self.lanes(x, y, low), self.lanes(x, y, high)
        return rows

    def shifted(self, address: Any, count: Any, by: Any = 1) -> Any:
        """Return the address `count` times `by` doubles after an address. Both are Python integers or LLVM values."""
        count, by = (ir.Constant(INT, n) if isinstance(n, int) else n for n in (count, by))
        doubles = self.builder.mul(count, self.builder.mul(by, ir.Constant(INT, BYTES)))
        return self.builder.add(address, doubles)

    def pointer(self, address: Any, kind: Any) -> Any:
        """Return an address as a pointer."""
        return self.builder.inttoptr(address, kind.as_pointer())

    def load(self, address: Any, shift: int = 0) -> Any:
        """Return the vector at an address."""
        return self.builder.load(self.pointer(self.shifted(address, shift), self.vector), align=BYTES)

    def store(self, value: Any, address: Any, shift: int = 0) -> None:
        """Write a vector."""
        self.builder.store(value, self.pointer(self.shifted(address, shift), self.vector), align=BYTES)

    def number(self, address: Any, shift: int) -> Any:
        """Return the double at an address."""
        return self.builder.load(self.pointer(self.shifted(address, shift), DOUBLE), align=BYTES)

    def load_some(self, address: Any, count: Any) -> Any:
        """Return a vector of the first `count` doubles at an address, at most `width`, followed by zeros."""
        args = [self.pointer(address, self.vector), ir.Constant(INDEX, BYTES), self._first(count), self.splat(0.0)]
        return self._masked("load", self.vector, args)

    def store_some(self, value: Any, address: Any, count: Any) -> None:
        """Write the first `count` doubles of a vector, at most `width`, to an address."""
        args = [value, self.pointer(address, self.vector), ir.Constant(INDEX, BYTES), self._first(count)]
        self._masked("store", ir.VoidType(), args)

    def _first(self, count: Any) -> Any:
        order = ir.Constant(ir.VectorType(INT, self.width), list(range(self.width)))
        return self.builder.icmp_signed("<", order, self.spread_number(count))

    def _masked(self, what: str, to: Any, args: list[Any]) -> Any:
        kind = ir.FunctionType(to, [arg.type for arg in args])
        name = f"llvm.masked.{what}.v{self.width}f64.p0"
        return self.builder.call(utils.get_or_insert_function(self.builder.module, kind, name), args)


def _identity(arg: Any) -> Any:
    """Return a key that identifies an argument of an instruction. The instruction keeps its arguments alive."""
    return arg if isinstance(arg, str | int | ir.Type) else id(arg)


def _order(value: Any) -> str:
    """Return a key by which the operands of a sum or product are sorted, so that a b and b a are the same key."""
    if isinstance(value, ir.Constant):
        return f"<{value.constant[0]}"
    return f"%{value.name}"


def on_addresses(result: type = int) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that turns a function that writes code into an intrinsic of Numba, for compiled code.

    The function receives a `Writer` and the arguments of the call, which are doubles or integers (addresses, strides,
    counts). It returns the value of the call, which has the type `result`, or None, which stands for 0.
    """

    def make(write: Callable[..., Any]) -> Any:
        return placeholder(lambda: intrinsic(write, result))

    return make


def intrinsic(write: Callable[..., Any], result: type) -> Any:
    """Return the intrinsic of a function that `on_addresses` decorates."""
    from numba import extending
    from numba.core import types

    def generate(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        value = write(Writer(builder), *args)
        return ir.Constant(INT, 0) if value is None else value

    def typed(_context: Any, *args: Any) -> Any:
        kind = types.float64 if result is float else types.int64
        return kind(*(arg if arg == types.float64 else types.int64 for arg in args)), generate

    typed.__name__, typed.__doc__ = write.__name__, write.__doc__
    typed.__signature__ = inspect.signature(write)  # type: ignore[attr-defined]
    return extending.intrinsic(typed)
