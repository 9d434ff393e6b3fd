"""Checks that involve several keys, for scenes whose keys are each valid on their own.

A check declares the keys that it reads. If one of these keys is wrong, the check is skipped. If only other keys are
wrong, the check runs, so that a user sees as many mistakes as possible at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from operator import is_
from typing import Any

from scenes.language.mistakes import Mistake
from scenes.language.reading import read
from scenes.language.schema import Key, Section, few, key_at, keys_in
from scenes.language.toml import KeyPath, path_of
from worm3d.values import named

Found = str | Mapping[str, str] | None
"""Result of a check: an error text about the first key, or error texts by key, or None if there is no error.

Of several texts only one is reported (see `Check.test`).
"""


@dataclass(frozen=True)
class Check:
    """A rule about the values of several keys."""

    needs: tuple[str, ...]
    """Dotted keys or sections that the check reads. A section is passed to `test` as an object. If `test` returns
    a single text, the error is reported at the first key."""
    test: Callable[..., Found]
    """Function of the values of these keys, in this order, that returns the error or None. If the function returns
    texts by key, the reported text is the text for the first key that the user wrote in an override, or, if there is
    none, in the file."""
    builds: bool = False
    """Whether the test builds an object from whole sections. If keys of these sections are wrong, the test still runs,
    with the defaults of these keys. If the test reports a key, it is repeated with the default of this key, until it
    reports no further key."""

    @cached_property
    def paths(self) -> tuple[tuple[str, ...], ...]:
        """Paths of the keys that the check reads."""
        return tuple(tuple(need.split(".")) for need in self.needs)

    @cached_property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections that contain these keys, and of keys outside all sections."""
        return tuple(dict.fromkeys(path[0] for path in self.paths))


LACKING = object()
"""Placeholder for a section that lacks a mandatory key."""

Passed = dict[Check, tuple[Any, ...]]
"""For each check that found no error: the data of its sections when it ran."""


def cross_mistakes(
    checks: Iterable[Check],
    schema: type[Section],
    data: Mapping[str, Any],
    found: Iterable[Mistake],
    overridden: Iterable[KeyPath] = (),
    passed: Passed | None = None,
    filled: Mapping[str, Any] | None = None,
) -> Iterator[Mistake]:
    """Yield the mistakes that the checks find.

    A check that reads a wrong key is skipped. A mistake is also left out if its written keys include all keys of
    another mistake, since correcting the other mistake may correct this one too.

    Parameters
    ----------
    checks, schema, data
        The checks, the schema of the scene, and the data of the scene.
    found
        Mistakes that are already known.
    overridden
        Paths of the keys in overrides.
    passed
        Checks that found no error earlier. They are skipped if the data of their sections are still the same objects.
        Checks that find no error now are added.
    filled
        Data with the defaults of the chosen kinds (`with_own_defaults`); `data` if left out.
    """
    filled = data if filled is None else filled
    passed = {} if passed is None else passed
    mistakes = [*found]
    untrusted = {mistake.untrusted for mistake in mistakes}
    wrong = untrusted | {mistake.path for mistake in mistakes}
    around = {path[:n] for path in untrusted for n in range(len(path))}
    overrides = tuple(overridden)
    failing: list[tuple[frozenset[KeyPath], Mistake]] = []
    own = named.names_in(data)
    for check in checks:
        paths, read = check.paths, tuple(data.get(name) for name in check.sections)
        if check in passed and all(map(is_, read, passed[check])):
            continue
        if untrusted and any(path[: n + 1] in untrusted for path in paths for n in range(len(path))):
            continue
        if not check.builds and not around.isdisjoint(paths):
            continue
        if any(blamed and blamed <= _written(data, paths) for blamed, _ in failing):
            continue
        if any(key_at(schema, path) is None for path in paths):
            continue  # the key belongs to a shipped kind, but the scene chooses a user's own part instead
        told = [*_told(check, schema, data, filled, wrong, overrides)]
        if not (told or (check.builds and wrong)):
            passed[check] = read
        for written, mistake in told:
            if any(mistake.text == other.text and (own or mistake.path == other.path) for _, other in failing):
                continue  # the same error, raised by the user's own part in another check
            failing = [(blamed, other) for blamed, other in failing if not (written and written <= blamed)]
            failing.append((written, mistake))
    return (mistake for _, mistake in failing)


def _told(
    check: Check,
    schema: type[Section],
    data: Mapping[str, Any],
    filled: Mapping[str, Any],
    wrong: set[KeyPath],
    overrides: tuple[KeyPath, ...],
) -> Iterator[tuple[frozenset[KeyPath], Mistake]]:
    """Yield the mistakes that a check finds, each with the written keys that may be its cause.

    A check that builds an object may find several mistakes (`Check.builds`). `wrong` are the keys known to be wrong.
    """
    known = _without(filled, wrong) if check.builds else filled
    partly = check.builds and any(path[:1] in check.paths for path in wrong)
    while (text := _tested(check, schema, known, data)) is not None:
        mistake = _mistake(text, check.paths, data, overrides)
        blamed = check.paths if isinstance(text, str) or not check.builds else [path_of(key) for key in text]
        if partly and (isinstance(text, str) or not (_is_written(known, mistake.path) and wrong.isdisjoint(blamed))):
            return  # the cause may be a default that was put in place of a wrong value
        yield _written(data, blamed), mistake
        if not check.builds or mistake.path in check.paths or not _is_written(known, mistake.path):
            return
        wrong, partly = {mistake.path}, True
        known = _without(known, wrong)


