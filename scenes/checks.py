"""Checks across keys: what is wrong though each key on its own is right.

A check declares the keys that it reads, so that it still runs when others are wrong, and stays silent when
one of its own is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from scenes.mistakes import Mistake
from scenes.schema import Section, field_at
from scenes.toml_lines import KeyPath

STEPS_PER_PERIOD = 10
"""A gait's period takes at least this many time steps."""

MOST_STEPS = 1e9
"""More steps than anyone waits for: a slip in the exponent."""


@dataclass(frozen=True)
class Check:
    """One rule that ties keys together.

    Attributes
    ----------
    needs : tuple of str
        Dotted keys that it reads; the first is the one to complain about.
    test : callable
        Called with their values in that order; returns what is wrong, or None.
    """

    needs: tuple[str, ...]
    test: Callable[..., str | None]


def cross_mistakes(
    checks: Iterable[Check], schema: type[Section], data: Mapping[str, Any], found: Iterable[Mistake]
) -> Iterator[Mistake]:
    """Yield what the checks find; a check that reads a key already known to be wrong stays silent."""
    untrusted = [mistake.untrusted for mistake in found]
    for check in checks:
        paths = [tuple(need.split(".")) for need in check.needs]
        if any(_touch(path, wrong) for path in paths for wrong in untrusted):
            continue
        text = check.test(*(_value(schema, data, path) for path in paths))
        if text is not None:
            untrusted.append(paths[0])
            yield Mistake(paths[0], text, suspects=tuple(paths[1:]))


def _touch(path: KeyPath, other: KeyPath) -> bool:
    n = min(len(path), len(other))
    return path[:n] == other[:n]


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


def _step_fits_run(dt_s: float, duration_s: float) -> str | None:
    if dt_s > duration_s:
        return f"got {dt_s} s: must be at most run.duration_s ({duration_s} s)"
    if duration_s / dt_s > MOST_STEPS:
        return f"got {dt_s} s: run.duration_s ({duration_s} s) must take at most {MOST_STEPS:.0e} steps"
    return None


def _step_resolves_period(dt_s: float, period_s: float) -> str | None:
    if dt_s * STEPS_PER_PERIOD <= period_s:
        return None
    return (
        f"got {dt_s} s: must be at most a {STEPS_PER_PERIOD}th of gait.period_s ({period_s} s), "
        "or the wave falls between the steps"
    )


def _recorded_within_run(record_every: int, duration_s: float, dt_s: float) -> str | None:
    steps = max(1.0, duration_s / dt_s)
    if record_every <= steps + 0.5:
        return None
    return f"got {record_every} steps: must be at most run.duration_s / run.dt_s, the {steps:.0f} steps of the run"


def _contraction_ends_in_period(contract_time_s: float, period_s: float, kind: str) -> str | None:
    if kind != "segment_driven" or contract_time_s <= period_s:
        return None
    return (
        f"got {contract_time_s} s: must be at most gait.period_s ({period_s} s), "
        "for a segment ends its contraction before its next one"
    )


def _contraction_resolved(contract_time_s: float, dt_s: float, kind: str) -> str | None:
    if kind != "segment_driven" or contract_time_s >= dt_s:
        return None
    return f"got {contract_time_s} s: must be at least run.dt_s ({dt_s} s), or the steps miss the contraction"


def _segments_have_a_direction(direction: str, kind: str) -> str | None:
    if kind != "segment_driven" or direction != "standing":
        return None
    return "got 'standing': only a travelling_wave can stand; allowed here: 'direct', 'retrograde'"


RUN_CHECKS = (
    Check(("run.dt_s", "run.duration_s"), _step_fits_run),
    Check(("run.record_every", "run.duration_s", "run.dt_s"), _recorded_within_run),
)
GAIT_CHECKS = (
    Check(("run.dt_s", "gait.period_s"), _step_resolves_period),
    Check(("gait.contract_time_s", "gait.period_s", "gait.kind"), _contraction_ends_in_period),
    Check(("gait.contract_time_s", "run.dt_s", "gait.kind"), _contraction_resolved),
    Check(("gait.direction", "gait.kind"), _segments_have_a_direction),
)
