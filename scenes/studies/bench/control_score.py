"""The score of a controller over the trials of `worm3d study control`.

Let error be (B5) of `scenes.studies.bench.control_error`, which is 1 for a lost trial. The score of a controller c over
all T trials t is

    score(c) = (prod_t E(c, t) / E(pi_los, t))^(1/T),   E = max(error, FLOOR)                                 (B6)

The line-of-sight controller `pi_los` has a score of 1, and a controller with half its errors has a score of 0.5. A lost
trial counts like a worm at rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from scenes.records.text import Column
from scenes.studies.bench.control import DONE, Found, Value

RIVAL = "pi_los"
"""All others are compared with this controller: line-of-sight guidance with proportional-integral control."""
FLOOR = 0.005
"""Smallest error that is distinguished from zero: 0.5 % of the required distance, which is 1 mm in a window at 0.08
m/s. The motion of the centre of mass within each wave causes an error of about this size."""


class Score(NamedTuple):
    """Results of a controller over all trials."""

    controller: str
    score: Value
    """(B6); None if line-of-sight was not run."""
    median: float
    """Median of the errors."""
    worst: float
    """Maximum of the errors."""
    lost: int
    """Number of trials that are lost."""
    slowest: Value
    """Smallest real-time factor of all trials; the computing time of the controller is included."""
    step: Value
    """Median time of a control step, as a fraction of the control period, in the trial where this median is largest."""
    late: Value
    """99th percentile of the time of a control step, as a fraction of the control period, in the trial where it is
    largest."""


def scores(found: Sequence[Found]) -> list[Score]:
    """Return the scores of all controllers, sorted from the best (smallest) score to the worst."""
    of = {(each.trial, each.controller): each.error for each in found}
    each = [_score(name, [one for one in found if one.controller == name], of) for name in names(found)]
    return sorted(each, key=lambda one: math.inf if one.score is None else one.score)


def names(found: Sequence[Found]) -> list[str]:
    """Return the names of the controllers, in the order of their first results."""
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
