"""Sections that switch on parts of a registry by name: `name = true`, and keys that begin with the name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

from scenes.language.checks import Check, Found
from scenes.language.parts import Keys, head, keys_of, part_named, part_of
from scenes.language.schema import Section, keys_in, new_key
from worm3d.values.named import Kind, is_own


def switched_keys(registry: Mapping[str, type]) -> Keys:
    """Return the keys of all parts: a switch with the name of each part, and the keys of its parameters."""
    keys: Keys = {}
    for name, part in registry.items():
        what = head(part).split(", (")[0]
        keys[name] = new_key(False, hint=bool, meaning=f"whether {what[:1].lower()}{what[1:]}")
        keys |= keys_of(part, prefix=f"{name}_")
    return keys


def switched_parts(kind: Kind, section: Any) -> list[Any]:
    """Return the parts that a section switches on: shipped parts in the order of the registry, then users' own.

    A part that was registered after the section was made has no key in the section.

    Raises
    ------
    ValueError
        A part refuses its keys.
    """
    asked = [name for name in kind.registry if getattr(section, name, False)]
    own = [name for name, _ in section if is_own(name)]
    return [_part(kind, name, section) for name in asked + own]


def parts_listed(kind: Kind, section: Any) -> list[Any]:
    """Return the parts that a section lists as `parts`; ValueError as in `switched_parts`."""
    return [_part(kind, name, section) for name in section.parts]


def _part(kind: Kind, name: str, section: Any) -> Any:
    if name in kind.registry:
        return part_of(kind.registry[name], section, prefix=f"{name}_")
    return part_named(kind, name, getattr(section, name, None))


def switched_checks(names: Iterable[str], section: str, schema: type[Section], what: str) -> tuple[Check, ...]:
    """Return the checks that keys are set only for switched-on parts; `what` is a word for a part."""
    return tuple(
        Check(
            (f"{section}.{each}", f"{section}.{name}"),
            partial(_is_asked_for, key=f"{section}.{name}", default=known.default, what=what),
        )
        for name in names
        for each, known in keys_in(schema).items()
        if each.startswith(f"{name}_")
    )


def _is_asked_for(value: Any, asked: bool, *, key: str, default: Any, what: str) -> Found:
    """Report a parameter of a part that is not switched on, unless at its default, as in resolved scenes."""
    return None if asked or value == default else f"there is no such {what}: set {key} = true, or leave it out"
