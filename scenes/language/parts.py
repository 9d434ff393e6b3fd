"""Sections whose keys are derived from the parameters of dataclasses, `worm3d.values.parameters`.

    class Worm(PartSection, keys=keys_of(worm3d.Worm, without=("flat",))):
        \"\"\"The body.\"\"\"

    class Gait(PartSection, keys=keys_of(gaits.GAITS, by="kind", meaning="pattern of contraction")):
        \"\"\"How the worm moves.\"\"\"

    worm = part_of(worm3d.Worm, scene.worm)
    gait = part_of(gaits.GAITS[scene.gait.kind], scene.gait)

A registry is a mapping of names to dataclasses. From a registry, `keys_of` makes the key `by`, whose value is one of
the names, and the keys of all dataclasses. A key that only some dataclasses have is an error if the scene chooses
another dataclass (`scenes.language.checks.kind_checks`). If several dataclasses have the same key, the first one
declares it; with `own_defaults` its default depends on the chosen dataclass. The names of keys end in their unit, and
angles are in degrees. A parameter that is infinite or None by default has a key that may be left out. With `prefix`,
each key begins with a word, so that a section can have several parts of the same class.
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
"""Key in `PartSection.holds` for a section that does not name parts in a key, but contains the parts themselves."""

KEY_UNITS = {"m", "kg", "s", "N", "J", "Hz", "Pa", "W", "deg", "rad", "m^2", "m^3", "s^2", "1"}
"""Units that may be part of the name of a key."""


Source = Callable[[Mapping[str, Any]], Keys]
"""Function that returns the keys of a section, given the classes of the parts by name."""


class PartSection(Section):
    """A section with the keys written in the class, and the keys in the class arguments `keys` and `more`.

    If a key is in several of them, the key written in the class is used. The class argument `holds` maps keys of the
    section to the kinds of parts (`control.parts`) that these keys name. The value of such a key is the name of a part,
    or a list of names. A section that `holds` a kind under the key `ITSELF` contains the parts themselves, as
    sub-sections or switches. If `keys` is a function, it makes the keys of the shipped parts, and in
    `scenes.language.own` the keys of a user's own parts.
    """

    holds: ClassVar[Mapping[str, Kind]] = EMPTY_MAPPING
    source: ClassVar[Source]
    """Function that makes the keys for parts of the first kind in `holds`."""
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
        For several dataclasses: the key that chooses a dataclass (by default the first), the meaning of this key, and
        its aliases.
    these, without : collection of str
        Parameters that get a key (all if empty), and parameters that get no key.
    bounds, defaults, units : mapping
        Ranges, defaults and units by the name of the parameter, which replace the ranges, defaults and units of the
        dataclass. The ranges are in the units of the section.
    prefix, about : str
        Text before each key, and text before each meaning.
    only : tuple of str
        Kinds of the section that have these keys; all if empty.
    own_defaults : bool
        Whether a key whose default differs between the dataclasses has the default of the chosen dataclass. If false,
        it has the default of the first dataclass.
    own : bool
        Whether the key `by` may also name a user's own part, `module:NAME`.
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
"""Function that returns the keys of a section that chooses a shipped or a user's own part in the key `kind`."""


def meanings(registry: Mapping[str, type]) -> str:
    """Return the first sentences of the docstrings of the parts of a registry, by name."""
    return "; ".join(f"{name}: {head(part)[:1].lower()}{head(part)[1:]}" for name, part in registry.items())


def head(part: Any) -> str:
    """Return the meaning of a part, or the first sentence of its docstring, without the full stop."""
    return getattr(part, "meaning", "") or (part.__doc__ or "").split(".")[0]


def part_of(
    part: type[T], *sections: Any, prefix: str = "", units: Mapping[str, str] = EMPTY_MAPPING, **given: Any
) -> T:
    """Return the part that a section describes, or several sections together.

    Parameters
    ----------
    part : type
        Dataclass of the part.
    prefix, units
        The same as in `keys_of`.
    given
        Values of fields that are not in the sections. Fields that the dataclass does not have are ignored.

    Raises
    ------
    ValueError
        If the values are invalid for the dataclass.
    """
    own: Any = part
    names = {field.name for field in fields(own)} if is_dataclass(own) else ()
    values = values_of(part, *sections, prefix=prefix, units=units)
    return part(**values | {name: value for name, value in given.items() if name in names})


def values_of(part: Any, *sections: Any, prefix: str = "", units: Mapping[str, str] = EMPTY_MAPPING) -> dict[str, Any]:
    """Return the values that the sections give for the parameters of a part. The arguments are as in `part_of`."""
    values: dict[str, Any] = {}
    for name, said in declared(part).items():
        known = _replaced(said, _changes(name, unit=units))
        key = prefix + key_of(known)
        value = next((getattr(section, key) for section in sections if hasattr(section, key)), None)
        if value is not None:
            values[name] = math.radians(value) if known.unit.startswith("rad") else value
    return values


def class_named(kind: Kind, name: str) -> Any:
    """Return the class or object of a kind with the given name; raise ValueError if there is none."""
    return kind.registry[name] if name in kind.registry else named.own(name, kind)


def part_named(kind: Kind, name: str, *sections: Any, **how: Any) -> Any:
    """Return a part by the name of a shipped part, or by `module:NAME`. The other arguments are as in `part_of`.

    Raises
    ------
    ValueError
        If there is no such part, or its parameters are invalid.
    """
    if name in kind.registry:
        return part_of(kind.registry[name], *sections, **how)
    return named.ready(name, kind, lambda part: part_of(part, *sections, **how))


def key_of(known: Parameter) -> str:
    """Return the key of a parameter in a section.

    By default it is the name of the parameter followed by the unit. The unit is left out if `KEY_UNITS` lacks a part of
    it.
    """
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
    """Return a text for a default that depends on the kind. It lists the values, if there are at most four."""
    kinds: dict[str, list[str]] = {}
    for owner, own in owners.items():
        text = f"{own.default:.4g}" if type(own.default) is float else toml.shown(own.default)
        kinds.setdefault(text if _is_value(own.default) else own.left_out, []).append(owner)
    listed = "; ".join(f"{text} for {', '.join(few(of))}" for text, of in kinds.items())
    return f"that of its kind: {listed}" if len(kinds) <= 4 else "that of its kind"


def _declared(owners: Mapping[str, Parameter], only: tuple[str, ...], own_defaults: bool) -> Key:
    """Return the key of a parameter, combined from its declarations in all dataclasses that have the parameter."""
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
    """Return the type of the key of a parameter. `words` are the choices of all dataclasses that have the parameter."""
    if words:
        return Literal[words]
    each: Any = Each
    types = [hint for hint in get_args(known.hint) or (known.hint,) if hint in (str, bool, int)]
    hint: Any = known.hint if known.is_pair else types[0] if len(types) == 1 else float
    for _ in range(EACH[known.each][0]):
        hint = each[hint]
    return hint | None if optional else hint
