"""Formulas in scene files: arithmetic and comparisons of named numbers, such as `= 0.1 * worm.segments / 6`."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterator
from typing import Any

from scenes.language.errors import SceneError

FORMULA_MARK = "="
"""First character of a text that is a formula."""
MAX_FORMULA_LENGTH = 200
"""Largest number of characters of a formula."""

_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
ALLOWED = "numbers, names, + - * / **, brackets, and one of < <= > >="


def is_formula(value: object) -> bool:
    """Return whether a value of a scene is a formula: a text that begins with `=`."""
    return isinstance(value, str) and value.lstrip().startswith(FORMULA_MARK)


def names_in(formula: str) -> set[str]:
    """Return the names in a formula; a dotted name is a single name. Raise SceneError if the formula is invalid."""
    return set(_names(_parsed(formula)))


def evaluated(formula: str, value_of: Callable[[str], Any]) -> Any:
    """Return the value of a formula.

    Parameters
    ----------
    formula : str
        The formula, with or without the leading "=".
    value_of : callable
        Function that returns the value of a name. The value is a number or an array; arrays are evaluated by element.

    Raises
    ------
    SceneError
        If the formula is invalid, or has no value, for example because of a division by 0 or a number that is too
        large.
    """
    try:
        value = _value(_parsed(formula), value_of, formula)
    except (ArithmeticError, TypeError) as error:
        raise SceneError(f"formula '{formula.strip()}': has no value: {error}") from error
    if isinstance(value, complex) or (isinstance(value, float) and not math.isfinite(value)):
        raise SceneError(f"formula '{formula.strip()}': has no value: it is no finite number")
    return value


def _parsed(formula: str) -> ast.expr:
    text = formula.strip().removeprefix(FORMULA_MARK).strip()
    if len(text) > MAX_FORMULA_LENGTH:
        raise SceneError(f"formula '{text[:40]}...': {len(text)} characters, at most {MAX_FORMULA_LENGTH} are allowed")
    try:
        return ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise SceneError(f"formula '{formula.strip()}': cannot be read; allowed are {ALLOWED}") from error


def _names(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Name | ast.Attribute):
        yield ast.unparse(node)
    else:
        for inner in ast.iter_child_nodes(node):
            yield from _names(inner)


def _value(node: ast.expr, value_of: Callable[[str], Any], formula: str) -> Any:
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name() | ast.Attribute():
            return value_of(ast.unparse(node))
        case ast.UnaryOp() if type(node.op) in _OPERATORS:
            return _OPERATORS[type(node.op)](_value(node.operand, value_of, formula))
        case ast.BinOp() if type(node.op) in _OPERATORS:
            sides = (_value(side, value_of, formula) for side in (node.left, node.right))
            return _OPERATORS[type(node.op)](*sides)
        case ast.Compare(ops=[relation], comparators=[right]) if type(relation) in _OPERATORS:
            return _OPERATORS[type(relation)](_value(node.left, value_of, formula), _value(right, value_of, formula))
    raise SceneError(f"formula '{formula.strip()}': '{ast.unparse(node)}' is not allowed; allowed are {ALLOWED}")
