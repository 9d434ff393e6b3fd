"""A commented scene as a starting point, generated from the schema and therefore always up to date."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from textwrap import wrap
from typing import Any

from scenes.language.errors import SceneError
from scenes.language.mistakes import report, schema_mistakes
from scenes.language.overrides import apply_overrides
from scenes.language.parts import head
from scenes.language.schema import Section, keys_in
from scenes.language.sweep_section import SWEEP, Sweep
from scenes.language.toml import key, value
from scenes.models.base import Model
from scenes.models.loading import with_own_parts

WIDTH = 118
"""Largest width of a comment above a key. Editors show longer lines only in part."""


def template(model: Model[Any], overrides: Iterable[str] = ()) -> str:
    """Return a scene of a model. Every key has its default and a comment with its meaning, unit and range.

    `overrides` are items `section.key=value` that replace defaults. They may name a user's own parts.

    Raises
    ------
    SceneError
        If there are mistakes in the overrides, with one line for each mistake.
    """
    data, paths, mistakes = apply_overrides({}, overrides)
    model, given, wrong = with_own_parts(model, data)
    mistakes += wrong + [
        each
        for each in schema_mistakes(model.schema, given)
        if any(path[: len(each.path)] == each.path for path in paths)
    ]
    if mistakes:
        raise SceneError(*report(mistakes, {}, paths))
    head = (
        f"# A scene for worm3d: {model.title}.",
        "# 'worm3d check FILE' checks it, 'worm3d run FILE' runs it; keys that are left out keep their defaults.",
        "",
    )
    end = (
        "",
        f"# [{SWEEP}]  # without the first '#' here and before 'vary =', a run is a sweep over these values",
        *(f"# {name}: {known.meaning}" for name, known in keys_in(Sweep).items()),
        "# vary = { seed = [1, 2, 3] }",
    )
    said = {"title": "My worm", "says": "what to look for, in one line", **given, "model": model.name}
    return "\n".join((*head, *_section(model.schema, "", said), *end)) + "\n"


def _section(schema: type[Section], prefix: str, given: Mapping[str, Any]) -> Iterator[str]:
    keys = keys_in(schema)
    kind = given.get("kind", keys["kind"].default) if "kind" in keys else ""
    for name, known in keys.items():
        if known.section:
            yield from ("", f"[{prefix}{key(name)}]  # {head(known.section)}")
            yield from _section(known.section, f"{prefix}{key(name)}.", given.get(name, {}))
        else:
            allowed = ", ".join(map(value, known.choices))
            one_of = f"; one of {allowed}" if allowed else ""
            meaning = f"{known.meaning_in_section}{known.described(with_default=False)}{one_of}"
            yield from _comment(meaning)
            default = given.get(name, known.default)
            if default is not None:
                default = given.get(name, known.defaults_by_kind.get(kind, default))
            if known.is_required and name not in given:
                yield f"# {name} = ?  must be given"
            elif default is None:
                yield from _comment(f"{name} is left out: {known.default_text}")
            else:
                yield f"{name} = {value(default)}"


def _comment(text: str) -> Iterator[str]:
    return (f"# {line}" for line in wrap(text, WIDTH, break_long_words=False, break_on_hyphens=False))
