"""One comparable line for each controller in `worm3d bench control`.

With E(c, t) the worst of the seeds of what trial t is about (rms of offset, heading error or speed error) by
controller c, no less than what can be told apart, `FLOORS`,

    score(c) = (prod_t min(E(c, t) / E(pi_los, t), LOST))^(1/T)                                              (B4)

over the T trials that line-of-sight was run in: 1 is as good as line-of-sight with its default gains, 0.5 half its
error. A trial that is lost counts `LOST`, and none counts more: one that a controller does not finish with every seed,
in which it raises an exception, or that has no such value; and one that is about an offset or a heading if the worm
does not go at about the speed asked for (`OFF_SPEED`), since a worm that stands has no offset.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from scenes.studies.bench.control import METRICS, Row
from scenes.studies.bench.control_bars import RIVAL
from scenes.studies.bench.control_trials import HEADING, METRIC, OFFSET, SPEED

FLOORS = {OFFSET: 0.001, HEADING: 0.5, SPEED: 0.005}
"""Errors that cannot be told apart from smaller ones: a fifth of the noise of a place, half that of a compass, and half
a per cent of the speed."""
LOST = 10.0
OFF_SPEED = {"speed_bias_relative": 2.0 / 3.0, "speed_error_rms_relative": 0.9}
"""Shares of the mean speed asked for from which a worm does not go at about that speed. One that stands has 1 of both,
where it is to go there and back of the second only. What ships has at most 0.58 and 0.73 (`open_loop` at the corner,
which it misses), next 0.34 and 0.62 (the same on a side slope)."""


class Score(NamedTuple):
    """What a controller comes to over all trials."""

    controller: str
    score: float | None
    """(B4); None without a trial that line-of-sight was run in."""
    trials: int
    lost: int
    """Trials without a value."""
    errors: dict[str, float | None]
    """Geometric mean of the error over the trials that are about a metric; None where there is none, or one is lost."""
    slowest: float | None
    """Largest 99th percentile of the control steps [ms]."""


def scores(rows: Sequence[Row]) -> list[Score]:
    """Return the scores of all controllers, the best first."""
    of = {(row.trial, row.controller): row for row in rows if row.trial in METRIC}
    trials = [trial for trial, controller in of if controller == RIVAL]
    found = [
        _score(name, {t: of.get((t, name)) for t in trials}, {t: of[t, RIVAL] for t in trials}) for name in names(rows)
    ]
    return sorted(found, key=lambda each: math.inf if each.score is None else each.score)


def names(rows: Sequence[Row]) -> list[str]:
    """Return the controllers of some rows, in their order."""
    return list(dict.fromkeys(row.controller for row in rows))


def _score(name: str, mine: dict[str, Row | None], theirs: dict[str, Row]) -> Score:
    errors = {trial: _error(trial, row) for trial, row in mine.items()}
    ratios = [_ratio(errors[trial], _error(trial, row)) for trial, row in theirs.items()]
    by_metric: dict[str, float | None] = {}
    for metric in FLOORS:
        about = [error for trial, error in errors.items() if METRIC[trial] == metric]
        known = [error for error in about if error is not None]
        by_metric[metric] = _mean(known) if known and len(known) == len(about) else None
    times = [row.metrics["control_step_ms_p99"] for row in mine.values() if row is not None]
    slowest = max((time for time in times if time is not None), default=None)
    lost = sum(error is None for error in errors.values())
    return Score(name, _mean(ratios) if ratios else None, len(ratios), lost, by_metric, slowest)


def _error(trial: str, row: Row | None) -> float | None:
    """Return E, or None where the trial is lost."""
    metric = METRIC[trial]
    value = None if row is None or row.failed or (metric != SPEED and _is_off_speed(row)) else row.metrics[metric]
    return None if value is None else max(abs(value), FLOORS[metric])


def _is_off_speed(row: Row) -> bool:
    """Return whether the worm does not go at about the speed asked for; False where none is asked for."""
    return any(abs(row.metrics[metric] or 0.0) >= most for metric, most in OFF_SPEED.items())


def _ratio(mine: float | None, theirs: float | None) -> float:
    return LOST if mine is None else 1.0 if theirs is None else min(mine / theirs, LOST)


def _mean(values: Sequence[float]) -> float:
    """Return the geometric mean."""
    return math.exp(sum(map(math.log, values)) / len(values))


HEADER = ("controller", "score", "lost", "offset [BL]", "heading [deg]", "speed [%]", "step p99 [ms]")


def cells(rows: Sequence[Row]) -> Iterator[tuple[str, ...]]:
    """Yield a line for each controller."""
    for each in scores(rows):
        yield (
            each.controller,
            "-" if each.score is None else f"{each.score:.3f}",
            f"{each.lost} of {each.trials}",
            *(METRICS[metric].number(error) for metric, error in each.errors.items()),
            METRICS["control_step_ms_p99"].number(each.slowest),
        )
