"""The output of `worm3d list KIND`: the shipped parts of a kind, and the keys of scenes that name such a part."""

from __future__ import annotations

import re
from collections.abc import Iterator

from control.parts import PART_KINDS
from scenes import models
from scenes.language.errors import SceneError
from scenes.language.parts import ITSELF, head
from scenes.language.schema import Key, keys_in
from worm3d.values.named import Kind
from worm3d.values.spelling import unknown


def lines(name: str) -> list[str]:
    """Return a line for each key that names a part of a kind, and a line for each shipped part of this kind.

    Raises
    ------
    SceneError
        If there is no kind of this name.
    """
    if name not in PART_KINDS:
        raise SceneError(unknown("kind of parts", name, [(each, each) for each in PART_KINDS]))
    keys: dict[str, list[str]] = {}
    parts: dict[str, str] = {}
    for model in map(models.get, models.names()):
        for place, known in _keys(model.schema, PART_KINDS[name]):
            keys.setdefault(place, []).append(model.name)
            registry = PART_KINDS[name].registry
            names = known.choices if known else registry
            parts |= {
                each: head(registry[each]) if each in registry else _said(known, each)
                for each in names
                if each != "none"
            }
    takes = [f"{place}, in scenes of {', '.join(of)}" for place, of in keys.items()]
    width = max(map(len, parts), default=0)
    return takes + [f"  {each:<{width}}  {title}".rstrip() for each, title in parts.items()]


def _keys(schema: type, kind: Kind) -> Iterator[tuple[str, Key | None]]:
    """Yield how a scene names a part of a kind, and the key that contains the name.

    The key is None if the names of the parts are themselves keys of a section.
    """
    for name, declared in keys_in(schema).items():
        if declared.section is None:
            continue
        for key, held in getattr(declared.section, "holds", {}).items():
            if held is kind:
                if key == ITSELF:
                    yield f'[{name}] NAME = true or "module:NAME" = true', None
                else:
                    known = keys_in(declared.section)[key]
                    yield f"{name}.{key} = {'NAME or ' if known.names else ''}module:NAME", known
        for key, known in keys_in(declared.section).items():
            if known.table and kind in getattr(known.table, "holds", {}).values():
                yield f"kind = NAME or module:NAME in {name}.{key}", keys_in(known.table)["kind"]


def _said(known: Key | None, name: str) -> str:
    """Return the description of a choice, taken from the meaning of the key."""
    found = re.search(rf"\b{name}: ([^;]*)", known.meaning) if known else None
    return found[1] if found else ""
