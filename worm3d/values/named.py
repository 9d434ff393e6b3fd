"""Parts by name: those of a registry, or a user's own as `module:NAME`, such as `my_robot:MyController`.

The module is one that Python finds, or a file in the current folder. NAME is what it calls the part: a class, or
where parts are used as they are, an object.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any

LONGEST = 200
"""Number of characters of an exception's text that are kept."""


def is_own(name: str) -> bool:
    """Return whether a name is written as a user's own part, `module:NAME`."""
    module, colon, attribute = name.partition(":")
    return bool(colon) and attribute.isidentifier() and all(map(str.isidentifier, module.split(".")))


def own(name: str, what: str, fits: Callable[[Any], bool], allowed: str) -> Any:
    """Return a user's own part.

    Parameters
    ----------
    name : str
        `module:NAME`.
    what : str
        What it is, for errors: "a controller".
    fits : callable
        Part -> whether it can be one.
    allowed : str
        What can be one: "a class with of(...)".

    Raises
    ------
    ValueError
        There is no such module or part, the module cannot be imported, or the part is of another kind.
    """
    if not is_own(name):
        raise ValueError(f"got {name!r}, must be {what} of your own as module:NAME")
    module, _, attribute = name.partition(":")
    part = _attribute(_imported(module), module, attribute)
    if not fits(part):
        kind = f"the class {part.__name__}" if isinstance(part, type) else f"an object of {type(part).__name__}"
        raise ValueError(f"{name} is {kind}, must be {what}: {allowed}")
    return part


def ready(name: str, kind: type, allowed: str) -> Any:
    """Return a user's own part as an object of a kind; a class, or a function, is called without arguments.

    Raises
    ------
    ValueError
        As of `own`, or calling it raises an exception.
    """
    found = own(name, allowed, lambda part: callable(part) or isinstance(part, kind), "or a class of that kind")
    if isinstance(found, kind) and not isinstance(found, type):
        return found
    try:
        made = found()
    except Exception as error:
        raise ValueError(f"{name}() raised {told(error)}") from error
    if not isinstance(made, kind):
        raise ValueError(f"{name}() is an object of {type(made).__name__}, must be {allowed}")
    return made


def told(error: Exception) -> str:
    """Return an exception of a user's own part as a line."""
    text = str(error) if isinstance(error, ValueError) and str(error) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())[:LONGEST]


def unknown(name: str, known: Iterable[str]) -> str:
    """Return what is wrong with a name that is neither in a registry nor a user's own."""
    words = list(known)
    close = get_close_matches(name, words, n=1)
    meant = f"; did you mean {close[0]!r}?" if close else ""
    return f"got {name!r}, must be one of {', '.join(map(repr, words))}, or module:NAME{meant}"


def _imported(module: str) -> Any:
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)  # last, so that no file there hides an installed module
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and (module == error.name or module.startswith(f"{error.name}.")):
            raise ValueError(f"there is no module {module!r}, neither installed nor as a file in {here}") from None
        raise ValueError(f"the module {module!r} cannot be imported: {error}") from error
    except Exception as error:
        raise ValueError(f"the module {module!r} cannot be imported: {told(error)}") from error


def _attribute(found: Any, module: str, attribute: str) -> Any:
    try:
        return getattr(found, attribute)
    except AttributeError:
        names = [name for name in vars(found) if not name.startswith("_")]
        close = get_close_matches(attribute, names, n=1)
        meant = f"; did you mean {close[0]!r}?" if close else ""
        raise ValueError(f"the module {module!r} has no {attribute!r}{meant}") from None
