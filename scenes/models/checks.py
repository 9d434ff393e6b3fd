"""Checks across keys: what is wrong though each key on its own is right.

A check declares the keys that it reads, so that it still runs when others are wrong, and stays silent when
one of its own is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from scenes.language.mistakes import Mistake, dotted
from scenes.language.schema import Section, default_text, field_at, only_for
from scenes.language.toml_lines import KeyPath
from worm3d.values.memory import MOST_MEMORY

STEPS_PER_PERIOD = 10
"""A gait's period takes at least this many time steps."""

EQUAL = 1e-9
"""Times that differ by no more than this, relatively, are equal: 0.7 / 0.07 is not quite 10."""

Found = str | Mapping[str, str] | None
"""What a check finds: a text about its first key, texts by key of which one is told, or nothing."""


@dataclass(frozen=True)
class Check:
    """One rule that ties keys together.

    Attributes
    ----------
    needs : tuple of str
        Dotted keys, or sections, that it reads; the first is the one to complain about.
    test : callable
        Called with their values in that order; returns what is wrong, or None. Where it returns texts by key,
        that of the first key is told that the user wrote, in an override or else in the file.
    """

    needs: tuple[str, ...]
    test: Callable[..., Found]


def cross_mistakes(
    checks: Iterable[Check],
    schema: type[Section],
    data: Mapping[str, Any],
    found: Iterable[Mistake],
    overridden: Iterable[KeyPath] = (),
) -> Iterator[Mistake]:
    """Yield what the checks find; a check that reads a key already known to be wrong stays silent.

    So does one whose written keys include all that another complains of: to mend that one may mend it too.
    """
    untrusted = {mistake.untrusted for mistake in found}
    around = {path[:n] for path in untrusted for n in range(len(path))}
    overrides = tuple(overridden)
    failing: list[tuple[frozenset[KeyPath], Mistake]] = []
    for check in checks:
        paths = [tuple(need.split(".")) for need in check.needs]
        written = frozenset(key for path in paths for key in _written_below(data, path))
        known = any(path in around or any(path[: n + 1] in untrusted for n in range(len(path))) for path in paths)
        if known or any(blamed <= written for blamed, _ in failing):
            continue
        text = check.test(*(_value(schema, data, path) for path in paths))
        if text is not None:
            failing = [(blamed, mistake) for blamed, mistake in failing if not written <= blamed]
            failing.append((written, _mistake(text, paths, data, overrides)))
    return (mistake for _, mistake in failing)


def _mistake(
    text: str | Mapping[str, str], paths: Sequence[KeyPath], data: Mapping[str, Any], overrides: Any
) -> Mistake:
    """Return the mistake at the key that the user wrote: in an override, in the file, else the first."""

    def rank(path: KeyPath) -> int:
        if not isinstance(text, str) and any(_touch(path, override) for override in overrides):
            return 0
        return 1 if _is_written(data, path) else 2

    candidates = paths if isinstance(text, str) else [path for path in paths if dotted(path) in text]
    about = min(candidates, key=rank)
    others = tuple(path for path in paths if path != about)
    return Mistake(about, text if isinstance(text, str) else text[dotted(about)], suspects=others)


def _touch(path: KeyPath, other: KeyPath) -> bool:
    n = min(len(path), len(other))
    return path[:n] == other[:n]


def _is_written(data: Mapping[str, Any], path: KeyPath) -> bool:
    return any(True for _ in _written_below(data, path))


def _written_below(data: Any, path: KeyPath) -> Iterator[KeyPath]:
    """Yield the path of each key that the data have at, or below, `path`."""
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
    here: Any = data
    for key in path:
        if not isinstance(here, Mapping) or key not in here:
            field = field_at(schema, path)
            if field is None:
                raise AssertionError(f"a check needs {path}, which the schema does not have")
            return field.default
        here = here[key]
    return here


def _step_fits_run(dt_s: float, duration_s: float) -> Found:
    if dt_s <= duration_s * (1.0 + EQUAL):
        return None
    return {
        "run.dt_s": f"got {dt_s} s: must be at most run.duration_s ({duration_s} s)",
        "run.duration_s": f"got {duration_s} s: must be at least run.dt_s ({dt_s} s)",
    }


def _step_resolves_period(dt_s: float, period_s: float) -> Found:
    if dt_s * STEPS_PER_PERIOD <= period_s * (1.0 + EQUAL):
        return None
    why = "or the wave falls between the steps"
    return {
        "run.dt_s": f"got {dt_s} s: must be at most a {STEPS_PER_PERIOD}th of gait.period_s ({period_s} s), {why}",
        "gait.period_s": f"got {period_s} s: must be at least {STEPS_PER_PERIOD} times run.dt_s ({dt_s} s), {why}",
    }


