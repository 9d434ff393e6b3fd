"""Values of compiled code: numbers, arrays of them, and groups of both; what may be done with numbers.

Whatever is known when code is translated stays what it is in Python, and is computed there; it becomes a number of
compiled code where it meets one. Numbers are truth values, whole numbers (64 bits) and doubles; arrays may also hold
whole numbers and floating-point numbers of 32 bits, which are read as long ones. Groups are tuples, named or not.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir

BOOL, INT, DOUBLE = ir.IntType(1), ir.IntType(64), ir.DoubleType()
ELEMENTS = {"float64": DOUBLE, "int64": INT, "float32": ir.FloatType(), "int32": ir.IntType(32)}
"""Kind of the elements of an array by the name of NumPy's."""


class TranslationError(TypeError):
    """A function cannot be compiled; the sentence says which line and why."""


class Array(NamedTuple):
    """A C-contiguous array in memory."""

    pointer: Any
    shape: tuple[Any, ...]
    """Whole numbers, of Python or of compiled code."""
    kind: Any
    """Kind of its elements."""


def is_known(value: Any) -> bool:
    """Return whether a value is one of Python, not of compiled code."""
    if isinstance(value, tuple):
        return all(map(is_known, value))
    return not isinstance(value, ir.Value)


def grouped(like: tuple[Any, ...], values: Any) -> Any:
    """Return a group of the same class."""
    return type(like)(*values) if hasattr(like, "_fields") else tuple(values)


def numbers_of(value: Any) -> Iterator[Any]:
    """Yield the numbers and pointers of which a value of compiled code consists."""
    if isinstance(value, Array):
        yield value.pointer
        yield from value.shape
    elif isinstance(value, tuple):
        for each in value:
            yield from numbers_of(each)
    elif value is not None:
        yield value


def rebuilt(like: Any, numbers: Iterator[Any]) -> Any:
    """Return a value of the same structure with other numbers."""
    if isinstance(like, Array):
        return Array(next(numbers), tuple(next(numbers) for _ in like.shape), like.kind)
    if isinstance(like, tuple):
        return grouped(like, [rebuilt(each, numbers) for each in like])
    return None if like is None else next(numbers)


def structure(value: Any) -> Any:
    """Return what values of the same structure have in common."""
    if isinstance(value, Array):
        return "array", str(value.kind), len(value.shape)
    if isinstance(value, tuple):
        return type(value), *map(structure, value)
    return str(value.type) if value is not None else None


def kind_of(hint: Any) -> Any:
    """Return the kind of number that an annotation names, None for another one."""
    return {float: DOUBLE, int: INT, bool: BOOL}.get(hint)


