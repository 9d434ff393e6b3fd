"""Checks of user input. The error messages name the argument, the value received and the allowed values.

Each check returns the value in the type that the rest of the program needs. There are no silent conversions. For
example, True, "1" and an array with a single number are not accepted as numbers. Every check raises ValueError for any
wrong value.
"""

from __future__ import annotations

import operator
from math import isfinite
from typing import Any, TypedDict, TypeVar, Unpack

import numpy as np

from worm3d.values.arrays import FloatArray

T = TypeVar("T")

MAX_MAGNITUDE = 1e12
"""Largest absolute value of a number in SI units. A number that must be above 0 must be at least the inverse of this
value, so that cubes of numbers stay finite."""

MOST_MEMORY = 4e9
"""Largest memory that a run, a grid or a table may need [byte]."""


class Bounds(TypedDict, total=False):
    """Range of a number: greater than (gt), at least (ge), less than (lt), at most (le). Each bound is optional."""

    gt: float
    ge: float
    lt: float
    le: float


def number(
    name: str,
    value: Any,
    unit: str = "",
    *,
    infinite: bool = False,
    largest: float = MAX_MAGNITUDE,
    allowed: str = "",
    **bounds: Unpack[Bounds],
) -> float:
    """Return a real number within a range.

    The number must be finite. If `infinite` is True, it may also be positive infinity. Its absolute value must not be
    above `largest`. If it has to be above 0, it must not be below 1 / `largest`. `allowed` describes the range in the
    error message.
    """
    found = _real(value)
    if found is None or not _within(found, bounds) or not (isfinite(found) or (infinite and found > 0.0)):
        right = allowed or range_text(infinite, **bounds)
    elif isfinite(found) and not _of_a_likely_size(found, bounds, largest):
        right = f"of a size {_likely(largest)}"
    else:
        return found
    raise ValueError(f"{name}: got {shown(value)}{f' {unit}' if unit else ''}, must be {right}")


def whole(name: str, value: Any, ge: int = 1, le: int = 2**63 - 1) -> int:
    """Return a whole number from `ge` to `le`."""
    right = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (right and ge <= value <= le):
        most = f" and at most {le}" if right and value > le else ""
        raise ValueError(f"{name}: got {shown(value)}, must be a whole number of at least {ge}{most}")
    return int(value)


def flag(name: str, value: Any) -> bool:
    """Return True or False."""
    if not isinstance(value, bool | np.bool_ | np.ndarray) or np.shape(value) or np.asarray(value).dtype != bool:
        raise ValueError(f"{name}: got {shown(value)}, must be True or False")
    return bool(value)


def choice(name: str, value: Any, allowed: tuple[str, ...]) -> str:
    """Return the value if it is one of the allowed words."""
    if not (isinstance(value, str) and value in allowed):
        words = " or ".join(map(repr, allowed)) if len(allowed) == 2 else f"one of {', '.join(map(repr, allowed))}"
        raise ValueError(f"{name}: got {shown(value)}, must be {words}")
    return value


def instance(name: str, value: T, kind: Any, what: str) -> T:
    """Return the value if it is an instance of `kind`. `what` describes such an object in the error message."""
    if not isinstance(value, kind):
        raise ValueError(f"{name}: got {_type_of(value)}, must be {what}")
    return value


def function(name: str, value: T, what: str = "a function of time") -> T:
    """Return the value if it is a function or another callable object, but not a class."""
    if not callable(value) or isinstance(value, type):
        raise ValueError(f"{name}: got {_type_of(value)}, must be {what}")
    return value


def array(
    name: str, value: Any, shape: tuple[int | str, ...], *, least: int = 1, fill: bool = False, **bounds: Unpack[Bounds]
) -> FloatArray:
    """Return a read-only copy of an array of finite numbers within a range.

    A letter among the sizes in `shape` means any size of at least `least`. If `fill` is True, the value may also be a
    single number for all elements.
    """
    found = floats(name, value)
    if found.ndim == 0 and fill:
        found = np.full([int(size) for size in shape], float(found))
    elif fill and len(shape) == 1:
        require_count(name, found, int(shape[0]))
    if found.shape != shape and not _fits(found.shape, shape, least):
        or_a_number = " (or a number)" if fill else ""
        raise ValueError(f"{name}: got shape {found.shape}, must be {_shape(shape, least)}{or_a_number}")
    if bounds or not (np.abs(found) <= MAX_MAGNITUDE).all():  # the usual case is quick
        with np.errstate(invalid="ignore"):
            right = np.isfinite(found) & _within(found, bounds)
        likely = _of_a_likely_size(found, bounds)
        for good, allowed in ((right, range_text(**bounds)), (likely, f"of a size {_likely(MAX_MAGNITUDE)}")):
            if not good.all():
                raise ValueError(f"{name}: got {float(found[~good][0])!r}, every value must be {allowed}")
    found.setflags(write=False)
    return found


