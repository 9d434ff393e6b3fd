"""Declaration of sections. A section is a frozen dataclass, and each field is a key with unit, range and meaning.

    class Push(Section):
        \"\"\"A force on one joint.\"\"\"

        joint: int = setting(0, ge=0, meaning="which joint")
        force_N: Triple = setting((0.0, 0.0, 0.0), unit="N", meaning="x, y, z of the force")

`scenes.language.reading` converts the data of a scene to sections.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass
from types import NoneType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar, Union, cast, get_args, get_origin

from scenes.language import toml
from scenes.language.toml import KeyPath
from worm3d.values import named
from worm3d.values.parameters import EACH, PARAMETER, Parameter, parameter, parameters_of

N = TypeVar("N")

OWN_KINDS = "module:NAME"
"""Entry of `Key.only` that means all kinds of a user's own."""

Each = Union[N, tuple[N, ...]]  # noqa: UP007  # `|` takes no type variable here
"""Type of a key whose value is a single number for all items (for example all segments), or a list with one for
each."""

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Points = tuple[Triple, ...]
"""Type of a key whose value is a list of positions [x, y, z]."""

Tables = tuple[N, ...]
"""Type of a key whose value is an array of tables. For example, `Tables[Patch]` is written as sections under headers
[[world.patches]]."""


