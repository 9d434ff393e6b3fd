"""Frozen classes whose arrays stay read-only, also in copies and where they were pickled, and are printed in short."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import wraps
from textwrap import wrap
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from worm3d.values.spelling import Spelled

H = TypeVar("H")
T = TypeVar("T")

LISTED = 3
"""Arrays of so many numbers at most are printed whole."""

COLUMNS, LINES = 110, 5
"""An object is printed on so many lines at most, so wide."""


class ReadOnly(Spelled):
    """Base of frozen dataclasses that hold arrays, or mappings of arrays.

    A dataclass that has a `__post_init__` of its own makes its arrays read-only there; others inherit this one.
    """

    def __init_subclass__(cls) -> None:
        if "__repr__" not in vars(cls):  # or a dataclass would get one that prints every number
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
    """Return a view of an array, or of the arrays of a mapping, that cannot be written to; anything else as it is."""
    if isinstance(value, np.ndarray):
        view = value.view()
        view.setflags(write=False)
        return view
    if isinstance(value, Mapping):
        return MappingProxyType({key: read_only(inner) for key, inner in value.items()})
    return value


def kept(function: Callable[[H], T]) -> Callable[[H], T]:
    """Keep what a function returns of a frozen instance with that instance, as `cached_property` does for a method."""
    name = f"_{function.__name__}"

    @wraps(function)
    def found(of: H) -> T:
        if name not in vars(of):
            vars(of)[name] = function(of)
        value: T = vars(of)[name]
        return value

    return found


def brief(value: Any) -> str:
    """Return a value as it is printed within an object: of long arrays their shape and range only."""
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
    """Return a text on a few lines; what does not fit on them is left out."""
    return "\n".join(
        wrap(text, COLUMNS, subsequent_indent="  ", max_lines=LINES, placeholder=" ...)", break_on_hyphens=False)
    )


def listed(lines: Iterable[str]) -> str:
    """Return lines below one another, each cut where it would be too wide."""
    return "\n".join(line if len(line) <= COLUMNS else f"{line[: COLUMNS - 4]} ..." for line in lines)
