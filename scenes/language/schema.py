"""Declaration of sections: frozen dataclasses, each field a `Parameter` with unit, range, default and meaning.

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
"""Entry of `only` for all of a user's own kinds."""

Each = Union[N, tuple[N, ...]]  # noqa: UP007  # `|` takes no type variable here
"""One number for all, or a list with a number for each."""

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Points = tuple[Triple, ...]
"""A list of positions, [x, y, z] each."""

Tables = tuple[N, ...]
"""An array of tables: `Tables[Patch]` are sections under headers [[world.patches]]."""


@dataclass(frozen=True, kw_only=True)
class Key(Parameter):
    """A parameter as a key of a section."""

    only: tuple[str, ...] = ()
    """Kinds of the section that have the key; empty for all."""
    defaults_by_kind: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """Default for each kind of the section, where the kinds differ."""
    kinds_by_word: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    """Kinds of the section that accept a given choice; a choice without an entry is accepted by every kind."""
    names: tuple[str, ...] | None = None
    """Names of the shipped parts that the key accepts besides `module:NAME`; None if the key does not name parts."""
    is_file: bool = False
    """Whether the value is the path of a file."""
    parameters: tuple[str, ...] = ()
    """Names of the part parameters that the key sets."""

    @property
    def is_required(self) -> bool:
        """Whether the key is mandatory."""
        return self.default is None and not self.left_out

    @property
    def choices(self) -> tuple[Any, ...]:
        """The values of a choice, or the names of shipped parts; empty for other keys."""
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
        """Whether the value is a number, or several."""
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
        """The default, or the text that describes a missing value."""
        return self.left_out or toml.shown(self.default)

    @property
    def meaning_in_section(self) -> str:
        """The meaning, preceded by the kinds of the section that have the key, unless all kinds have the key."""
        only = ", ".join(few(self.only))
        return f"{only} only: {self.meaning}" if only else self.meaning

    def described(self, *, with_default: bool = True) -> str:
        """Return unit, range and default for an error line: ` [m], 0 < … <= 100 (default 1.0)`."""
        text = (f" [{self.unit}]" if self.unit else "") + (f", {self.span}" if self.span else "")
        text += f", {EACH[self.each][2]}" if self.each else ""
        known = with_default and not self.is_required and self.section is None
        return text + (f" (default {self.default_text})" if known else "")

    def words_for(self, kind: str) -> tuple[Any, ...]:
        """Return the choices that a kind of the section allows."""
        return tuple(word for word in self.choices if kind in self.kinds_by_word.get(word, (kind,)))

    def is_for(self, kind: Any) -> bool:
        """Return whether a kind of the section has the key."""
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
    """A section of a scene, as a frozen dataclass of keys; creating a section checks nothing."""

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
    """Return a field of a section; the key is mandatory without a default or `left_out`.

    Parameters
    ----------
    default : object, optional
        Default.
    only : str or tuple of str
        The `kind`, or kinds, of the section that have the key; empty for all.
    said
        Bounds (gt, ge, lt, le) and attributes of `Key`: `meaning`, `unit`, `aka`, `left_out`, `each` and others.
    """
    known = new_key(default, only=(only,) if isinstance(only, str) else only, **said)
    return known.as_field()


def new_key(default: Any = None, **said: Any) -> Key:
    """Return a key without a field in a class; the arguments are those in `setting`, and the type as `hint`."""
    known: Key = parameter(made=Key, **said).metadata[PARAMETER]
    return dataclasses.replace(known, default=default)


def part_key(names: Sequence[str], **said: Any) -> Key:
    """Return a key that names a part: an item of `names` (by default the first), or `module:NAME`.

    See `worm3d.values.named`. If `only` contains `OWN_KINDS`, users' own kinds also have the key.
    """
    return new_key(names[0], hint=str, names=tuple(names), **said)


def parts_key(names: Sequence[str], **said: Any) -> Key:
    """Return a key that lists parts, by default all of `names`. See `part_key`."""
    return new_key(tuple(names), hint=tuple[str, ...], names=tuple(names), **said)


def key_at(schema: type[Section], path: KeyPath) -> Key | None:
    """Return the key or section at a path, or None if there is none; indices in the path are ignored."""
    names = [name for name in path if isinstance(name, str)]
    known = keys_in(schema).get(names[0])
    if known is None or len(names) == 1:
        return known
    inner = known.section or known.table
    return key_at(inner, tuple(names[1:])) if inner else known


def names(schema: type[Section]) -> Iterator[tuple[str, str]]:
    """Yield each name that a user may try for a key, with the key."""
    for name, known in keys_in(schema).items():
        yield name, name
        yield from ((other, name) for other in known.aka)


def few(words: Sequence[str]) -> list[str]:
    """Return the words; of more than four words, the first two and the number of the others."""
    return [*words] if len(words) <= 4 else [*words[:2], f"{len(words) - 2} others"]


def with_own_defaults(schema: type[Section], data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of a scene with the defaults of the kinds that its sections choose.

    A user's own kind has the defaults of `OWN_KINDS`, if there are any. An invalid kind, which other checks report,
    counts as the first kind.
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
    """Return the item type of a type, or the type itself."""
    inner = [each for each in get_args(hint) if each not in (NoneType, Ellipsis)]
    return _innermost(inner[0]) if inner and get_origin(hint) is not Literal else hint


def short(number: float) -> str:
    """Return a bound as text for an error line."""
    return str(number) if isinstance(number, int) else f"{number:g}"
