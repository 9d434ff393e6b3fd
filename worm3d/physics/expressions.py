"""Checks of the symbolic expressions that user-defined parts, such as actuators, return, with clear error messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import casadi as ca

EXPRESSION_ADVICE = (
    "must be a scalar expression; take ca.if_else, ca.fmin and ca.fmax (casadi as ca), not Python's if, min and max or "
    "np.clip"
)
"""Requirement on an expression, and advice, for error messages."""


def answer(of: type, method: str, *given: Any) -> Any:
    """Return the result of the method named `method` of the class `of`.

    Raises
    ------
    ValueError
        The method raises an error.
    """
    try:
        return getattr(of, method)(*given)
    except Exception as error:
        said = f"{type(error).__name__}: {(str(error).strip().splitlines() or [''])[0]}"
        if "truth value" in said:
            said = "a decision of Python on an expression, of which it is not known yet whether it is true"
        raise ValueError(f"{of.__name__}.{method}: got {said}; {EXPRESSION_ADVICE}") from error


def scalar(name: str, value: Any) -> ca.SX:
    """Return a value as a scalar expression.

    Raises
    ------
    ValueError
        The value is not a scalar expression. `name` describes the value in the message.
    """
    import casadi as ca  # loading casadi takes longer than everything else that describes a worm

    try:
        found = ca.SX(value)
    except Exception as error:
        raise ValueError(f"{name}: got {type(value).__name__}, {EXPRESSION_ADVICE}") from error
    if found.shape != (1, 1):
        raise ValueError(f"{name}: got an array of shape {found.shape}, {EXPRESSION_ADVICE}")
    return found
