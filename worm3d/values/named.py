"""Parts by name: built-in parts, or a user's own parts as `module:NAME`, for example `my_robot:MyController`.

A part is, for example, a controller or a world. The module is a module that Python finds, or a file in the current
folder. NAME is the name of the part in the module. The part is a class or, for some kinds of parts, an object or a
function that returns an object. A name in a scene must not run arbitrary installed code. Therefore a part has to be
marked for the requested kind, by its base class or by `marked`, and an unmarked part is never called. However,
importing the module runs the code of the module.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import Field, dataclass, is_dataclass
from difflib import get_close_matches
from importlib import import_module
from importlib.machinery import PathFinder
from pathlib import Path
from traceback import extract_tb
from types import BuiltinFunctionType, FunctionType
from typing import Any, TypeVar

from worm3d.values.parameters import Parameter, parameters_of

T = TypeVar("T", bound=Callable[..., Any])

EXCEPTIONS = (Exception, SystemExit)
"""Exceptions of a user's own code that become error messages. SystemExit would otherwise end the program silently."""
FUNCTIONS = (FunctionType, BuiltinFunctionType)
PARTS_ATTRIBUTE = "__worm3d_parts__"
"""Attribute of a class or function. `marked` stores the kinds of parts there."""
_bases, _names, _title = (type.__dict__[name].__get__ for name in ("__mro__", "__dict__", "__name__"))
"""Functions that return the bases (including the class itself), the attributes and the name of a class, without running
code of a metaclass."""
_code_is_refused: ContextVar[bool] = ContextVar("_code_is_refused", default=False)


@dataclass(frozen=True)
class Kind:
    """A kind of parts that users can write, for example controllers."""

    name: str
    """Name of the kind, the first argument of `marked`."""
    what: str
    """Name with the article, for example "a controller"."""
    module: str
    """Module of the base class. It is imported when a part of this kind is requested."""
    base: str
    """Name of the base class in the module."""
    form: str = ""
    """Class method that classes of this kind must have, with its arguments. Empty for kinds whose parts are objects."""
    table: str = ""
    """Name, in the module, of the table of built-in parts. Empty if there is no table."""

    @property
    def registry(self) -> Mapping[str, Any]:
        """Built-in parts, by name."""
        found: Mapping[str, Any] = getattr(import_module(self.module), self.table) if self.table else {}
        return found

    @property
    def base_class(self) -> type:
        """Class that a part may be derived from."""
        found: type = getattr(import_module(self.module), self.base)
        return found

    def marks(self, part: Any) -> bool:
        """Return whether a part is marked as this kind, by its class or by `marked`, without running its code."""
        return self.name in _marks(part) or self.base_class in _bases(_class_of(part))

    def accepts(self, part: Any) -> bool:
        """Return whether a marked part has the class method `form`, if the kind requires it."""
        return not self.form or (_is_class(part) and callable(getattr(part, self.form.partition("(")[0], None)))


def marked(kind: str, part: T) -> T:
    """Mark a class or function as a part of a kind, and return it.

    Raises
    ------
    TypeError
        `part` is neither a class nor a function.
    """
    if not (_is_class(part) or type(part) is FunctionType):
        raise TypeError(f"part: got {_described(part)}, must be a class or a function")
    setattr(part, PARTS_ATTRIBUTE, frozenset({*_marks(part), kind}))
    return part


def is_own(name: str) -> bool:
    """Return whether a name has the form of a user's own part, `module:NAME`."""
    module, colon, attribute = name.partition(":")
    return bool(colon) and attribute.isidentifier() and all(map(str.isidentifier, module.split(".")))


@contextmanager
def code_refused() -> Iterator[None]:
    """Refuse users' own parts within the context, without importing their modules."""
    token = _code_is_refused.set(True)
    try:
        yield
    finally:
        _code_is_refused.reset(token)


def own(name: str, kind: Kind) -> Any:
    """Return a user's own part without calling the part.

    Parameters
    ----------
    name : str
        `module:NAME`.
    kind : Kind
        Required kind.

    Raises
    ------
    ValueError
        The module or part does not exist, the module cannot be imported, the part is not marked for the kind or does
        not have the form of the kind, or users' own parts are refused.
    """
    if not is_own(name):
        raise ValueError(f"got {name!r}, must be {kind.what} of your own as module:NAME")
    module, _, attribute = name.partition(":")
    _require_allowed(name, module)
    part = _attribute(_imported(module), module, attribute)
    if not kind.marks(part):
        raise ValueError(f"{name} is {_described(part)}, not marked as {kind.what}: {_how(part, kind)}")
    if not kind.accepts(part):
        raise ValueError(f"{name} is {_described(part)}, must be {kind.what}: a class with {kind.form}")
    if _is_class(part) and (bare := [key for key, value in _names(part).items() if type(value) is Field]):
        raise ValueError(
            f"{name} has the parameter {bare[0]}, but is no dataclass: write @dataclass(frozen=True, kw_only=True) "
            "above it"
        )
    return part


