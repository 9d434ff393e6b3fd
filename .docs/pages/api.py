"""The page with the public names of the packages, from their signatures and docstrings."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from functools import cache, cached_property
from typing import Any

from pages.text import bullets, code, docstring, page, prose

MODULES = {
    "worm3d": "Worms, worlds, friction, simulation and results.",
    "control.gaits": "Gaits and reflexes.",
    "control.sensing": "Sensors and their measurements.",
    "planar.published": "The program of the paper.",
    "planar.linkage": "The corrected planar model.",
    "worm3d.values.parameters": "Parameters of parts of your own, see [parts](../guides/parts.md).",
    "control.parts": "Marks for parts of your own, see [parts of a controller](../guides/control.md).",
    "control.planning.terms": "",
    "control.planning.constraints": "",
    "control.estimation.reduced": "State and input of the reduced model of a worm, for terms and constraints.",
    "control.tracking.preview": "The reference ahead of the worm, for the weights of terms and constraints.",
}
"""Modules whose names the page lists, with a sentence for each. Without a sentence, the page has the docstring."""

SOME_NAMES = {
    "worm3d.values.parameters": ("parameter",),
    "control.parts": ("part",),
    "control.planning.terms": ("Part", "CostTerm", "Moment", "Wanted", "TERMS"),
    "control.planning.constraints": ("Constraint", "CONSTRAINTS"),
    "control.estimation.reduced": ("ReducedState", "ReducedInput"),
    "control.tracking.preview": ("Preview",),
}
"""Names that the page lists, of modules without `__all__`."""

OURS = ("worm3d", "control", "planar", "scenes")
ADDRESS = re.compile(r" at 0x[0-9a-f]+")
IN_PYTHON_ONLY = {
    ADDRESS.pattern: "",
    r"= '([^']*)'": r'= "\1"',
    "'": "",
    r"ForwardRef\((.*)\)": r"\1",
    r"<class ([\w.]+)>": r"\1",
    r': "(Literal.*?)"': r": \1",
    r"<dataclasses\._MISSING_TYPE object>": "MISSING",
}
"""Patterns in the text of a parameter that readers do not need, and their replacements, in this order."""
WIDTH = 88
"""Width of a line of a signature."""

PAGE_INTRODUCTION = """
This page lists the public names of the Python packages, and the names of further modules that parts of your own need.
The program makes the page from signatures and docstrings. In Python, `help(worm3d.Worm)` prints the same text. All
quantities are in SI units, and angles are in radians. [Keys of scenes](scene_keys.md) have the same parameters with
units in the name.
""".strip()


def api() -> str:
    """Return the page."""
    blocks = [PAGE_INTRODUCTION]
    for name, said in MODULES.items():
        module = importlib.import_module(name)
        blocks += [f"## {name}", said or docstring(module.__doc__ or "")]
        blocks += [block for each in _names_of(name) for block in _named(name, each, getattr(module, each))]
    return page("Python names", *blocks)


def every_name() -> set[str]:
    """Return all public names with their modules, such as "worm3d.Worm"."""
    return {f"{name}.{each}" for name in MODULES for each in _names_of(name)}


def _names_of(module: str) -> Sequence[str]:
    names: Sequence[str] = SOME_NAMES.get(module) or importlib.import_module(module).__all__
    return names


def _named(module: str, name: str, value: Any) -> Iterator[str]:
    yield f"### {module}.{name}"
    if isinstance(value, Mapping):
        yield "Names, as scenes use them, and their classes:"
        yield bullets(
            f"{code(key)}: {code(getattr(each, '__name__', type(each).__name__))}" for key, each in value.items()
        )
    elif not _is_documented(value):
        yield f"Type alias, {code(ADDRESS.sub('', str(value)))}."
    else:
        yield _signature(f"{module}.{name}", value)
        yield docstring(value.__doc__ or "")
        if inspect.isclass(value):
            yield from _members(value)


def _is_documented(value: Any) -> bool:
    return (inspect.isclass(value) or inspect.isroutine(value)) and str(value.__module__).startswith(OURS)


def _signature(name: str, value: Any) -> str:
    """Return a code block with the call. Long calls have a line for each parameter."""
    try:
        signature = inspect.signature(value)
    except ValueError:
        return f"```python\n{name}\n```"
    unbound = [each for each in signature.parameters.values() if each.name not in ("self", "cls")]
    texts = [*_with_marks(list(map(_readable, unbound)), unbound)]
    line = f"{name}({', '.join(texts)})"
    split = f"{name}(\n    " + ",\n    ".join(texts) + ",\n)"
    return f"```text\n{line if len(line) <= WIDTH else split}\n```"


def _readable(value: object) -> str:
    text = str(value)
    for pattern, instead in IN_PYTHON_ONLY.items():
        text = re.sub(pattern, instead, text)
    return text


def _with_marks(texts: list[str], parameters: list[inspect.Parameter]) -> Iterator[str]:
    """Yield the parameters, with `*` before the first one that can be given by name only."""
    kinds = [each.kind for each in parameters]
    only, rest = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.VAR_POSITIONAL
    for k, text in enumerate(texts):
        if kinds[k] is only and only not in kinds[:k] and rest not in kinds:
            yield "*"
        yield text


def _members(holder: type) -> Iterator[str]:
    """Yield the public methods and properties of a class that have a docstring."""
    if issubclass(holder, Enum):
        yield bullets(f"{code(each.name)}: {prose(str(each.value))}" for each in holder)
    for name in dir(holder):
        value = inspect.getattr_static(holder, name)
        said = inspect.getdoc(getattr(value, "__func__", value))
        if not name.startswith("_") and said and _is_member(value) and _is_listed(holder, name):
            yield from _member(f"{holder.__name__}.{name}", value, said)


def _is_listed(holder: type, name: str) -> bool:
    """Return whether an attribute is of these packages, and is not listed with another class of the page."""
    owner = next(each for each in holder.__mro__ if name in vars(each))
    return owner.__module__.startswith(OURS) and (owner is holder or owner not in _classes())


@cache
def _classes() -> frozenset[Any]:
    """Return the classes that the page lists."""
    places = (name.rpartition(".") for name in every_name())
    values = (getattr(importlib.import_module(module), name) for module, _, name in places)
    return frozenset(value for value in values if inspect.isclass(value))


def _is_member(value: Any) -> bool:
    return inspect.isfunction(getattr(value, "__func__", value)) or isinstance(value, property | cached_property)


def _member(name: str, value: Any, said: str) -> Iterator[str]:
    if isinstance(value, property | cached_property):
        yield f"#### {name}\n\nProperty. {prose(said.split(chr(10) + chr(10))[0])}"
        return
    yield f"#### {name}()"
    yield _signature(name, getattr(value, "__func__", value))
    yield docstring(said)
