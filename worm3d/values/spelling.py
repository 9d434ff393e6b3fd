"""Error messages for misspelt names of arguments, attributes and keys. They suggest the name that was probably meant.

A subclass of `Spelled`, or a function with `@spelled`, refuses an unknown argument with an error message such as

    Worm: n_segments: unknown argument; did you mean 'segments'?
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from functools import cache, wraps
from importlib import import_module
from importlib.util import find_spec
from inspect import Parameter, signature
from typing import Any, ParamSpec, Self, TypeVar

from worm3d.values.parameters import PARAMETER, check

P = ParamSpec("P")
R = TypeVar("R")

ELSEWHERE = {
    "gait": "actuation",
    "controller": "actuation",
    "command": "actuation",
    "friction": "ground",
    "terrain": "world",
    "time": "duration",
    "time_step": "dt",
}
"""Words from scenes, pages and other programs, and the corresponding names of arguments in worm3d."""


def did_you_mean(word: str, known: Iterable[tuple[str, str]]) -> str | None:
    """Return the name that was probably meant by `word`, or None if no name is similar.

    `known` has pairs of a word that users might write and the name that it stands for.
    """
    meaning = {tried.lower(): name for tried, name in known}
    close = get_close_matches(word.lower(), meaning, n=1)
    return meaning[close[0]] if close else None


def unknown(what: str, word: str, known: Iterable[tuple[str, str]]) -> str:
    """Return the error message for an unknown name.

    `what` says what is named, for example "argument". `word` and `known` are explained in `did_you_mean`.
    """
    pairs = list(known)
    meant = did_you_mean(word, pairs)
    listed = ", ".join(dict.fromkeys(name for _, name in pairs)) or "none"
    hint = f"did you mean '{meant}'?" if meant else f"known here: {listed}"
    return f"unknown {what}; {hint}"


class Spelled:
    """Base of classes that refuse unknown arguments and suggest the argument that may have been intended."""

    def __new__(cls, *given: Any, **named: Any) -> Self:
        """Return the object after checking the names of the arguments.

        Raises
        ------
        TypeError
            `__init__` has no argument of this name.
        """
        if named:
            _require_known(cls, cls.__init__, named)
        return super().__new__(cls)


class Checked(Spelled):
    """Base of frozen dataclasses of parameters (`worm3d.values.parameters`), which checks the parameters."""

    def __post_init__(self) -> None:
        check(self)


def spelled(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function refuse unknown arguments with a TypeError, as subclasses of `Spelled` do."""

    @wraps(function)
    def called(*given: P.args, **named: P.kwargs) -> R:
        if named:
            _require_known(function, function, named)
        return function(*given, **named)

    return called


def no_attribute(module: str, name: str, known: Iterable[str], elsewhere: Iterable[str] = ()) -> AttributeError:
    """Return the error about a name that a module does not have.

    Parameters
    ----------
    module, name : str
    known : iterable of str
        Names in the module.
    elsewhere : iterable of str
        Other modules to search for the name. The name may also be the last component of the name of such a module.
    """
    # Programs request names with "_". `from package import submodule` first requests the attribute `submodule`, and
    # imports the submodule if there is no such attribute.
    if name.startswith("_") or find_spec(f"{module}.{name}") is not None:
        return AttributeError(f"module {module!r} has no attribute {name!r}")
    for other in elsewhere:
        package, _, last = other.rpartition(".")
        if last == name:
            return AttributeError(f"{module}: {name}: unknown name; it is in {package}: from {package} import {name}")
        if name in getattr(import_module(other), "__all__", ()):
            return AttributeError(f"{module}: {name}: unknown name; it is in {other}: from {other} import {name}")
    return AttributeError(f"{module}: {name}: {unknown('name', name, [(each, each) for each in known])}")


def _require_known(owner: Any, function: Callable[..., Any], named: Mapping[str, Any]) -> None:
    known = _arguments(function)
    if known is None or named.keys() <= known.keys():
        return
    wrong = next(name for name in named if name not in known)
    pairs = [(name, name) for name in known]
    if isinstance(owner, type) and dataclasses.is_dataclass(owner):
        pairs = [*((each.name, each.name) for each in dataclasses.fields(owner) if each.name in known), *_tried(owner)]
    pairs += [(other, name) for other, name in ELSEWHERE.items() if name in known and other not in known]
    name = owner.__name__ if isinstance(owner, type) else owner.__qualname__
    raise TypeError(f"{name}: {wrong}: {unknown('argument', wrong, pairs)}")


def _tried(owner: Any) -> Iterable[tuple[str, str]]:
    """Yield pairs of a word that users might write for a parameter of a dataclass, and the name of the parameter."""
    for field in dataclasses.fields(owner):
        if known := field.metadata.get(PARAMETER):
            yield from ((other, field.name) for other in (known.key, *known.aka) if other)


@cache
def _arguments(function: Callable[..., Any]) -> dict[str, None] | None:
    """Return the names of the keyword arguments of a function, or None if the function accepts any name."""
    if function is object.__init__:
        return {}
    found = signature(function).parameters.values()
    if any(each.kind is Parameter.VAR_KEYWORD for each in found):
        return None
    names = (each.name for each in found if each.kind is not Parameter.POSITIONAL_ONLY)
    return dict.fromkeys(name for name in names if name not in ("self", "cls"))