def ready(name: str, kind: Kind, make: Callable[[Any], Any] = lambda part: part()) -> Any:
    """Return a user's own part as an object of a kind. `make` makes the object from a class or function.

    Raises
    ------
    ValueError
        `own` raises a ValueError, or making the object raises an exception. If a class with parameters raises a
        ValueError, this error is not changed, because it explains which parameter is wrong.
    """
    found = own(name, kind)
    base = kind.base_class
    if not _is_class(found) and isinstance(found, base):
        return found
    try:
        made = make(found)
    except EXCEPTIONS as error:
        if isinstance(error, ValueError) and declared(found):
            raise
        raise ValueError(f"{name}() raised {told(error)}") from error
    if _is_class(made) or not isinstance(made, base):
        raise ValueError(
            f"{name}() is {_described(made)}, must be {kind.what}, with all that {kind.module}.{kind.base} has"
        )
    return made


def declared(part: Any) -> Mapping[str, Parameter]:
    """Return the parameters of a part by name if it is a dataclass, otherwise an empty mapping."""
    return parameters_of(part) if isinstance(part, type) and is_dataclass(part) else {}


def told(error: BaseException) -> str:
    """Return an exception of a user's own part as one line of text of at most 200 characters."""
    text = str(error) if isinstance(error, ValueError) and str(error) else f"{type(error).__name__}: {error}"
    return " ".join(text.split())[:200]


def names_in(data: Any) -> list[str]:
    """Return the names `module:NAME` of users' own parts among the keys and values of a scene's data."""
    if isinstance(data, str):
        return [data] if is_own(data) else []
    items = [*data, *data.values()] if isinstance(data, Mapping) else data if isinstance(data, list | tuple) else ()
    return [*dict.fromkeys(name for item in items for name in names_in(item))]


def raised(error: BaseException, names: Iterable[str]) -> str:
    """Return an error message for an exception in user code, with the names of the parts and the line of the code."""
    files = {getattr(sys.modules.get(name.partition(":")[0]), "__file__", None) for name in names}
    at = [frame for frame in extract_tb(error.__traceback__) if frame.filename in files][-1:]
    where = "".join(f" ({Path(frame.filename).name}, line {frame.lineno})" for frame in at)
    return f"{', '.join(names)}: raised {told(error)}{where}"


def unknown(name: str, known: Iterable[str]) -> str:
    """Return the error message for a name that is neither in a registry nor a user's own part."""
    words = list(known)
    close = get_close_matches(name, words, n=1)
    meant = f"; did you mean {close[0]!r}?" if close else ""
    return f"got {name!r}, must be one of {', '.join(map(repr, words))}, or module:NAME{meant}"


def _is_class(part: Any) -> bool:
    return issubclass(type(part), type)


def _class_of(part: Any) -> Any:
    return part if _is_class(part) else type(part)


def _marks(part: Any) -> frozenset[str]:
    """Return the kinds that `marked` has stored in a function, or in a class and its bases."""
    is_function = type(part) is FunctionType
    spaces = [part.__dict__] if is_function else [_names(base) for base in _bases(_class_of(part))]
    return frozenset().union(*(space.get(PARTS_ATTRIBUTE, ()) for space in spaces))


def _described(part: Any) -> str:
    """Return a description of an object in words, without calling its `__repr__`."""
    if _is_class(part):
        return f"the class {_title(part)}"
    return "a function" if type(part) in FUNCTIONS else f"an object of {_title(type(part))}"


def _how(part: Any, kind: Kind) -> str:
    """Return an instruction in words for marking a part."""
    by_hand = f"write @part({kind.name!r}) above it (from control.parts import part)"
    if type(part) in FUNCTIONS and not kind.form:
        return by_hand
    whose = "derive it" if _is_class(part) else "derive a class" if type(part) in FUNCTIONS else "derive its class"
    return f"{whose} from {kind.module}.{kind.base}, or {by_hand}"


def _require_allowed(name: str, module: str) -> None:
    """Refuse a name that cannot be a user's own part, before the module is imported."""
    first = module.partition(".")[0]
    if _code_is_refused.get():
        raise ValueError(f"{name} is code of a module, refused here (--no-code): choose a part that ships with worm3d")
    if first in sys.stdlib_module_names:
        raise ValueError(f"{name}: {first!r} is a module of Python itself; a module of your own needs another name")
    if module.endswith(".__main__"):
        raise ValueError(
            f"{name}: {module!r} is a program, which ends when it has run; move the part to another module"
        )


def _imported(module: str) -> Any:
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)  # last, so that no file in this folder hides an installed module
    _announce(module)
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and (module == error.name or module.startswith(f"{error.name}.")):
            raise ValueError(f"there is no module {module!r}, neither installed nor as a file in {here}") from None
        raise ValueError(f"the module {module!r} cannot be imported: {error}") from error
    except EXCEPTIONS as error:
        raise ValueError(f"the module {module!r} cannot be imported: {told(error)}") from error


def _announce(module: str) -> None:
    """Print which code will run next. Worker processes print nothing, because the main process has done so."""
    from multiprocessing import parent_process  # few scenes name a module

    first = module.partition(".")[0]
    spec = None if module in sys.modules or parent_process() is not None else PathFinder.find_spec(first)
    if spec is not None:
        print(f"runs code of the module {module} ({spec.origin})", file=sys.stderr)  # noqa: T201


def _attribute(found: Any, module: str, attribute: str) -> Any:
    names: dict[str, Any] = object.__getattribute__(found, "__dict__")  # does not call a __getattr__ of the module
    if attribute not in names:
        close = get_close_matches(attribute, [name for name in names if not name.startswith("_")], n=1)
        meant = f"; did you mean {close[0]!r}?" if close else ""
        raise ValueError(f"the module {module!r} has no {attribute!r}{meant}")
    return names[attribute]
