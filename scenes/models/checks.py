"""Checks that the scenes of several models share: time steps, gait, memory."""

from __future__ import annotations

import math
from collections.abc import Callable

from scenes.language.checks import Check, Found
from worm3d.values.memory import MOST_MEMORY

STEPS_PER_PERIOD = 10
"""Fewest time steps of a gait's period."""

EQUAL = 1e-9
"""Times that differ by no more than this, relatively, are equal: 0.7 / 0.07 is not quite 10."""


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
