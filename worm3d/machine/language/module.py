"""The module of a compiled function: its translation, and the C function around it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from llvmlite import ir

from worm3d.machine.codegen.emit import SYMBOL
from worm3d.machine.language.translate import Unit, fitted
from worm3d.machine.language.values import BOOL, DOUBLE, ELEMENTS, INT, Arithmetic, Array, grouped, numbers_of


class _Shell(Arithmetic):
    def __init__(self, builder: Any) -> None:
        self.builder = builder


def module_of(function: Any, args: Any) -> str:
    """Return the text of a module with `SYMBOL`, the function for arguments of such structure.

    Numbers are handed over one by one, arrays as their address and sizes; several results are written, 8 bytes each, to
    an address that comes last.
    """
    unit = Unit()
    kinds = [kind for arg in args for kind in _kinds(arg)]
    inner = _inner(unit, function, args, kinds)
    numbers = list(numbers_of(inner[1]))
    several = len(numbers) > 1
    kind = ir.VoidType() if several or not numbers else INT if numbers[0].type == BOOL else numbers[0].type
    outer = ir.Function(unit.module, ir.FunctionType(kind, kinds + [INT] * several), SYMBOL)
    builder = ir.IRBuilder(outer.append_basic_block())
    shell = _Shell(builder)
    values = _values(shell, function, args, iter(outer.args))
    found = builder.call(inner[0], list(numbers_of(tuple(values))))
    if several:
        to = builder.inttoptr(outer.args[-1], ir.PointerType())
        for k in range(len(numbers)):
            value = builder.extract_value(found, k)
            value = shell.number(value, INT) if value.type == BOOL else value
            builder.store(value, builder.gep(to, [ir.Constant(INT, k)], source_etype=INT))
        builder.ret_void()
    elif numbers:
        builder.ret(shell.number(found, kind))
    else:
        builder.ret_void()
    return str(unit.module)


def _inner(unit: Unit, function: Any, args: Any, kinds: list[Any]) -> tuple[Any, Any]:
    """Return the translated function, and a value of the structure of its result."""
    probe = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), kinds), "probe")
    values = _values(_Shell(ir.IRBuilder(probe.append_basic_block())), function, args, iter(probe.args))
    return unit.made(function, values)


def _values(shell: _Shell, function: Any, args: Any, numbers: Iterator[Any]) -> list[Any]:
    from typing import get_type_hints

    hints = get_type_hints(function)
    names = function.__code__.co_varnames
    return [fitted(shell, _value(shell, arg, numbers), hints.get(name)) for arg, name in zip(args, names, strict=False)]


def _value(shell: _Shell, arg: Any, numbers: Iterator[Any]) -> Any:
    if isinstance(arg, np.ndarray):
        place = shell.builder.inttoptr(next(numbers), ir.PointerType())
        return Array(place, tuple(next(numbers) for _ in arg.shape), ELEMENTS[arg.dtype.name])
    if isinstance(arg, tuple):
        return grouped(arg, [_value(shell, each, numbers) for each in arg])
    return next(numbers)


def _kinds(arg: Any) -> Iterator[Any]:
    if isinstance(arg, np.ndarray):
        yield from [INT] * (1 + arg.ndim)
    elif isinstance(arg, tuple):
        for each in arg:
            yield from _kinds(each)
    else:
        yield DOUBLE if isinstance(arg, float) else INT
