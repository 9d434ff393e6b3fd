"""Symbolic expressions that functions of actuators and laws of friction return: what is wrong with them, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import casadi as ca

ADVICE = (
    "must be a scalar expression; take ca.if_else, ca.fmin and ca.fmax (casadi as ca), not Python's if, min and max or "
    "np.clip"
)
"""What is right, and what to do."""


def answer(of: type, method: str, *given: Any) -> Any:
    """Return what a method of a class returns.

    Raises
    ------
    ValueError
        It raises an error.
    """
    try:
        return getattr(of, method)(*given)
    except Exception as error:
        said = f"{type(error).__name__}: {(str(error).strip().splitlines() or [''])[0]}"
        if "truth value" in said:
            said = "a decision of Python on an expression, of which it is not known yet whether it is true"
        raise ValueError(f"{of.__name__}.{method}: got {said}; {ADVICE}") from error


def scalar(name: str, value: Any) -> ca.SX:
    """Return a scalar expression.

    Raises
    ------
    ValueError
        It is anything else; `name` says what it is.
    """
    import casadi as ca  # loading it takes longer than all else that describes a worm

    try:
        found = ca.SX(value)
    except Exception as error:
        raise ValueError(f"{name}: got {type(value).__name__}, {ADVICE}") from error
    if found.shape != (1, 1):
        raise ValueError(f"{name}: got an array of shape {found.shape}, {ADVICE}")
    return found
