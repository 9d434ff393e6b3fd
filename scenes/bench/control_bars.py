"""What the MPC is held to in `worm3d bench control`, and whether it keeps to it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from scenes.bench.control import METRICS, PERIOD, Row, Value

MPC, RIVAL = "mpc", "pi_los"
LEVEL = ("velocity_step", "path_line", "path_circle", "path_s_curve")
PATHS = ("path_line", "path_circle", "path_s_curve")
"""Trials in which the MPC is to be better than line-of-sight guidance."""
SHARE = 0.1
"""Largest share of the control period that a control step may take (99th percentile)."""
KEPT, BROKEN, ABSENT, NO_BAR = "kept", "NOT KEPT", "not run", "no bar"


class Bar(NamedTuple):
    """A greatest value of one metric of one trial."""

    trial: str
    metric: str
    most: Value
    says: str


BARS = (
    *(Bar(trial, "speed_bias_relative", 0.02, METRICS["speed_bias_relative"].says) for trial in LEVEL),
    *(Bar(trial, "speed_error_rms_relative", 0.06, METRICS["speed_error_rms_relative"].says) for trial in LEVEL),
    Bar("velocity_step", "settling_periods", 3.0, METRICS["settling_periods"].says),
    Bar("path_line", "heading_error_mean_deg", 1.0, METRICS["heading_error_mean_deg"].says),
    Bar("path_line", "cross_track_rms_bl", 0.01, "rms offset from the line"),
    Bar("path_circle", "cross_track_rms_bl", 0.02, "rms offset from the circle"),
    Bar("path_s_curve", "cross_track_rms_bl", 0.03, "rms offset from the S-curve"),
    Bar("path_line_uphill", "speed_bias_relative", 0.05, "bias of the speed up 3 degrees that it does not know of"),
)
FREE = (
    *("speed_bias_relative", "speed_error_rms_relative"),
    *("heading_error_rms_deg", "cross_track_rms_bl", "cross_track_max_bl"),
)
"""Metrics that are told of trials that have no bar."""


class Verdict(NamedTuple):
    """A bar, what was found, and whether it is kept: not where a run lacks the metric or did not reach its end."""

    bar: Bar
    found: Value
    word: str
    """`KEPT`, `BROKEN`, `ABSENT` (the MPC or its rival was not run) or `NO_BAR` (the trial has none)."""


def verdicts(rows: Sequence[Row]) -> Iterator[Verdict]:
    """Yield what became of each bar, and the metrics of trials without one."""
    of = {(row.trial, row.controller): row for row in rows}
    mine = [row for row in rows if row.controller == MPC]
    for bar in BARS:
        yield _verdict(bar, of.get((bar.trial, MPC)))
    for trial in PATHS:
        theirs, metric = of.get((trial, RIVAL)), "cross_track_rms_bl"
        most = None if theirs is None else theirs.metrics[metric]
        bar = Bar(trial, metric, most, "rms offset below that of line-of-sight")
        yield _verdict(bar, of.get((trial, MPC)), below=True)
    for row in mine:
        if row.trial not in {bar.trial for bar in BARS}:
            told = (name for name in FREE if row.metrics[name] is not None)
            yield from (Verdict(Bar(row.trial, m, None, METRICS[m].says), row.metrics[m], NO_BAR) for m in told)
    for row in mine:
        period, metric = row.metrics[PERIOD], "control_step_ms_p99"
        yield _verdict(Bar(row.trial, metric, None if period is None else SHARE * period, METRICS[metric].says), row)


def _verdict(bar: Bar, row: Row | None, *, below: bool = False) -> Verdict:
    """Judge a bar; `below`: a value equal to it does not keep it."""
    if row is None or bar.most is None:
        return Verdict(bar, None if row is None else row.metrics[bar.metric], ABSENT)
    found = row.metrics[bar.metric]
    kept = found is not None and row.failed == 0 and (abs(found) < bar.most or (not below and abs(found) == bar.most))
    return Verdict(bar, found, KEPT if kept else BROKEN)
