"""The page with all keys of scenes, from the schemas of the models."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pages.text import Definition, bullets, code, definitions, page, prose, sentence, table
from scenes import models
from scenes.language.schema import OWN_KINDS, Key, Section, keys_in
from scenes.language.sweep_section import Outside
from scenes.language.toml import value
from scenes.models.sections import Settings
from worm3d.values.parameters import EACH

PAGE_INTRODUCTION = """
A scene is a TOML file with sections. This page lists all sections and their keys, with unit, range, default and
meaning. The program makes the page from the same declarations with which `worm3d check` checks a scene. `worm3d init
FILE` writes all keys of a model into a file. `-o section.key=value` changes a key for one run.

A key without a default must be given. The name of a key ends in the unit, and the parameter in Python has the same name
without the unit. Where the names differ in another way, the text has the name in Python. Keys that end in `_deg` are in
degrees.

A section may have a key `kind` that chooses a part, such as a gait. Some keys exist only for some kinds, and the text
names these kinds. `module:NAME` as a kind means a part of your own, see [parts of your own](../guides/parts.md).
""".strip()

Place = tuple[str, type[Section]]
"""Name of a section in a scene, such as `gait`, and the class with its keys."""


def scene_keys() -> str:
    """Return the page."""
    blocks = [PAGE_INTRODUCTION, "## Models", _models(), "## Before the first section", _keys_of_the_top()]
    for name, owners in _sections().items():
        blocks.append(f"## [{name}]")
        for schema, names in owners.items():
            blocks += [_title(name, schema, names, alone=len(owners) == 1), *_section(name, schema)]
    for name, known in keys_in(Outside).items():
        assert known.section is not None
        blocks += [f"## [{name}], for all models", *_section(name, known.section)]
    return page("Keys of scenes", *blocks)


def every_key() -> set[str]:
    """Return the names of all keys."""
    schemas = [schema for owners in _sections().values() for schema in owners]
    return {name for schema in schemas for name in _names(schema)}


def _names(schema: type[Section]) -> Iterator[str]:
    for name, known in keys_in(schema).items():
        yield name
        if inner := known.section or known.table:
            yield from _names(inner)


def _models() -> str:
    rows = []
    for model in map(models.get, models.names()):
        sections = [name for name, known in keys_in(model.schema).items() if known.section]
        rows.append([code(model.name), sentence(model.title), ", ".join(map(code, sections))])
    return table(["`model`", "meaning", "sections"], rows)


def _keys_of_the_top() -> str:
    return definitions(entry(name, known) for name, known in keys_in(Settings).items() if not known.section)


def _sections() -> dict[str, dict[type[Section], list[str]]]:
    """Return the classes of each section, with the models that use the class."""
    found: dict[str, dict[type[Section], list[str]]] = {}
    for model in map(models.get, models.names()):
        for name, known in keys_in(model.schema).items():
            if known.section:
                found.setdefault(name, {}).setdefault(known.section, []).append(model.name)
    return found


def _title(name: str, schema: type[Section], owners: list[str], *, alone: bool) -> str:
    listed = ", ".join(map(code, owners))
    said = sentence((schema.__doc__ or "").split("\n")[0])
    return f"In scenes of {listed}. {said}" if alone else f"### [{name}] in scenes of {listed}\n\n{said}"


def _section(name: str, schema: type[Section]) -> Iterator[str]:
    """Yield the keys of a section, and then the sections within it."""
    keys = keys_in(schema)
    kinds = [word for word in keys["kind"].choices if isinstance(word, str)] if "kind" in keys else []
    yield definitions(entry(each, known, kinds) for each, known in keys.items() if not known.section)
    for each, known in keys.items():
        inner = known.section or known.table
        if inner is not None:
            mark = f"[[{name}.{each}]]" if known.table else f"[{name}.{each}]"
            yield f"**`{mark}`** {sentence((inner.__doc__ or '').split(chr(10))[0])}"
            yield from _section(f"{name}.{each}", inner)


def entry(name: str, known: Key, kinds: Sequence[str] = ()) -> Definition:
    """Return the entry of a key; `kinds` are the kinds of the section."""
    meaning, items = split_meaning(known)
    words = bullets(f"{code(value(word))}: {prose(text)}" if text else code(value(word)) for word, text in items)
    text = " ".join(
        filter(None, [meaning and sentence(meaning, known.choices), _only(known, kinds), _in_python(name, known)])
    )
    return code(name), [text, words, numbers(known)]


def _in_python(name: str, known: Key) -> str:
    """Return the name of the parameter in Python, if the key does not contain the name."""
    others = [each for each in known.parameters if each not in name]
    also = " also" if len(others) < len(known.parameters) else ""
    return f"In Python{also}: {' or '.join(map(code, others))}." if others else ""


def _only(known: Key, kinds: Sequence[str]) -> str:
    """Return the kinds that have a key, or the kinds that do not have the key if these are fewer."""
    others = [kind for kind in kinds if not known.is_for(kind)]
    if known.only and kinds and len(others) < len(known.only) and OWN_KINDS not in known.only:
        return f"Not for {', '.join(map(code, others))}."
    return f"Only for {', '.join(map(code, known.only))}." if known.only else ""


def numbers(known: Key) -> str:
    """Return unit, range, form and default of a key."""
    span = known.span.replace("<=", "≤")
    form = EACH[known.each][2].replace(" or one for each", ", or a list with a number for each") if known.each else ""
    parts = {"Unit": known.unit and code(known.unit), "Range": span and code(span), "Form:": form}
    parts["Default:"] = _default(known)
    return " ".join(f"{label} {text}." for label, text in parts.items() if text)


def _default(known: Key) -> str:
    if known.is_required:
        return "none, the key must be given"
    if known.table:
        return "none"
    kinds: dict[str, list[str]] = {}
    for kind, default in known.defaults_by_kind.items():
        kinds.setdefault(value(default), []).append(code(kind))
    own = "; ".join(f"{code(default)} for {', '.join(names)}" for default, names in kinds.items())
    return own or (prose(known.left_out) if known.left_out else code(value(known.default)))


def split_meaning(known: Key) -> tuple[str, list[tuple[str, str]]]:
    """Return the meaning of a key, and the meaning of each word that the key accepts."""
    head: list[str] = []
    said: dict[str, list[str]] = {word: [] for word in known.choices if isinstance(word, str)}
    into = head
    for part in known.meaning.split("; "):
        word, colon, text = part.partition(": ")
        is_word = bool(colon) and word in said
        into = said[word] if is_word else into
        into.append(text if is_word else part)
    return "; ".join(head), [(word, "; ".join(text)) for word, text in said.items()] if said else []
