"""Base of frozen classes with read-only arrays. The arrays are read-only in copies and after pickling, too.

Objects of these classes are printed in a short form.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import wraps
from textwrap import fill
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from worm3d.values.spelling import Spelled

H = TypeVar("H")
T = TypeVar("T")

LISTED = 3
"""Largest number of values of an array that is printed completely."""

PRINTED_COLUMNS, PRINTED_LINES = 110, 5
"""Largest width and largest number of lines of a printed object."""


class ReadOnly(Spelled):
    """Base of frozen dataclasses with arrays, or mappings of arrays, as fields.

    The inherited `__post_init__` makes the arrays read-only. A dataclass with its own `__post_init__` has to
    make its arrays read-only in this method.
    """

    def __init_subclass__(cls) -> None:
        if "__repr__" not in vars(cls):  # otherwise the dataclass would print every number
            cls.__repr__ = ReadOnly.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        shown = (f"{each.name}={brief(getattr(self, each.name))}" for each in fields(self) if each.repr)  # type: ignore[arg-type]
        return paragraph(f"{type(self).__name__}({', '.join(shown)})")

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            object.__setattr__(self, name, read_only(value))

    def __getstate__(self) -> dict[str, Any]:
        return {name: dict(v) if isinstance(v, MappingProxyType) else v for name, v in vars(self).items()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, read_only(value))


def read_only(value: Any) -> Any:
    """Return a read-only view of an array, or of the arrays of a mapping. Any other value is returned unchanged."""
    if isinstance(value, np.ndarray):
        view = value.view()
        view.setflags(write=False)
        return view
    if isinstance(value, Mapping):
        return MappingProxyType({key: read_only(inner) for key, inner in value.items()})
    return value


def kept(function: Callable[[H], T]) -> Callable[[H], T]:
    """Make a function store its result in its argument, a frozen object, so that it is computed only once."""
    name = f"_{function.__name__}"

    @wraps(function)
    def found(of: H) -> T:
        if name not in vars(of):
            vars(of)[name] = function(of)
        value: T = vars(of)[name]
        return value

    return found


def brief(value: Any) -> str:
    """Return a value as text within a printed object. For long arrays, the text has only the shape and the range."""
    if isinstance(value, np.ndarray):
        return _brief_array(value)
    if isinstance(value, Mapping):
        return f"{{{', '.join(map(str, value))}}}"
    if isinstance(value, tuple | list) and len(value) > LISTED:
        return f"<{len(value)} of {type(value[0]).__name__}>"
    return " ".join(repr(value).split())


def _brief_array(array: np.ndarray[Any, Any]) -> str:
    if array.size <= LISTED:
        return repr(array.tolist())
    shape = " x ".join(map(str, array.shape))
    if array.dtype.kind not in "fiub":
        return f"<{shape} of {array.dtype}>"
    low, high = array.min(), array.max()
    return f"<{shape} of {low:g}>" if low == high else f"<{shape} from {low:g} to {high:g}>"


def paragraph(text: str) -> str:
    """Return a text wrapped to at most `PRINTED_LINES` lines. The rest of the text is left out."""
    return fill(
        text,
        PRINTED_COLUMNS,
        subsequent_indent="  ",
        max_lines=PRINTED_LINES,
        placeholder=" ...)",
        break_on_hyphens=False,
    )


def listed(lines: Iterable[str]) -> str:
    """Return the lines as a text. Lines that are too wide are cut."""
    return "\n".join(line if len(line) <= PRINTED_COLUMNS else f"{line[: PRINTED_COLUMNS - 4]} ..." for line in lines)
