"""Sections whose keys are derived from the parameters of dataclasses, `worm3d.values.parameters`.

    class Worm(PartSection, keys=keys_of(worm3d.Worm, without=("flat",))):
        \"\"\"The body.\"\"\"

    class Gait(PartSection, keys=keys_of(gaits.GAITS, by="kind", meaning="pattern of contraction")):
        \"\"\"How the worm moves.\"\"\"

    worm = part_of(worm3d.Worm, scene.worm)
    gait = part_of(gaits.GAITS[scene.gait.kind], scene.gait)

A registry (a mapping of names to dataclasses) makes the key `by`, which names a dataclass, and the keys of all
dataclasses. A key of only some dataclasses is refused if the scene chooses another one
(`scenes.language.checks.kind_checks`). A key of several dataclasses is declared by the first, or has the default of
each kind (`own_defaults`). Keys end in their unit, and angles are in degrees; a parameter that may be infinite, or
None, is left out instead. `prefix` adds a word before each key, for several parts of one class in one section.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar, get_args

from scenes.language import toml
from scenes.language.schema import Each, Key, Section, few, keys_in, new_key, part_key
from worm3d.values import named
from worm3d.values.named import Kind, declared
from worm3d.values.parameters import EACH, Parameter, in_degrees, parameters_of

T = TypeVar("T")

Keys = dict[str, Key]
"""Keys of a section by name."""

EMPTY_MAPPING: Mapping[str, Any] = MappingProxyType({})

ITSELF = ""
"""Key in `PartSection.holds` for a section that contains the parts themselves."""

KEY_UNITS = {"m", "kg", "s", "N", "J", "Hz", "Pa", "W", "deg", "rad", "m^2", "m^3", "s^2", "1"}
"""Units that can end a key."""


Source = Callable[[Mapping[str, Any]], Keys]
"""Function from classes by name to the keys of a section."""


class PartSection(Section):
    """A section with the keys written in the class, `keys` and `more`; the written keys take precedence.

    `holds` maps keys of the section to the kinds of parts that they name (`control.parts`): one key names a part, or a
    key with a list names several. A section that `holds` a kind without a key contains the parts themselves, as
    sub-sections or switches. If the argument `keys` is a function, the function makes the keys of the shipped parts,
    and in `scenes.language.own` the keys of users' own parts.
    """

    holds: ClassVar[Mapping[str, Kind]] = EMPTY_MAPPING
    source: ClassVar[Source]
    """Function that makes the keys of the first kind in `holds`."""
    of_parts: ClassVar[frozenset[str]] = frozenset()
    """Keys made by `source` for the shipped parts."""

    @classmethod
    def each(cls, name: str, part: Any) -> Keys:
        """Return the keys of the sub-section of a user's own part, `module:NAME`."""
        return keys_of(part)

    def __init_subclass__(cls, holds: Mapping[str, Kind] = EMPTY_MAPPING, **given: Any) -> None:
        if holds:
            cls.holds = holds
        found = Keys()
        for keys in given.values():  # in the order of the class statement
            if callable(keys):
                cls.source = staticmethod(keys)
                keys = keys(next(iter(cls.holds.values())).registry)
                cls.of_parts = frozenset(keys) - {*cls.holds}
            found |= keys
        written = inspect.get_annotations(cls)
        added = {name: known for name, known in found.items() if name not in written}
        for name, known in added.items():
            setattr(cls, name, known.as_field())
        cls.__annotations__ = {**{name: known.hint for name, known in added.items()}, **written}
        super().__init_subclass__()

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Return the value of a key."""


def keys_of(
    parts: type | Mapping[str, type],
    *,
    by: str = "",
    meaning: str = "",
    aka: tuple[str, ...] = ("type",),
    these: Collection[str] = (),
    without: Collection[str] = (),
    bounds: Mapping[str, Mapping[str, Any]] = EMPTY_MAPPING,
    defaults: Mapping[str, Any] = EMPTY_MAPPING,
    units: Mapping[str, str] = EMPTY_MAPPING,
    prefix: str = "",
    about: str = "",
    only: tuple[str, ...] = (),
    own_defaults: bool = False,
    own: bool = False,
) -> Keys:
    """Return the keys of a section.

    Parameters
    ----------
    parts : type or mapping
        A dataclass, or several dataclasses by name.
    by, meaning, aka : str
        For several dataclasses: the key that names one (the first by default), its meaning, and its aliases.
    these, without : collection of str
        Parameters that get a key (if empty, all), and parameters that do not.
    bounds, defaults, units : mapping
        Ranges (in the units of the section), defaults and units that replace the values of the dataclass, by parameter.
    prefix, about : str
        Text before each key, and before each meaning.
    only : tuple of str
        Kinds of the section with these keys; empty for all.
    own_defaults : bool
        Whether a key whose default differs among the kinds has the default of the chosen kind instead of the first
        kind.
    own : bool
        Whether the key `by` also names users' own parts, `module:NAME`.
    """
    registry = parts if isinstance(parts, Mapping) else {"": parts}
    found: dict[str, dict[str, Parameter]] = {}
    for owner, part in registry.items():
        for name, known in declared(part).items():
            if name not in without and (name in these or not these):
                shown = in_degrees(_replaced(known, _changes(name, default=defaults, unit=units)))
                more: dict[str, Any] = {"meaning": about + shown.meaning} if about else {}
                shown = _replaced(shown, more | _changes(name, bounds=bounds))
                found.setdefault(prefix + key_of(shown), {})[owner] = shown
    keys: Keys = {}
    if by:
        names, said = tuple(registry), {"meaning": meaning, "aka": aka}
        keys[prefix + by] = part_key(names, **said) if own else new_key(names[0], hint=Literal[names], **said)
    for name, owners in found.items():
        keys[name] = _declared(owners, only or (tuple(owners) if len(owners) < len(registry) else ()), own_defaults)
    return keys


chosen: Callable[..., Keys] = partial(keys_of, by="kind", own=True)
"""Return the keys of a section that chooses a part, shipped or the user's own."""


