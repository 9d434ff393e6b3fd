"""Parts by kind, as `worm3d list KIND` names them: those that ship, and the keys of scenes that take one."""

from __future__ import annotations

import re
from collections.abc import Iterator

from control.parts import KINDS
from scenes import models
from scenes.language.errors import SceneError
from scenes.language.parts import ITSELF, head
from scenes.language.schema import Key, keys_in
from worm3d.values.named import Kind
from worm3d.values.spelling import unknown


def lines(name: str) -> list[str]:
    """Return a line for each key that takes a part of a kind, and one for each part of this kind that ships.

    Raises
    ------
    SceneError
        There is no such kind.
    """
    if name not in KINDS:
        raise SceneError(unknown("kind of parts", name, [(each, each) for each in KINDS]))
    keys: dict[str, list[str]] = {}
    parts: dict[str, str] = {}
    for model in map(models.get, models.names()):
        for place, known in _keys(model.schema, KINDS[name]):
            keys.setdefault(place, []).append(model.name)
            registry = KINDS[name].registry
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
    """Yield what is written in a scene to take a part of a kind, and its key; None where a section has the parts."""
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
    """Return what the meaning of a key says of one of its choices."""
    found = re.search(rf"\b{name}: ([^;]*)", known.meaning) if known else None
    return found[1] if found else ""