@dataclass(frozen=True, kw_only=True)
class Key(Parameter):
    """A parameter as a key of a section."""

    only: tuple[str, ...] = ()
    """Kinds of the section that have the key; all kinds if empty. The kind is the value of the section's key `kind`."""
    defaults_by_kind: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Default for each kind of the section, if it differs between the kinds."""
    kinds_by_word: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    """For each possible value of a key with choices: the kinds of the section that accept this value. A value without
    an entry is accepted by every kind."""
    names: tuple[str, ...] | None = None
    """Names of the shipped parts that the key accepts in addition to `module:NAME`. None if the key names no parts."""
    is_file: bool = False
    """Whether the value is the path of a file."""
    parameters: tuple[str, ...] = ()
    """Names of the parameters of parts that the key sets."""

    @property
    def is_required(self) -> bool:
        """Whether the key is mandatory."""
        return self.default is None and not self.left_out

    @property
    def choices(self) -> tuple[Any, ...]:
        """The possible values of a key with choices, or the names of shipped parts; empty for other keys."""
        return self.names or super().choices

    @property
    def section(self) -> type[Section] | None:
        """The class of the section at this key, or None for a plain key."""
        return self.hint if isinstance(self.hint, type) and issubclass(self.hint, Section) else None

    @property
    def table(self) -> type[Section] | None:
        """The class of the sections in an array of tables, or None for other keys."""
        inner = next(iter(get_args(self.hint)), None) if get_origin(self.hint) is tuple else None
        return inner if isinstance(inner, type) and issubclass(inner, Section) else None

    @property
    def is_number(self) -> bool:
        """Whether the value is a number or a list of numbers."""
        return _innermost(self.hint) in (float, int)

    @property
    def is_whole(self) -> bool:
        """Whether the value is one whole number."""
        return self.hint is int or set(get_args(self.hint)) == {int, NoneType}

    @property
    def unit_or_one(self) -> str:
        """The unit of a number, "1" for a dimensionless number; empty for other keys."""
        return (self.unit or "1") if self.is_number else ""

    @property
    def span(self) -> str:
        """The range of a number, `0 < … <= 100`; empty without bounds."""
        known = self.bounds
        low = next((f"{short(known[name])} {sign} " for name, sign in (("gt", "<"), ("ge", "<=")) if name in known), "")
        high = next(
            (f" {sign} {short(known[name])}" for name, sign in (("lt", "<"), ("le", "<=")) if name in known), ""
        )
        return f"{low}…{high}" if known else ""

    @property
    def default_text(self) -> str:
        """The default as text, or the text that says what happens if the key is left out."""
        return self.left_out or toml.shown(self.default)

    @property
    def meaning_in_section(self) -> str:
        """The meaning. If only some kinds of the section have the key, the text begins with these kinds."""
        only = ", ".join(few(self.only))
        return f"{only} only: {self.meaning}" if only else self.meaning

    def described(self, *, with_default: bool = True) -> str:
        """Return unit, range and default as text for an error line, for example ` [m], 0 < … <= 100 (default 1.0)`."""
        text = (f" [{self.unit}]" if self.unit else "") + (f", {self.span}" if self.span else "")
        text += f", {EACH[self.each][2]}" if self.each else ""
        known = with_default and not self.is_required and self.section is None
        return text + (f" (default {self.default_text})" if known else "")

    def words_for(self, kind: str) -> tuple[Any, ...]:
        """Return the choices that the given kind of the section accepts."""
        return tuple(word for word in self.choices if kind in self.kinds_by_word.get(word, (kind,)))

    def is_for(self, kind: Any) -> bool:
        """Return whether the given kind of the section has the key."""
        return (
            not self.only
            or kind in self.only
            or (OWN_KINDS in self.only and isinstance(kind, str) and named.is_own(kind))
        )

    def as_field(self) -> Any:
        """Return the key as a field of a dataclass."""
        default = MISSING if self.is_required else self.default
        if isinstance(default, dict):
            return dataclasses.field(default_factory=default.copy, metadata={PARAMETER: self})
        return dataclasses.field(default=default, metadata={PARAMETER: self})


class Section:
    """A section of a scene, as a frozen dataclass of keys. Creating an instance does not check the values."""

    if TYPE_CHECKING:
        __dataclass_fields__: ClassVar[dict[str, Any]]
        __hash__: ClassVar[Any]  # mypy confuses the hash of an instance with the hash of the class
    else:

        def __hash__(self) -> int:
            return hash(tuple(self))

    def __init_subclass__(cls) -> None:
        for name, hint in inspect.get_annotations(cls).items():
            default = cls.__dict__.get(name)
            if isinstance(default, Section | None) and not str(hint).startswith("ClassVar"):  # a nested section
                setattr(cls, name, Key(meaning="", default=default).as_field())
        dataclass(init=False, repr=False, eq=False, frozen=True)(
            cls
        )  # a key need not be a Python name, such as my_robot:Slip

    def __init__(self, **given: Any) -> None:
        keys = keys_in(type(self))
        assert given.keys() <= keys.keys(), given.keys() - keys.keys()
        vars(self).update({name: given.get(name, known.default) for name, known in keys.items()})

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in self)})"

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        """Iterate over the keys and their values."""
        return iter(vars(self).items())


def keys_in(schema: type[Section]) -> Mapping[str, Key]:
    """Return the keys and the nested sections of a section, by name."""
    return cast(Mapping[str, Key], parameters_of(schema))


def setting(default: Any = None, *, only: str | tuple[str, ...] = (), **said: Any) -> Any:
    """Return a field of a section. The key is mandatory if it has neither a default nor `left_out`.

    Parameters
    ----------
    default : object, optional
        Default value of the key.
    only : str or tuple of str
        Kind or kinds of the section that have the key; all if empty.
    said
        Bounds (gt, ge, lt, le) and attributes of `Key`: `meaning`, `unit`, `aka`, `left_out`, `each` and others.
    """
    known = new_key(default, only=(only,) if isinstance(only, str) else only, **said)
    return known.as_field()


def new_key(default: Any = None, **said: Any) -> Key:
    """Return a key that is not written as a field of a class. The arguments are as in `setting`; `hint` is the type."""
    known: Key = parameter(made=Key, **said).metadata[PARAMETER]
    return dataclasses.replace(known, default=default)


def part_key(names: Sequence[str], **said: Any) -> Key:
    """Return a key whose value names a part, either a name in `names` (by default the first) or `module:NAME`.

    See `worm3d.values.named`. The other arguments are as in `new_key`.
    """
    return new_key(names[0], hint=str, names=tuple(names), **said)


def parts_key(names: Sequence[str], **said: Any) -> Key:
    """Return a key whose value is a list of names of parts, by default all of `names`. See `part_key`."""
    return new_key(tuple(names), hint=tuple[str, ...], names=tuple(names), **said)


def key_at(schema: type[Section], path: KeyPath) -> Key | None:
    """Return the key or section at a path, or None if there is none. Indices of arrays in the path are ignored."""
    names = [name for name in path if isinstance(name, str)]
    known = keys_in(schema).get(names[0])
    if known is None or len(names) == 1:
        return known
    inner = known.section or known.table
    return key_at(inner, tuple(names[1:])) if inner else known


def names(schema: type[Section]) -> Iterator[tuple[str, str]]:
    """Yield each name that a user may write for a key, the key itself and its aliases, with the key."""
    for name, known in keys_in(schema).items():
        yield name, name
        yield from ((other, name) for other in known.aka)


def few(words: Sequence[str]) -> list[str]:
    """Return the words, or if there are more than four, the first two and the number of the others."""
    return [*words] if len(words) <= 4 else [*words[:2], f"{len(words) - 2} others"]


def with_own_defaults(schema: type[Section], data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of a scene, with the defaults that depend on the chosen kinds filled in.

    A user's own kind has the defaults under `OWN_KINDS`, if there are any. An invalid kind, which other checks report,
    is treated as the first kind.
    """
    filled = dict(data)
    for name, declared in keys_in(schema).items():
        section, given = declared.section, data.get(name, {})
        if section is None or "kind" not in keys_in(section) or not isinstance(given, Mapping):
            continue
        kinds = keys_in(section)["kind"]
        asked = given.get("kind")
        kind: Any = asked if asked in kinds.choices else kinds.default
        known = {key: each.defaults_by_kind for key, each in keys_in(section).items() if key not in given}
        if isinstance(asked, str) and named.is_own(asked):
            known = {key: {kind: own[OWN_KINDS]} if OWN_KINDS in own else own for key, own in known.items()}
        added = {key: own[kind] for key, own in known.items() if kind in own}
        if added:
            filled[name] = {**given, **added}
    return filled


def _innermost(hint: Any) -> Any:
    """Return the type of the items of a (nested) list type, or the type itself if it is not a list type."""
    inner = [each for each in get_args(hint) if each not in (NoneType, Ellipsis)]
    return _innermost(inner[0]) if inner and get_origin(hint) is not Literal else hint


def short(number: float) -> str:
    """Return a bound as text for an error line."""
    return str(number) if isinstance(number, int) else f"{number:g}"
