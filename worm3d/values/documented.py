"""Class docstrings with the descriptions of the fields, so that `help` also shows the strings below the fields."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from textwrap import dedent, indent
from typing import Any, TypeVar

T = TypeVar("T")


class _Doc:
    """A docstring that is completed on first access.

    Few docstrings are read, and completing all of them at import would take as long as a short run.
    """

    def __init__(self, described: Callable[[Any], str], text: str) -> None:
        self._described, self._text = described, text

    def __get__(self, instance: object, holder: Any) -> str:
        # Python 3.13 removes the indent of docstrings; earlier versions keep the indent.
        head, raises, rest = inspect.cleandoc(self._text).partition("\n\nRaises\n")
        if lines := self._described(holder):
            head += f"\n\nAttributes\n----------\n{dedent(lines).rstrip()}"
        holder.__doc__ = text = head + raises + rest
        return text


def by(described: Callable[[Any], str]) -> Callable[[type[T]], type[T]]:
    """Return a decorator that adds an Attributes section to the docstring of a class, before the Raises section.

    `described` is a function of the class that returns the lines of the section.
    """

    def decorate(holder: type[T]) -> type[T]:
        holder.__doc__ = _Doc(described, holder.__doc__ or "")  # type: ignore[assignment]
        return holder

    return decorate


@by
def with_fields(holder: Any) -> str:
    """Return the lines of an Attributes section from the strings below the fields of a class."""
    return "".join(f"    {name} : {kind}\n{indent(text, ' ' * 8)}\n" for name, kind, text in _fields(holder))


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
    """Return the statements of each class of a module by name, or an empty dict if the source is not available."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError):
        return {}
    return {each.name: each.body for each in tree.body if isinstance(each, ast.ClassDef)}
