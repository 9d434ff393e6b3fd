"""Conversion of the data of a scene to sections. Each value is checked against the type of its key.

All errors are collected. Unknown keys are errors. Values are not converted to other types; for example, the values true
and "1" are not accepted as numbers, and 1 is not accepted as true. There are two exceptions. A whole number is accepted
for a real number, and a list becomes a tuple, so that a scene cannot be changed.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping
from types import NoneType
from typing import Any, Literal, NamedTuple, TypeVar, get_args, get_origin

from scenes.language.schema import Key, Section, keys_in, short
from scenes.language.toml import KeyPath
from worm3d.values import named

S = TypeVar("S", bound=Section)

UNKNOWN, MISSING = "unknown", "missing"
"""Error texts for unknown keys, and for missing mandatory keys."""

RULES = {"gt": "greater than", "ge": "greater than or equal to", "lt": "less than", "le": "less than or equal to"}

TYPES: Mapping[Any, tuple[Any, str]] = {
    float: ((int, float), "a valid number"),
    int: (int, "a valid integer"),
    bool: (bool, "a valid boolean"),
    str: (str, "a valid string"),
}
"""For each type of a key: the accepted Python types of the value, and the name of the type in error messages."""


class Wrong(NamedTuple):
    """A value that is invalid whatever the other keys are."""

    path: KeyPath
    found: Any
    text: str


def read(schema: type[S], data: Any) -> tuple[S | None, list[Wrong]]:
    """Return the data as a section, and the errors. The section is None if there are errors."""
    reader = _Reader()
    found = reader.section(schema, data, ())
    return (None if reader.wrong else found), reader.wrong


def trusted(schema: type[S], data: Any) -> S:
    """Return the data as a section. The data must have been checked before."""
    found, wrong = read(schema, data)
    assert found is not None, wrong
    return found


class _Reader:
    """Converter of data to sections that collects the errors in `wrong`."""

    def __init__(self) -> None:
        self.wrong: list[Wrong] = []

    def section(self, schema: type[S], data: Any, path: KeyPath) -> S | None:
        if not isinstance(data, Mapping):
            self._tell(path, data, "a section")
            return None
        known, before = keys_in(schema), len(self.wrong)
        given = {
            name: self._value(key, key.hint, data[name], (*path, name)) for name, key in known.items() if name in data
        }
        self.wrong += [Wrong((*path, name), data[name], UNKNOWN) for name in data if name not in known]
        by = next(filter(None, getattr(schema, "holds", ())), "kind")
        kind = data.get(by, known[by].default) if by in known else None
        missing = [name for name, key in known.items() if key.is_required and name not in data and key.is_for(kind)]
        self.wrong += [Wrong((*path, name), data, MISSING) for name in missing]
        return schema(**given) if len(self.wrong) == before else None

    def _value(self, key: Key, hint: Any, value: Any, path: KeyPath) -> Any:
        origin, inner = get_origin(hint), get_args(hint)
        if isinstance(hint, type) and issubclass(hint, Section):
            return self.section(hint, value, path)
        if origin is Literal:
            if not any(type(value) is type(word) and value == word for word in inner):
                self._tell(path, value, _listed(inner))
        elif origin is tuple:
            return self._list(key, inner, value, path)
        elif origin is dict:
            return self._table(key, inner[1], value, path)
        elif inner:  # one of several types: None, a single value, a list
            types = [each for each in inner if each is not NoneType]
            wanted = [each for each in types if (get_origin(each) is tuple) == isinstance(value, list | tuple)]
            if value is None and NoneType in inner:
                return None
            return self._value(key, (wanted or types)[-1], value, path)  # the last list type also takes nested lists
        elif hint is not Any:
            return self._plain(key, hint, value, path)
        return value

    def _plain(self, key: Key, hint: Any, value: Any, path: KeyPath) -> Any:
        kind, what = TYPES[hint]
        if not isinstance(value, kind) or (isinstance(value, bool) and hint is not bool):
            self._tell(path, value, what)
        elif hint is float and not _is_finite(value):
            self._tell(path, value, "a finite number")
        elif key.names is not None and not (value in key.names or named.is_own(value)):
            names = f"one of {', '.join(map(repr, key.names))}, or " if key.names else ""
            self._tell(path, value, f"{names}module:NAME")
        else:
            broken = [name for name, bound in key.bounds.items() if not getattr(operator, name)(value, bound)]
            if broken:
                self._tell(path, value, f"{RULES[broken[0]]} {short(key.bounds[broken[0]])}")
            return float(value) if hint is float else value
        return value

    def _list(self, key: Key, inner: tuple[Any, ...], value: Any, path: KeyPath) -> Any:
        size = None if inner[-1] is Ellipsis else len(inner)
        if not isinstance(value, list | tuple):
            self._tell(path, value, "a valid list")
        elif size not in (None, len(value)):
            self._tell(path, value, f"a list of {size} items, not {len(value)}")
        else:
            if key.names is not None and len({*map(str, value)}) < len(value):
                self._tell(path, value, "a list that has each name once")
            return tuple(self._value(key, inner[0], item, (*path, n)) for n, item in enumerate(value))
        return value

    def _table(self, key: Key, inner: Any, value: Any, path: KeyPath) -> Any:
        if not isinstance(value, Mapping):
            self._tell(path, value, "a table")
            return value
        return {name: self._value(key, inner, item, (*path, name)) for name, item in value.items()}

    def _tell(self, path: KeyPath, found: Any, allowed: str) -> None:
        self.wrong.append(Wrong(path, found, f"input should be {allowed}"))


def _is_finite(number: float) -> bool:
    try:
        return math.isfinite(number)
    except OverflowError:  # a whole number with hundreds of digits
        return False


def _listed(words: tuple[Any, ...]) -> str:
    """Return the choices in words: 'a', 'b' or 'c'."""
    *first, last = map(repr, words)
    return f"{', '.join(first)} or {last}" if first else last