class Arithmetic:
    """Writes what is done with numbers where a builder of llvmlite stands."""

    builder: Any

    def number(self, value: Any, kind: Any = None) -> Any:
        """Return a number, Python's too, as one of compiled code, of this kind if one is given."""
        if isinstance(value, bool | np.bool_):
            value = ir.Constant(BOOL, bool(value))
        elif isinstance(value, int | np.integer):
            value = ir.Constant(INT, int(value))
        elif isinstance(value, float | np.floating):
            value = ir.Constant(DOUBLE, float(value))
        elif not isinstance(value, ir.Value):
            raise TranslationError(f"got {type(value).__name__}, must be a number")
        return value if kind is None or value.type == kind else self._converted(value, kind)

    def _converted(self, value: Any, kind: Any) -> Any:
        b, old = self.builder, value.type
        if isinstance(old, ir.IntType) and isinstance(kind, ir.IntType):
            if kind == BOOL:
                return b.icmp_signed("!=", value, ir.Constant(old, 0))
            return (b.zext if old == BOOL else b.sext)(value, kind) if kind.width > old.width else b.trunc(value, kind)
        if isinstance(old, ir.IntType):
            return (b.uitofp if old == BOOL else b.sitofp)(value, kind)
        if kind == BOOL:
            return b.fcmp_unordered("!=", value, ir.Constant(old, 0.0))
        if isinstance(kind, ir.IntType):
            raise TranslationError("got a double, must be a whole number: use int()")
        return b.fpext(value, kind) if kind == DOUBLE else b.fptrunc(value, kind)

    def alike(self, *values: Any, at_least: Any = BOOL) -> list[Any]:
        """Return numbers of the same kind, the widest among them."""
        found = [self.number(value) for value in values]
        order = [BOOL, INT, DOUBLE]
        kind = max([at_least, *(value.type for value in found)], key=order.index)
        return [self.number(value, kind) for value in found]

    def compared(self, how: str, x: Any, y: Any) -> Any:
        """Return the truth value of a comparison, "==", "<" and so on; of NaN only "!=" is true."""
        x, y = self.alike(x, y, at_least=INT)
        if x.type == INT:
            return self.builder.icmp_signed(how, x, y)
        return (self.builder.fcmp_unordered if how == "!=" else self.builder.fcmp_ordered)(how, x, y)

    def computed(self, op: Any, x: Any, y: Any) -> Any:
        """Return x op y, `op` being one of `OPERATIONS`."""
        if is_known(x) and is_known(y):
            return op(x, y)
        if op is operator.pow:
            return self._power(x, y)
        x, y = self.alike(x, y, at_least=DOUBLE if op is operator.truediv else INT)
        whole, floating = OPERATIONS[op]
        if x.type == INT and whole is not None:
            return whole(self.builder, x, y)
        if x.type == DOUBLE and floating is not None:
            return floating(self.builder, x, y)
        raise TranslationError(f"{op.__name__} of these numbers is not known")

    def _power(self, x: Any, n: Any) -> Any:
        if not (isinstance(n, int) and 1 <= n <= 4):
            raise TranslationError("an exponent must be a whole number from 1 to 4")
        half = x if n == 1 else self.computed(operator.mul, x, x)
        if n == 4:
            return self.computed(operator.mul, half, half)
        return self.computed(operator.mul, half, x) if n == 3 else half

    def negated(self, x: Any) -> Any:
        """Return -x."""
        if is_known(x):
            return -x
        (x,) = self.alike(x, at_least=INT)
        return self.builder.neg(x) if x.type == INT else self.builder.fneg(x)

    def intrinsic(self, name: str, x: Any) -> Any:
        """Return one of LLVM's own functions of a double, as "sqrt"."""
        return self.library(f"llvm.{name}.f64", x)

    def library(self, name: str, x: Any) -> Any:
        """Return a function of a double, by its name in C."""
        known = self.builder.module.globals
        function = known.get(name) or ir.Function(self.builder.module, ir.FunctionType(DOUBLE, [DOUBLE]), name)
        return self.builder.call(function, [self.number(x, DOUBLE)])

    def chosen(self, how: str, values: tuple[Any, ...]) -> Any:
        """Return the least or greatest of numbers as Python does: a later one where it is beyond those before."""
        if is_known(values):
            return {"<": min, ">": max}[how](values)
        found, *others = self.alike(*values, at_least=INT)
        for other in others:
            found = self.builder.select(self.compared(how, other, found), other, found)
        return found


def _floored(b: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """Return quotient and remainder of whole numbers, rounded down."""
    zero, rest = ir.Constant(INT, 0), b.srem(x, y)
    below = b.and_(b.icmp_signed("!=", rest, zero), b.icmp_signed("<", b.xor(rest, y), zero))
    return b.sub(b.sdiv(x, y), b.zext(below, INT)), b.add(rest, b.select(below, y, zero))


Operation = Callable[[Any, Any, Any], Any] | None
OPERATIONS: dict[Any, tuple[Operation, Operation]] = {
    operator.add: (lambda b, x, y: b.add(x, y), lambda b, x, y: b.fadd(x, y)),
    operator.sub: (lambda b, x, y: b.sub(x, y), lambda b, x, y: b.fsub(x, y)),
    operator.mul: (lambda b, x, y: b.mul(x, y), lambda b, x, y: b.fmul(x, y)),
    operator.truediv: (None, lambda b, x, y: b.fdiv(x, y)),
    operator.floordiv: (lambda b, x, y: _floored(b, x, y)[0], None),
    operator.mod: (lambda b, x, y: _floored(b, x, y)[1], None),
    operator.lshift: (lambda b, x, y: b.shl(x, y), None),
    operator.or_: (lambda b, x, y: b.or_(x, y), None),
    operator.and_: (lambda b, x, y: b.and_(x, y), None),
}
"""How operations are written for whole numbers and for doubles."""
