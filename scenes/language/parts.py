"""Sections whose keys follow from the parameters of dataclasses, `worm3d.values.parameters`.

    class Worm(PartSection, keys=keys_of(worm3d.Worm, without=("flat",))):
        \"\"\"The body.\"\"\"

    class Gait(PartSection, keys=keys_of(gaits.GAITS, by="kind", meaning="pattern of contraction")):
        \"\"\"How the worm moves.\"\"\"

    worm = part_of(worm3d.Worm, scene.worm)
    gait = part_of(gaits.GAITS[scene.gait.kind], scene.gait)

A registry (a mapping of names to dataclasses) makes the key `by`, which names one of them, and the keys of all; a key
that only some of them have is refused where another is chosen (`scenes.language.checks.kind_checks`). A key that
several have is declared by the first of them, or has the default of each kind (`own_defaults`). Keys end in their
unit, angles are in degrees; a parameter that may be infinite, or None, is left out instead. `prefix` puts a word before
each key, for several parts of one class in one section.
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

NOTHING: Mapping[str, Any] = MappingProxyType({})

ITSELF = ""
"""Stands, in `PartSection.holds`, for the keys of a section that has the parts themselves."""

UNITS = {"m", "kg", "s", "N", "J", "Hz", "Pa", "W", "deg", "rad", "m^2", "m^3", "s^2", "1"}
"""Units that a key ends in."""


Source = Callable[[Mapping[str, Any]], Keys]
"""From classes by name to the keys of a section."""


class PartSection(Section):
    """A section with `keys`, and `more` of them, beside those that its class writes out; those that it writes out win.

    `holds` says which kinds of parts its keys name (`control.parts`): one by a key, or several by a key with a list. A
    section that `holds` a kind by no key has the parts themselves as sub-sections or switches. If the argument `keys`
    is a function, it makes the keys of the parts that ship, and in `scenes.language.own` those of users' parts.
    """

    holds: ClassVar[Mapping[str, Kind]] = NOTHING
    source: ClassVar[Source]
    """Makes the keys of parts of the kind that it holds first."""
    of_parts: ClassVar[frozenset[str]] = frozenset()
    """Keys that `source` made for the parts that ship."""

    @classmethod
    def each(cls, name: str, part: Any) -> Keys:
        """Return the keys of the sub-section of a user's own part, `module:NAME`."""
        return keys_of(part)

    def __init_subclass__(cls, holds: Mapping[str, Kind] = NOTHING, **given: Any) -> None:
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
    bounds: Mapping[str, Mapping[str, Any]] = NOTHING,
    defaults: Mapping[str, Any] = NOTHING,
    units: Mapping[str, str] = NOTHING,
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
        A dataclass, or several by name.
    by, meaning, aka : str
        Of several, the key that names the one (by default the first), its meaning, and its aliases.
    these, without : collection of str
        Parameters that alone have a key (all, if there are none), and those that have none.
    bounds, defaults, units : mapping
        Ranges (in the units of the section), defaults and units that differ from those of the dataclass, by parameter.
    prefix, about : str
        What stands before each key, and before each meaning.
    only : tuple of str
        Kinds of the section that the keys are for; empty for all.
    own_defaults : bool
        Whether a key whose defaults differ among the kinds has that of its kind, and not that of the first.
    own : bool
        Whether the key `by` also names parts of a user's own, `module:NAME`.
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
"""Return the keys of a section that chooses a part, a user's own too."""


def meanings(registry: Mapping[str, type]) -> str:
    """Return what the parts of a registry are: by name, the first sentences of their docstrings."""
    return "; ".join(f"{name}: {head(part)[:1].lower()}{head(part)[1:]}" for name, part in registry.items())


def head(part: Any) -> str:
    """Return the meaning of a part, or the first sentence about it without its full stop."""
    return getattr(part, "meaning", "") or (part.__doc__ or "").split(".")[0]


