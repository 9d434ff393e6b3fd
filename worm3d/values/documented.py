"""Docstrings of classes completed by what stands below their fields, so that `help` shows it."""

from __future__ import annotations

import ast
import inspect
import sys
from functools import cache
from itertools import pairwise
from textwrap import indent
from typing import TypeVar

T = TypeVar("T")


def with_fields(holder: type[T]) -> type[T]:
    """Write the strings below the fields of a class into its docstring, before the section Raises if it has one."""
    head, raises, rest = (holder.__doc__ or "").partition("    Raises\n")
    lines = [f"    {name} : {kind}\n{indent(text, ' ' * 8)}\n" for name, kind, text in _fields(holder)]
    if lines:
        gap = "\n" if raises else "    "
        holder.__doc__ = f"{head.rstrip()}\n\n    Attributes\n    ----------\n{''.join(lines)}{gap}{raises}{rest}"
    return holder


def _fields(holder: type) -> list[tuple[str, str, str]]:
    """Return name, type and meaning of each field that has a string below it."""
    found = []
    body = _classes(holder.__module__).get(holder.__name__, [])
    for field, below in pairwise(body):
        if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            meaning = inspect.cleandoc(str(below.value.value))
            found.append((ast.unparse(field.target), ast.unparse(field.annotation), meaning))
    return found


@cache
def _classes(module: str) -> dict[str, list[ast.stmt]]:
    """Return the statements of each class of a module; none where its source is not there."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError):
        return {}
    return {each.name: each.body for each in tree.body if isinstance(each, ast.ClassDef)}
