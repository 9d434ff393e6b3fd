"""Mistakes in a scene, and their report with one line for each mistake."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from scenes.language.reading import MISSING, UNKNOWN, Wrong, read
from scenes.language.schema import Section, key_at, names
from scenes.language.toml import KeyPath, key, line_of, shown
from worm3d.values.spelling import did_you_mean, unknown

S = TypeVar("S", bound=Section)

MOST_LINES = 100
"""Largest number of mistakes that are reported in full. A file with more mistakes is probably not a scene, or has the
same mistake many times."""


@dataclass(frozen=True)
class Mistake:
    """A mistake in a scene."""

    path: KeyPath
    """Wrong key or section."""
    text: str
    """The value found, and the values allowed."""
    suspects: tuple[KeyPath, ...] = ()
    """Further keys that may be the cause. If `path` is not written in the scene, the report gives the line of one of
    them."""
    intended: KeyPath = ()
    """For a misspelt key, the key that the user probably meant."""

    @property
    def untrusted(self) -> KeyPath:
        """The key whose value cannot be used in further checks."""
        return self.intended or self.path


Models = Callable[[str], Sequence[str]]
"""Function that returns the names of the models that have the section of the given name."""


def schema_mistakes(schema: type[Section], data: Mapping[str, Any], models: Models = lambda name: ()) -> list[Mistake]:
    """Return the mistakes that concern a single key: it is unknown, missing, of the wrong type, or out of range."""
    return validated(schema, data, models)[1]


def validated(
    schema: type[S], data: Mapping[str, Any], models: Models = lambda name: ()
) -> tuple[S | None, list[Mistake]]:
    """Return the data as a section, or None if there are mistakes, and the mistakes as in `schema_mistakes`."""
    section, wrong = read(schema, data)
    explained = [_explained(schema, each, models) for each in wrong[:MOST_LINES]]
    return section, explained + [Mistake(each.path, "wrong too") for each in wrong[MOST_LINES:]]


def _explained(schema: type[Section], wrong: Wrong, models: Models) -> Mistake:
    path, found, text = wrong
    if text == UNKNOWN:
        return _unknown(schema, path, "section" if isinstance(found, Mapping) else "key", models)
    known = key_at(schema, path)
    assert known is not None
    if text == MISSING:
        return Mistake(path, f"missing: {known.meaning_in_section}{known.described()}")
    if known.section:
        return Mistake(path, f"got {shown(found)}: must be a section of keys under the header [{_header(path)}]")
    if known.table:
        return Mistake(path, f"got {shown(found)}: must be sections of keys under headers [[{_header(path)}]]")
    words = [(word, word) for word in known.choices if isinstance(word, str)]
    is_word = isinstance(found, str) and not text.endswith("a valid list")
    meant = did_you_mean(found, words) if is_word else None
    advice = f"; did you mean '{meant}'?" if meant else ""
    return Mistake(path, f"got {shown(found)}: {text}{advice}{known.described()}")


def meant_key(schema: type[Section], path: KeyPath) -> str | None:
    """Return the dotted key that the user probably meant by an unknown path, or None if no key is similar."""
    known: KeyPath = ()
    for part in path:
        if key_at(schema, (*known, part)) is None:
            meant = did_you_mean(str(part), names(_home(schema, known)))
            part = meant if meant is not None else part
        known = (*known, part)
    return dotted(known) if known != path and key_at(schema, known) is not None else None


def _home(schema: type[Section], path: KeyPath) -> type[Section]:
    """Return the class of the section at a path, or of the whole scene if there is no section at the path."""
    known = key_at(schema, path) if path else None
    return (known and (known.section or known.table)) or schema


def _unknown(schema: type[Section], path: KeyPath, what: str, models: Models) -> Mistake:
    home = _home(schema, path[:-1])
    meant, text = did_you_mean(str(path[-1]), names(home)), unknown(what, str(path[-1]), names(home))
    if meant:
        return Mistake(path, text, intended=(*path[:-1], meant))
    owners = models(str(path[0])) if len(path) == 1 else ()
    hint = f"; scenes with model = {' or '.join(map(repr, owners))} have it" if owners else ""
    return Mistake(path, text + hint)


def dotted(path: KeyPath) -> str:
    """Return a path in the notation of a scene: `gait.period_s`, `obstacle[1].radius_m`."""
    text = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)
    return text.removeprefix(".")


def _header(path: KeyPath) -> str:
    return ".".join(key(part) for part in path if isinstance(part, str))


def report(mistakes: Iterable[Mistake], lines: Mapping[KeyPath, int], overridden: Iterable[KeyPath]) -> tuple[str, ...]:
    """Return a line of text for each mistake, at most `MOST_LINES` and a line with the number of the others.

    Mistakes in the file come first, by line number, then mistakes in overrides. `lines` are the line numbers of the
    keys in the file, and `overridden` the paths of the keys in overrides.
    """
    overrides, found = list(overridden), list(mistakes)
    placed = [(*_place(mistake, lines, overrides), mistake) for mistake in found[:MOST_LINES]]
    told = [_line(label, mistake) for _, label, mistake in sorted(placed, key=lambda item: item[0])]
    return (*told, f"and {len(found) - MOST_LINES} mistakes more") if len(found) > MOST_LINES else tuple(told)


def _place(mistake: Mistake, lines: Mapping[KeyPath, int], overrides: list[KeyPath]) -> tuple[tuple[int, int], str]:
    """Return the rank of a mistake, for sorting, and a label with the place of the mistake."""
    candidates = (mistake.path, *mistake.suspects)
    for path in candidates:
        for rank, override in enumerate(overrides):
            if _stems_from(path, override, lines):
                return (1, rank), f"override {dotted(override)}"
    line = line_of(lines, next((path for path in candidates if path in lines), mistake.path))
    return (0, line), f"line {line}"


def _stems_from(path: KeyPath, override: KeyPath, lines: Mapping[KeyPath, int]) -> bool:
    """Return whether the mistake at `path` comes from an override.

    It does if the override sets this key or a section that contains it, or if `path` is a section that is not in the
    file and exists only because of the override.
    """
    sets_it = path[: len(override)] == override
    made_it = override[: len(path)] == path and path not in lines
    return sets_it or made_it


def _line(label: str, mistake: Mistake) -> str:
    name = dotted(mistake.path)
    return f"{label}: {mistake.text}" if label == f"override {name}" else f"{label}: {name}: {mistake.text}"
