"""Sections that switch on parts of a registry.

For each part, the section has a key with the name of the part, which switches it on, and a key for each parameter,
which begins with this name.
"""

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
    """Return the parts that a section switches on, first the shipped parts and then the user's own parts.

    The shipped parts are in the order of the registry. A part that was registered after the section was defined has no
    key in the section, and is off.

    Raises
    ------
    ValueError
        If the parameters of a part are invalid.
    """
    asked = [name for name in kind.registry if getattr(section, name, False)]
    own = [name for name, _ in section if is_own(name)]
    return [_part(kind, name, section) for name in asked + own]


def parts_listed(kind: Kind, section: Any) -> list[Any]:
    """Return the parts listed in the key `parts` of a section.

    Raise ValueError if the parameters of a part are invalid.
    """
    return [_part(kind, name, section) for name in section.parts]


def _part(kind: Kind, name: str, section: Any) -> Any:
    if name in kind.registry:
        return part_of(kind.registry[name], section, prefix=f"{name}_")
    return part_named(kind, name, getattr(section, name, None))


def switched_checks(names: Iterable[str], section: str, schema: type[Section], what: str) -> tuple[Check, ...]:
    """Return the checks that no parameter is set for a part that is off.

    `what` is the word for a part in error messages.
    """
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
    """Return an error if a parameter is set for a part that is not switched on.

    A parameter with its default value is accepted, since stored scenes contain all parameters.
    """
    return None if asked or value == default else f"there is no such {what}: set {key} = true, or leave it out"