def _without(data: Mapping[str, Any], paths: Iterable[KeyPath]) -> dict[str, Any]:
    """Return the data without the given keys of sections."""
    gone = {path[:2] for path in paths}
    return {
        section: {key: value for key, value in given.items() if (section, key) not in gone}
        if isinstance(given, Mapping)
        else given
        for section, given in data.items()
    }


def _tested(check: Check, schema: type[Section], known: Mapping[str, Any], data: Mapping[str, Any]) -> Found:
    """Return the result of a check, or None if a mandatory key of a section is missing.

    If a user's own part raises an error in the check, the error is the result.
    """
    values = [_value(schema, known, path) for path in check.paths]
    if LACKING in values:
        return None
    try:
        return check.test(*values)
    except named.EXCEPTIONS as error:
        if own := named.names_in(data):
            return named.raised(error, own)
        raise


def _written(data: Mapping[str, Any], paths: Iterable[KeyPath]) -> frozenset[KeyPath]:
    return frozenset(key for path in paths for key in _written_below(data, path))


def _mistake(
    text: str | Mapping[str, str], paths: Sequence[KeyPath], data: Mapping[str, Any], overrides: Any
) -> Mistake:
    """Return the mistake at the most likely key.

    This is the first key with a text that the user wrote in an override, or if there is none, in the file, or if there
    is none, the first key of the check.
    """

    def rank(path: KeyPath) -> int:
        if not isinstance(text, str) and any(_touch(path, override) for override in overrides):
            return 0
        return 1 if _is_written(data, path) else 2

    order = {path: n for n, path in enumerate(paths)}
    texts: Mapping[KeyPath, str] = (
        dict.fromkeys(paths, text) if isinstance(text, str) else {path_of(k): text[k] for k in text}
    )
    about = min(sorted(texts, key=lambda path: order.get(path, order.get(path[:1], len(order)))), key=rank)
    others = tuple(dict.fromkeys(key for path in paths for key in (*_written_below(data, path), path) if key != about))
    return Mistake(about, texts[about], suspects=others)


def _touch(path: KeyPath, other: KeyPath) -> bool:
    n = min(len(path), len(other))
    return path[:n] == other[:n]


def _is_written(data: Mapping[str, Any], path: KeyPath) -> bool:
    return any(True for _ in _written_below(data, path))


def _written_below(data: Any, path: KeyPath) -> Iterator[KeyPath]:
    """Yield the paths of all keys in the data at or below `path`."""
    here = data
    for key in path:
        if not isinstance(here, Mapping) or key not in here:
            return
        here = here[key]
    if isinstance(here, Mapping):
        for key in here:
            yield from _written_below(data, (*path, key))
    else:
        yield path


def _value(schema: type[Section], data: Mapping[str, Any], path: KeyPath) -> Any:
    known = key_at(schema, path)
    assert known is not None
    here: Any = data
    for key in path:
        if not isinstance(here, Mapping) or key not in here:
            return known.default
        here = here[key]
    section = known.section if isinstance(here, Mapping) else None
    return here if section is None else read(section, here)[0] or LACKING


def kind_checks(schema: type[Section], section: str = "gait", by: str = "kind") -> tuple[Check, ...]:
    """Return the checks that each key of a section belongs to the kind of the section, the value of its key `by`."""
    return tuple(
        Check((f"{section}.{name}", f"{section}.{by}"), partial(of_this_kind, by=f"{section}.{by}", known=known))
        for name, known in keys_in(schema).items()
        if known.only or known.kinds_by_word
    )


def of_this_kind(value: Any, kind: str, *, by: str, known: Key) -> Found:
    """Return an error if a key, or the chosen value of a key, belongs to other kinds than `kind`, the value of `by`.

    A key with its default value is accepted.
    """
    if known.is_for(kind):
        allowed = known.words_for(kind)  # empty for a user's own part, which allows all words
        if not allowed or value in allowed or value not in known.choices:
            return None
        return f"got {value!r}: not for {by} = {kind!r}; allowed here: {', '.join(map(repr, allowed))}"
    defaults = (known.default, *known.defaults_by_kind.values())  # stored scenes and templates contain all keys
    if (tuple(value) if isinstance(value, list) else value) in defaults:
        return None
    kinds = " or ".join(few([repr(each) for each in known.only])) or "others"
    return (
        f"only for {by} = {kinds}, but this scene has '{kind}': leave it out (default {known.default_text}), "
        f"or change {by}"
    )