def meanings(registry: Mapping[str, type]) -> str:
    """Return the first sentences of the docstrings of the parts of a registry, by name."""
    return "; ".join(f"{name}: {head(part)[:1].lower()}{head(part)[1:]}" for name, part in registry.items())


def head(part: Any) -> str:
    """Return the meaning of a part, or the first sentence of its docstring, without the full stop."""
    return getattr(part, "meaning", "") or (part.__doc__ or "").split(".")[0]


def part_of(
    part: type[T], *sections: Any, prefix: str = "", units: Mapping[str, str] = EMPTY_MAPPING, **given: Any
) -> T:
    """Return the part described by a section, or by several sections together.

    Parameters
    ----------
    part : type
        Dataclass of the part.
    prefix, units
        The same as in `keys_of`.
    given
        Fields that are given directly; fields that the dataclass does not have are ignored.

    Raises
    ------
    ValueError
        The dataclass refuses the values.
    """
    own: Any = part
    names = {field.name for field in fields(own)} if is_dataclass(own) else ()
    values = values_of(part, *sections, prefix=prefix, units=units)
    return part(**values | {name: value for name, value in given.items() if name in names})


def values_of(part: Any, *sections: Any, prefix: str = "", units: Mapping[str, str] = EMPTY_MAPPING) -> dict[str, Any]:
    """Return the values of the parameters of a part in the sections; the arguments are those in `part_of`."""
    values: dict[str, Any] = {}
    for name, said in declared(part).items():
        known = _replaced(said, _changes(name, unit=units))
        key = prefix + key_of(known)
        value = next((getattr(section, key) for section in sections if hasattr(section, key)), None)
        if value is not None:
            values[name] = math.radians(value) if known.unit.startswith("rad") else value
    return values


def class_named(kind: Kind, name: str) -> Any:
    """Return a class, or an object, by name; ValueError if there is none."""
    return kind.registry[name] if name in kind.registry else named.own(name, kind)


