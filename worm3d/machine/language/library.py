"""What compiled code may call besides functions of its own: some of Python's and NumPy's functions, and memory."""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from llvmlite import ir

from worm3d.machine.language.values import BOOL, DOUBLE, ELEMENTS, INT, Array, is_known
from worm3d.machine.writer import Writer

LIBRARY: dict[Any, Any] = {}
"""How a call is written, by function: called with the translation and the values of the arguments."""


def _shape(shape: Any) -> tuple[Any, ...]:
    return shape if isinstance(shape, tuple) else (shape,)


def array_at(address: int, shape: Any, dtype: Any = np.float64) -> Any:
    """Return the array that stands at an address, not a copy."""
    raise NotImplementedError("for compiled code")


def _array_at(t: Any, address: Any, shape: Any, dtype: Any = np.float64) -> Array:
    sizes = tuple(t.number(each, INT) for each in _shape(shape))
    return Array(t.builder.inttoptr(t.number(address, INT), ir.PointerType()), sizes, ELEMENTS[np.dtype(dtype).name])


def _empty(t: Any, shape: Any) -> Array:
    """Return an array on the stack, which lasts until the function returns or the loop begins anew."""
    t.stacked = True
    sizes = tuple(t.number(each, INT) for each in _shape(shape))
    count: Any = 1
    for size in sizes:
        count = t.computed(operator.mul, count, size)
    return Array(t.builder.alloca(DOUBLE, t.number(count, INT)), sizes, DOUBLE)


def copied(t: Any, of: Array) -> Array:
    """Return a copy of an array, on the stack."""
    to, size = _empty(t, of.shape), t.number(8)
    for each in of.shape:
        size = t.computed(operator.mul, size, each)
    Writer(t.builder).move(t.builder.ptrtoint(to.pointer, INT), t.builder.ptrtoint(of.pointer, INT), size)
    return to


def _size(t: Any, x: Any) -> Any:
    if is_known(x):
        return abs(x)
    if x.type == DOUBLE:
        return t.intrinsic("fabs", x)
    return t.chosen(">", (x, t.negated(x)))


def _whole(t: Any, x: Any) -> Any:
    if is_known(x):
        return int(x)
    return t.builder.fptosi(x, INT) if x.type == DOUBLE else t.number(x, INT)


def _is_finite(t: Any, x: Any) -> Any:
    return t.compared("<", t.intrinsic("fabs", x), np.inf)


def _sign(t: Any, x: Any) -> Any:
    x = t.number(x, DOUBLE)
    below = t.builder.select(t.compared("<", x, 0.0), t.number(-1.0), x)
    return t.builder.select(t.compared(">", x, 0.0), t.number(1.0), below)


def _divmod(t: Any, x: Any, y: Any) -> tuple[Any, Any]:
    return t.computed(operator.floordiv, x, y), t.computed(operator.mod, x, y)


LIBRARY |= {
    len: lambda t, x: x.shape[0] if isinstance(x, Array) else len(x),
    min: lambda t, *x: t.chosen("<", x),
    max: lambda t, *x: t.chosen(">", x),
    abs: _size,
    int: _whole,
    float: lambda t, x: t.number(x, DOUBLE),
    bool: lambda t, x: t.number(x, BOOL),
    divmod: _divmod,
    np.float64: lambda t, x: t.number(x, DOUBLE),
    np.uint64: _whole,
    np.empty: _empty,
    np.isfinite: _is_finite,
    np.sign: _sign,
    array_at: _array_at,
    **{getattr(np, name): lambda t, x, own=name: t.intrinsic(own, x) for name in ("sqrt", "floor", "ceil", "exp")},
    math.exp: lambda t, x: t.intrinsic("exp", x),
    **{
        getattr(np, name): lambda t, x, own=own: t.library(own, x)
        for name, own in (("arcsin", "asin"), ("tanh", "tanh"), ("expm1", "expm1"))
    },
}