def one_or_each(name: str, value: Any, form: str, depth: int = 1, **bounds: Unpack[Bounds]) -> FloatArray:
    """Return a read-only copy of a number, or of an array of at most `depth` dimensions.

    If `depth` is at least 2 and the array has `depth` dimensions, the second dimension must have the size 2, for left
    and right. `form` describes the allowed arrays in the error message. The sizes of other dimensions are not checked
    here.
    """
    found = floats(name, value)
    with np.errstate(invalid="ignore"):
        right = np.isfinite(found) & _within(found, bounds) & _of_a_likely_size(found, bounds)
    of_pairs = found.ndim == depth > 1
    if found.ndim > depth or found.size == 0 or not right.all() or (of_pairs and found.shape[1] != 2):
        raise ValueError(f"{name}: got {shown(value)}, must be {range_text(**bounds)}, {form}")
    found.setflags(write=False)
    return found


def require_count(name: str, value: Any, count: int) -> None:
    """Raise ValueError if the value is neither a single number nor an array of shape (count,)."""
    if np.ndim(value) > 0 and np.shape(value) != (count,):
        raise ValueError(f"{name}: got {np.size(value)} values, must be a number or {count} of them")


def floats(name: str, value: Any) -> FloatArray:
    """Return numbers as a new array. The shape is arbitrary, and the numbers may be infinite or NaN."""
    try:
        given = np.asarray(value)
    except Exception as error:  # lists of unequal length, and whatever an object's own conversion raises
        raise ValueError(f"{name}: got {_type_of(value)}, must be numbers, in lists of equal length") from error
    if given.dtype.kind not in "iuf":
        raise ValueError(f"{name}: got {shown(value)}, must be numbers")
    return np.array(given, dtype=np.float64)


def shown(value: Any) -> str:
    """Return a value as text for an error message, on a single line of at most 80 characters."""
    if isinstance(value, np.ndarray) and value.size > 6:
        return f"an array of shape {value.shape}"
    try:
        text = " ".join(repr(value.tolist() if isinstance(value, np.ndarray | np.generic) else value).split())
    except Exception:  # an object's own repr, or an integer of more digits than Python prints
        return _type_of(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def bytes_of_run(segments: int, steps: float, every: int) -> float:
    """Return an estimate of the largest memory of a run, including writing the result to disc [byte].

    Each step and each row of the result needs memory. The estimate is 1.5 times the measured memory.
    """
    return steps * (250.0 + (1000.0 + 2100.0 * segments) / every)


def require_room(name: str, needed: float, what: str, remedy: str) -> None:
    """Raise ValueError if `needed` bytes would not fit into memory."""
    if not needed <= MOST_MEMORY:
        raise ValueError(
            f"{name}: got {what}, about {needed / 1e9:.3g} GB of memory, must be at most {MOST_MEMORY / 1e9:g} GB; "
            f"use {remedy}"
        )


def _real(value: Any) -> float | None:
    """Return a number as a float, or None if the value is not a number."""
    if isinstance(value, np.ndarray) and value.shape == () and value.dtype.kind in "iuf":
        return float(value)
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return None
    try:
        return float(value)
    except OverflowError:
        return None


def _within(value: Any, bounds: Bounds) -> Any:
    inside = value == value  # False for NaN
    for relation, bound in bounds.items():
        inside = inside & getattr(operator, relation)(value, bound)
    return inside


def _of_a_likely_size(value: Any, bounds: Bounds, largest: float = MAX_MAGNITUDE) -> Any:
    size = abs(value)
    return (size <= largest) & (size >= (1.0 / largest if bounds.get("gt") == 0.0 else 0.0))


def _likely(largest: float) -> str:
    return f"between {1.0 / largest:g} and {largest:g}"


def range_text(infinite: bool = False, **bounds: Unpack[Bounds]) -> str:
    """Return a range in words, for example "finite and above 0" or "finite and in [0, 1)"."""
    finite, gt, lt = "" if infinite else "finite", bounds.get("gt"), bounds.get("lt")
    low, high = bounds.get("ge", gt), bounds.get("le", lt)
    if low is not None and high is not None:
        within = f"in {'[' if gt is None else '('}{low:g}, {high:g}{']' if lt is None else ')'}"
    elif low is not None:
        within = f"{'at least' if gt is None else 'above'} {low:g}"
    elif high is not None:
        within = f"{'at most' if lt is None else 'below'} {high:g}"
    else:
        within = ""
    return " and ".join(filter(None, (finite, within))) or "a number"


def _fits(found: tuple[int, ...], shape: tuple[int | str, ...], least: int) -> bool:
    sizes = zip(found, shape, strict=False)
    return len(found) == len(shape) and all(n == m if isinstance(m, int) else n >= least for n, m in sizes)


def _shape(shape: tuple[int | str, ...], least: int) -> str:
    sizes = ", ".join(map(str, shape))
    free = [str(size) for size in shape if isinstance(size, str)]
    many = f" with {' and '.join(free)} of at least {least}" if free else ""
    return f"({sizes}{',' if len(shape) == 1 else ''}){many}"


def _type_of(value: Any) -> str:
    return f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__