def part_of(part: type[T], *sections: Any, prefix: str = "", units: Mapping[str, str] = NOTHING, **given: Any) -> T:
    """Return the part that a section describes, or several sections together.

    Parameters
    ----------
    part : type
        Its dataclass.
    prefix, units
        As of `keys_of`.
    given
        Fields that are not taken from the section; those that the dataclass does not have are passed over.

    Raises
    ------
    ValueError
        What the dataclass refuses.
    """
    own: Any = part
    names = {field.name for field in fields(own)} if is_dataclass(own) else ()
    values = values_of(part, *sections, prefix=prefix, units=units)
    return part(**values | {name: value for name, value in given.items() if name in names})


def values_of(part: Any, *sections: Any, prefix: str = "", units: Mapping[str, str] = NOTHING) -> dict[str, Any]:
    """Return the values that sections give to the parameters of a part; arguments as of `part_of`."""
    values: dict[str, Any] = {}
    for name, said in declared(part).items():
        known = _replaced(said, _changes(name, unit=units))
        key = prefix + key_of(known)
        value = next((getattr(section, key) for section in sections if hasattr(section, key)), None)
        if value is not None:
            values[name] = math.radians(value) if known.unit.startswith("rad") else value
    return values


def class_named(kind: Kind, name: str) -> Any:
    """Return the class of a name, or the object that it is; ValueError where there is none."""
    return kind.registry[name] if name in kind.registry else named.own(name, kind)


def part_named(kind: Kind, name: str, *sections: Any, **how: Any) -> Any:
    """Return the part of a name: one of those that ship, or a user's own as `module:NAME`; the rest as of `part_of`.

    Raises
    ------
    ValueError
        There is no such part, or it refuses its parameters.
    """
    if name in kind.registry:
        return part_of(kind.registry[name], *sections, **how)
    return named.ready(name, kind, lambda part: part_of(part, *sections, **how))


def key_of(known: Parameter) -> str:
    """Return the key of a parameter in a section: its name, and its unit if that is of SI."""
    unit = in_degrees(known).unit
    words = unit.replace("/", " ").split()
    if known.key or not all(word in UNITS for word in words):
        return known.key or known.name
    return "_".join([known.name, *unit.replace("1/", "per ").replace("/", " ").replace("^", "").split()])


def keys_by_parameter(part: type, section: type[Section]) -> dict[str, str]:
    """Return the key of each parameter of a dataclass that a section has, to put keys into its errors."""
    keys = {name: key_of(known) for name, known in parameters_of(part).items()}
    return {name: key for name, key in keys.items() if key in keys_in(section)}


def _replaced(known: Parameter, changes: Mapping[str, Any]) -> Parameter:
    return replace(known, **changes) if changes else known


def _changes(name: str, **changes: Mapping[str, Any]) -> dict[str, Any]:
    return {field: values[name] for field, values in changes.items() if name in values}


def _is_value(default: Any) -> bool:
    return default is not None and not (isinstance(default, float) and math.isinf(default))


def _of_kinds(owners: Mapping[str, Parameter]) -> str:
    """Return what holds where each kind has a default of its own: the kinds of each, where there are few."""
    kinds: dict[str, list[str]] = {}
    for owner, own in owners.items():
        text = f"{own.default:.4g}" if type(own.default) is float else toml.shown(own.default)
        kinds.setdefault(text if _is_value(own.default) else own.left_out, []).append(owner)
    listed = "; ".join(f"{text} for {', '.join(few(of))}" for text, of in kinds.items())
    return f"that of its kind: {listed}" if len(kinds) <= 4 else "that of its kind"


def _declared(owners: Mapping[str, Parameter], only: tuple[str, ...], own_defaults: bool) -> Key:
    """Return the key of a parameter, from what is known of it in each part that has it."""
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
    """Return the type of the key of a parameter, with the words that any of its owners takes."""
    if words:
        return Literal[words]
    each: Any = Each
    types = [hint for hint in get_args(known.hint) or (known.hint,) if hint in (str, bool, int)]
    hint: Any = known.hint if known.is_pair else types[0] if len(types) == 1 else float
    for _ in range(EACH[known.each][0]):
        hint = each[hint]
    return hint | None if optional else hint
