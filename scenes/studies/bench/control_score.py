"""The score of a controller over the trials of `worm3d study control`, one comparable line for each controller.

With the error (B5), which is 1 for a lost run,

    score(c) = (prod_t E(c, t) / E(pi_los, t))^(1/T),   E = max(error, FLOOR)                                 (B6)

over all T trials: line-of-sight has 1, a controller with half the errors 0.5. A lost trial is as bad as a worm at rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from scenes.records.text import Column
from scenes.studies.bench.control import DONE, Found, Value

RIVAL = "pi_los"
FLOOR = 0.005
"""Error that counts as zero: half a per cent of the wanted way, 1 mm in a window at 0.08 m/s. The rocking by waves
leaves about as much."""


class Score(NamedTuple):
    """Results of a controller over all trials."""

    controller: str
    score: Value
    """(B6); None where line-of-sight was not run."""
    median: float
    """Median of the errors; `worst` is their maximum."""
    worst: float
    lost: int
    """Number of trials that are lost."""
    slowest: Value
    """Least real-time factor, including the controller's own time."""
    step: Value
    """Median of the control steps, as a share of the control period, in the trial with the largest value."""
    late: Value
    """99th percentile of the control steps, as a share of the control period, in the trial with the largest value."""


def scores(found: Sequence[Found]) -> list[Score]:
    """Return the scores of all controllers, the best first."""
    of = {(each.trial, each.controller): each.error for each in found}
    each = [_score(name, [one for one in found if one.controller == name], of) for name in names(found)]
    return sorted(each, key=lambda one: math.inf if one.score is None else one.score)


def names(found: Sequence[Found]) -> list[str]:
    """Return the controllers of some runs, in their order."""
    return list(dict.fromkeys(each.controller for each in found))


def _score(name: str, mine: Sequence[Found], of: dict[tuple[str, str], float]) -> Score:
    rivals = [(each.error, of[each.trial, RIVAL]) for each in mine if (each.trial, RIVAL) in of]
    ratios = [math.log(max(error, FLOOR) / max(rival, FLOOR)) for error, rival in rivals]
    errors = [each.error for each in mine]

    def known(metric: str) -> list[float]:
        return [value for each in mine if (value := each.metrics.get(metric)) is not None]

    return Score(
        name,
        math.exp(sum(ratios) / len(ratios)) if ratios else None,
        median(errors),
        max(errors),
        sum(each.status != DONE for each in mine),
        min(known("real_time_factor"), default=None),
        max(known("step_share_p50"), default=None),
        max(known("step_share_p99"), default=None),
    )


SCORE_COLUMNS = {
    "controller": Column("controller"),
    "score": Column("score", ".3f", none="-"),
    "median": Column("median", ".3f"),
    "worst": Column("worst", ".3f"),
    "lost": Column("lost"),
    "real time": Column("slowest", ".2g", none="-"),
    "step p50 [%]": Column("step", ".0f", 100.0, "-"),
    "step p99 [%]": Column("late", ".0f", 100.0, "-"),
}
"""Columns of the table of scores, by title."""