def _recorded_to_the_end(record_every: int, duration_s: float, dt_s: float) -> Found:
    ratio = duration_s / dt_s
    if ratio < 0.5 or ratio > 1e12:
        return None  # other checks tell
    steps = max(1, round(ratio))
    if record_every > steps:
        text = f"must be at most run.duration_s / run.dt_s, the {steps} steps of the run"
    elif steps % record_every:
        below = _greatest_divisor(steps, record_every)
        text = (
            f"must divide the {steps} steps of the run (run.duration_s / run.dt_s), or its last state is not stored; "
            f"{below} does"
        )
    else:
        return None
    found = f"run.record_every ({record_every}) {text}"
    return {
        "run.record_every": f"got {record_every}: {text}",
        "run.duration_s": f"got {duration_s} s: {found}",
        "run.dt_s": f"got {dt_s} s: {found}",
    }


def _greatest_divisor(number: int, most: int) -> int:
    """Return the greatest divisor of a number of at most 1e12 that is no greater than `most`."""
    small = [n for n in range(1, min(most, math.isqrt(number)) + 1) if number % n == 0]
    return max(divisor for n in small for divisor in (n, number // n) if divisor <= most)


def _contraction_ends_in_period(contract_time_s: float, period_s: float, kind: str) -> Found:
    if kind != "segment_driven" or contract_time_s <= period_s:
        return None
    why = "for a segment ends its contraction before its next one"
    return {
        "gait.contract_time_s": f"got {contract_time_s} s: must be at most gait.period_s ({period_s} s), {why}",
        "gait.period_s": f"got {period_s} s: must be at least gait.contract_time_s ({contract_time_s} s), {why}",
    }


def _contraction_resolved(contract_time_s: float, dt_s: float, kind: str) -> Found:
    if kind != "segment_driven" or contract_time_s >= dt_s * (1.0 - EQUAL):
        return None
    why = "or the steps miss the contraction"
    return {
        "gait.contract_time_s": f"got {contract_time_s} s: must be at least run.dt_s ({dt_s} s), {why}",
        "run.dt_s": f"got {dt_s} s: must be at most gait.contract_time_s ({contract_time_s} s), {why}",
    }


def _segments_have_a_direction(direction: str, kind: str) -> Found:
    if kind == "travelling_wave" or direction != "standing":
        return None
    return "got 'standing': only a travelling_wave can stand; allowed here: 'direct', 'retrograde'"


def _of_this_kind(value: Any, kind: str, *, key: str, default: Any, only: tuple[str, ...], usual: str) -> Found:
    # A key at its default does nothing: resolved scenes and templates hold all keys.
    if kind in only or value == default or (isinstance(value, list) and tuple(value) == default):
        return None
    kinds = " or ".join(map(repr, only))
    return (
        f"only for {key} = {kinds}, which this scene is not ('{kind}'): leave it out (default {usual}), or change {key}"
    )


def too_much_memory(
    needed: float,
    steps: float,
    segments: int,
    remedy: str = "a shorter run.duration_s, a longer run.dt_s or fewer worm.segments",
) -> Found:
    """Tell of a scene that would not fit into memory; `needed` in bytes."""
    if needed <= MOST_MEMORY:
        return None
    text = (
        f"got {steps:.3g} steps of {segments} segments, about {needed / 1e9:.3g} GB of memory: must be at most "
        f"{MOST_MEMORY / 1e9:g} GB; use {remedy}"
    )
    keys = ("run.dt_s", "run.duration_s", "worm.segments")
    return dict.fromkeys(keys, text)


def memory_check(bytes_per_step: Callable[[int], float]) -> Check:
    """Return the check that a run, every step of which is kept until its end, fits into memory."""

    def fits(dt_s: float, duration_s: float, segments: int) -> Found:
        steps = duration_s / dt_s
        return too_much_memory(steps * bytes_per_step(segments), steps, segments)

    return Check(("run.dt_s", "run.duration_s", "worm.segments"), fits)


def kind_checks(schema: type[Section], section: str = "gait", by: str = "kind") -> tuple[Check, ...]:
    """Return the checks that no key is set that is for other values of the section's key `by`."""
    return tuple(
        Check(
            (f"{section}.{name}", f"{section}.{by}"),
            partial(_of_this_kind, key=f"{section}.{by}", default=field.default, only=only, usual=default_text(field)),
        )
        for name, field in schema.model_fields.items()
        if (only := only_for(field))
    )


RUN_CHECKS = (
    Check(("run.dt_s", "run.duration_s"), _step_fits_run),
    Check(("run.record_every", "run.duration_s", "run.dt_s"), _recorded_to_the_end),
)
GAIT_CHECKS = (
    Check(("run.dt_s", "gait.period_s"), _step_resolves_period),
    Check(("gait.contract_time_s", "gait.period_s", "gait.kind"), _contraction_ends_in_period),
    Check(("gait.contract_time_s", "run.dt_s", "gait.kind"), _contraction_resolved),
    Check(("gait.direction", "gait.kind"), _segments_have_a_direction),
)
