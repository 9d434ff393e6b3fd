"""Sections in which any parts of a registry are asked for by name: `name = true`, and keys that begin with the name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, TypeVar

from scenes.language.checks import Check, Found
from scenes.language.parts import Keys, keys_of, part_of
from scenes.language.schema import Section, setting

T = TypeVar("T")


def switched_keys(registry: Mapping[str, type]) -> Keys:
    """Return the keys of all parts; one is there if it is asked for by its name."""
    keys: Keys = {}
    for name, part in registry.items():
        what = (part.__doc__ or "").split(".")[0].split(", (")[0]
        keys[name] = bool, setting(False, title=f"whether {what[:1].lower()}{what[1:]}")
        keys |= keys_of(part, prefix=f"{name}_")
    return keys


def switched_parts(registry: Mapping[str, type[T]], section: Any) -> list[T]:
    """Return the parts that a section asks for, in the order of the registry; ValueError where one refuses its keys.

    A part that was registered after the section was made has no key there.
    """
    return [
        part_of(part, section, prefix=f"{name}_") for name, part in registry.items() if getattr(section, name, False)
    ]


def switched_checks(registry: Mapping[str, type], section: str, schema: type[Section], what: str) -> tuple[Check, ...]:
    """Return the checks that no key is set of a part that is not asked for; `what` is a word for a part."""
    return tuple(
        Check(
            (f"{section}.{key}", f"{section}.{name}"),
            partial(_is_asked_for, key=f"{section}.{name}", default=field.default, what=what),
        )
        for name in registry
        for key, field in schema.model_fields.items()
        if key.startswith(f"{name}_")
    )


def _is_asked_for(value: Any, asked: bool, *, key: str, default: Any, what: str) -> Found:
    """Tell of a parameter of a part that is not asked for; at its default it says nothing, as in resolved scenes."""
    return None if asked or value == default else f"there is no such {what}: set {key} = true, or leave it out"