def part_named(kind: Kind, name: str, *sections: Any, **how: Any) -> Any:
    """Return a part by name: shipped, or the user's own as `module:NAME`; see `part_of` for the other arguments.

    Raises
    ------
    ValueError
        There is no such part, or the part refuses its parameters.
    """
    if name in kind.registry:
        return part_of(kind.registry[name], *sections, **how)
    return named.ready(name, kind, lambda part: part_of(part, *sections, **how))


def key_of(known: Parameter) -> str:
    """Return the key of a parameter in a section: the name and the unit, if all its parts are in `KEY_UNITS`."""
    unit = in_degrees(known).unit
    words = unit.replace("/", " ").split()
    if known.key or not all(word in KEY_UNITS for word in words):
        return known.key or known.name
    return "_".join([known.name, *unit.replace("1/", "per ").replace("/", " ").replace("^", "").split()])


def keys_by_parameter(part: type, section: type[Section]) -> dict[str, str]:
    """Return the key of each parameter of a dataclass in a section, for use in error messages."""
    keys = {name: key_of(known) for name, known in parameters_of(part).items()}
    return {name: key for name, key in keys.items() if key in keys_in(section)}


def _replaced(known: Parameter, changes: Mapping[str, Any]) -> Parameter:
    return replace(known, **changes) if changes else known


def _changes(name: str, **changes: Mapping[str, Any]) -> dict[str, Any]:
    return {field: values[name] for field, values in changes.items() if name in values}


def _is_value(default: Any) -> bool:
    return default is not None and not (isinstance(default, float) and math.isinf(default))


def _of_kinds(owners: Mapping[str, Parameter]) -> str:
    """Return the words for a default that depends on the kind: up to four values, each with its kinds."""
    kinds: dict[str, list[str]] = {}
    for owner, own in owners.items():
        text = f"{own.default:.4g}" if type(own.default) is float else toml.shown(own.default)
        kinds.setdefault(text if _is_value(own.default) else own.left_out, []).append(owner)
    listed = "; ".join(f"{text} for {', '.join(few(of))}" for text, of in kinds.items())
    return f"that of its kind: {listed}" if len(kinds) <= 4 else "that of its kind"


def _declared(owners: Mapping[str, Parameter], only: tuple[str, ...], own_defaults: bool) -> Key:
    """Return the key of a parameter, combined from the declarations in all parts with this parameter."""
    known = next(iter(owners.values()))
    agree = not own_defaults or len({own.default for own in owners.values()}) == 1
    is_finite = agree and _is_value(known.default)
    name, words = key_of(known), dict.fromkeys(word for own in owners.values() for word in own.choices)
    takers = {word: tuple(owner for owner, own in owners.items() if word in own.choices) for word in words}
    left_out = "" if is_finite else known.left_out if agree else _of_kinds(owners)
    said = {field.name: getattr(known, field.name) for field in fields(Parameter)}
    changed = {
        "aka": known.aka if name == known.name else (known.name, *known.aka),
        "default": known.default if is_finite else None,
        "left_out": left_out,
        "hint": _hint(known, tuple(words), optional=bool(left_out)),
        "only": only,
        "defaults_by_kind": {}
        if agree
        else {owner: each.default for owner, each in owners.items() if _is_value(each.default)},
        "kinds_by_word": {} if "" in owners else takers,
        "parameters": tuple(dict.fromkeys(own.name for own in owners.values())),
    }
    return Key(**said | changed)


def _hint(known: Parameter, words: tuple[str, ...], *, optional: bool) -> Any:
    """Return the type of the key of a parameter; the choices of all parts with this parameter are allowed."""
    if words:
        return Literal[words]
    each: Any = Each
    types = [hint for hint in get_args(known.hint) or (known.hint,) if hint in (str, bool, int)]
    hint: Any = known.hint if known.is_pair else types[0] if len(types) == 1 else float
    for _ in range(EACH[known.each][0]):
        hint = each[hint]
    return hint | None if optional else hint
