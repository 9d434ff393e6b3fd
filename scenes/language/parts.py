"""Sections whose keys follow from the parameters of dataclasses, `worm3d.values.parameters`.

    class Worm(PartSection, keys=keys_of(worm3d.Worm, without=("flat",))):
        \"\"\"The body.\"\"\"

    class Gait(PartSection, keys=keys_of(gaits.GAITS, by="kind", title="pattern of contraction")):
        \"\"\"How the worm moves.\"\"\"

    worm = part_of(worm3d.Worm, scene.worm)
    gait = part_of(gaits.GAITS[scene.gait.kind], scene.gait)

A registry (a mapping of names to dataclasses) makes the key `by`, which names one of them, and the keys of all; a key
that only some of them have is refused where another is chosen (`scenes.models.checks.kind_checks`). Keys end in their
unit, angles are in degrees; a parameter that may be infinite, or None, is left out instead. `prefix` puts a word before
each key, for several parts of one class in one section.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import Field

from scenes.language.schema import Each, Pair, Section, quantity, setting
from worm3d.values.parameters import Parameter, in_degrees, parameters_of

T = TypeVar("T")

Keys = dict[str, tuple[Any, Any]]
"""Key of a section -> its type and its declaration."""

Bounds = Mapping[str, Mapping[str, Any]]
"""Parameter -> bounds (gt, ge, lt, le) that replace its own."""


class PartSection(Section):
    """A section with keys beside those that its class writes out."""

    def __init_subclass__(cls, keys: Keys | None = None, **kwargs: Any) -> None:
        written = dict(cls.__annotations__)
        added = {name: key for name, key in (keys or {}).items() if name not in written}
        for name, (_, declared) in added.items():
            setattr(cls, name, declared)
        cls.__annotations__ = {**{name: annotation for name, (annotation, _) in added.items()}, **written}
        super().__init_subclass__(**kwargs)

    @classmethod
    def __pydantic_init_subclass__(cls, keys: Keys | None = None, **kwargs: Any) -> None:
        """Take the argument of the class statement, which pydantic hands on."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Return the value of a key."""


def keys_of(
    parts: type | Mapping[str, type],
    *,
    by: str = "",
    title: str = "",
    default: str = "",
    aka: tuple[str, ...] = ("type",),
    without: Collection[str] = (),
    bounds: Bounds = MappingProxyType({}),
    defaults: Mapping[str, Any] = MappingProxyType({}),
    prefix: str = "",
) -> Keys:
    """Return the keys of a section.

    Parameters
    ----------
    parts : type or mapping
        A dataclass, or several by name.
    by, title, default, aka : str
        Of several, the key that names the one, what it is, its default (else the first), and its aliases.
    without : collection of str
        Parameters that have no key here.
    bounds, defaults : mapping
        Ranges and defaults that differ from those of the dataclass, by parameter.
    prefix : str
        Before each key.
    """
    registry = parts if isinstance(parts, Mapping) else {"": parts}
    keys: Keys = {}
    if by:
        keys[prefix + by] = (Literal[tuple(registry)], setting(default or next(iter(registry)), title=title, aka=aka))
    owners: dict[str, list[str]] = {}
    known: dict[str, Parameter] = {}
    for owner, part in registry.items():
        for name, own in parameters_of(part).items():
            if name not in without:
                key = prefix + key_of(own)
                owners.setdefault(key, []).append(owner)
                known.setdefault(key, _adapted(own, bounds.get(name), defaults))
    everywhere = len(registry)
    for key, one in known.items():
        only = tuple(owners[key]) if len(owners[key]) < everywhere else ()
        choices = tuple(dict.fromkeys(c for part in registry.values() for c in _choices(part, key, prefix)))
        keys[key] = _declared(one, only, choices)
    return keys


def part_of(part: type[T], section: Any, prefix: str = "", **given: Any) -> T:
    """Return the part that a section describes.

    Parameters
    ----------
    part : type
        Its dataclass.
    given
        Parameters that are not in the section; those that the dataclass does not have are passed over.

    Raises
    ------
    ValueError
        What the dataclass refuses.
    """
    known = parameters_of(part)
    values = {
        name: math.radians(value) if one.unit.startswith("rad") else value
        for name, one in known.items()
        if (value := getattr(section, prefix + key_of(one), None)) is not None
    }
    return part(**{**values, **{name: value for name, value in given.items() if name in known}})


def key_of(known: Parameter) -> str:
    """Return the key of a parameter in a section: its name, and its unit if that is of SI."""
    if known.key:
        return known.key
    unit = in_degrees(known).unit
    if not all(part in UNITS for part in _words(unit)):
        return known.name
    suffix = "_".join(_words(unit.replace("1/", "per ").replace("^", "")))
    return f"{known.name}_{suffix}" if suffix else known.name


def keys_by_parameter(part: type, prefix: str = "") -> dict[str, str]:
    """Return the key of each parameter of a dataclass, to put keys into its errors."""
    return {name: prefix + key_of(known) for name, known in parameters_of(part).items()}


UNITS = {"m", "kg", "s", "N", "J", "Hz", "Pa", "W", "deg", "rad", "m^2", "m^3", "s^2", "1"}


def _words(unit: str) -> list[str]:
    return unit.replace("/", " ").split()


def _choices(part: type, key: str, prefix: str) -> Iterator[str]:
    for known in parameters_of(part).values():
        if prefix + key_of(known) == key:
            yield from known.choices


def _adapted(known: Parameter, bounds: Mapping[str, Any] | None, defaults: Mapping[str, Any]) -> Parameter:
    """Return a parameter as a section has it: in degrees, with the bounds and the default of that section."""
    changed = in_degrees(replace(known, default=defaults.get(known.name, known.default)))
    return changed if bounds is None else replace(changed, bounds=bounds)


def _declared(known: Parameter, only: tuple[str, ...], choices: tuple[str, ...]) -> tuple[Any, Any]:
    """Return the type and the declaration of a key."""
    common: dict[str, Any] = {"title": known.meaning, "aka": _aka(known), "only": only, "left_out": known.left_out}
    default = None if known.left_out else known.default
    if choices or known.hint is bool:
        return (Literal[choices] if choices else bool), setting(default, **common)
    common["unit"] = known.unit
    if known.each:
        each: Any = Each
        number = Annotated[float, Field(**known.bounds)] if known.bounds else float
        return _optional(each[number], known), quantity(default, each=known.each, **common)
    if known.is_pair:
        return Pair, quantity(default, **common)
    kind: Any = int if known.hint is int else float
    return _optional(kind, known), quantity(default, **known.bounds, **common)


def _optional(kind: Any, known: Parameter) -> Any:
    return kind | None if known.left_out else kind


def _aka(known: Parameter) -> tuple[str, ...]:
    return known.aka if key_of(known) == known.name else (known.name, *known.aka)
