"""A commented scene to start from, written from the schema, so that it cannot go stale."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from scenes.language.loader import Model
from scenes.language.schema import Section, choices, default_text, describe, meaning, own_defaults, section_type
from scenes.language.sweep_section import SWEEP, Sweep
from scenes.language.toml import value


def template(model: Model) -> str:
    """Return a scene of a model with every key at its default, its meaning, unit and range as a comment."""
    head = (
        f"# A scene for worm3d: {model.title}.",
        "# 'worm3d check FILE' checks it, 'worm3d run FILE' runs it; keys that are left out keep their defaults.",
        "",
    )
    end = (
        "",
        f"# [{SWEEP}]  # without the first '#' here and before 'vary =', a run is a sweep over these values",
        *(f"# {name}: {meaning(field)}" for name, field in Sweep.model_fields.items()),
        "# vary = { seed = [1, 2, 3] }",
    )
    given = {"model": model.name, "title": "My worm", "says": "what to look for, in one line"}
    return "\n".join((*head, *_section(model.schema, "", given), *end)) + "\n"


def _section(schema: type[Section], prefix: str, given: dict[str, Any]) -> Iterator[str]:
    for name, field in schema.model_fields.items():
        inner = section_type(field)
        if inner:
            yield from ("", f"[{prefix}{name}]  # {_first_sentence(inner)}")
            yield from _section(inner, f"{prefix}{name}.", {})
        else:
            allowed = ", ".join(map(value, choices(field)))
            one_of = f"; one of {allowed}" if allowed else ""
            yield f"# {meaning(field)}{describe(field, with_default=False)}{one_of}"
            default = given.get(name, field.default)
            if default is not None and "kind" in schema.model_fields:
                default = own_defaults(field).get(schema.model_fields["kind"].default, default)
            yield f"# {name} is left out: {default_text(field)}" if default is None else f"{name} = {value(default)}"


def _first_sentence(section: type[Section]) -> str:
    return (section.__doc__ or "").split(".")[0]
