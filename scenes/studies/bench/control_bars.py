"""What the MPC is held to in `worm3d bench control`, and whether it keeps to it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from scenes.studies.bench.control import METRICS, PERIOD, Row, Value
from scenes.studies.bench.control_trials import OFFSET

MPC, RIVAL = "mpc", "pi_los"
LEVEL = ("velocity_step", "path_line", "path_circle", "path_s_curve")
RIVALS = {
    **dict.fromkeys(("path_line", "path_circle", "path_s_curve", "disturbance_push"), 1.0),
    **dict.fromkeys(("circle_0.4", "corner", "s_curve_fast"), 1.0 / 3.0),
}
"""Trials in which the MPC is to be better than line-of-sight guidance, and the share of its offset that is allowed."""
SHARE = 0.3
"""Largest share of the control period that a control step may take (99th percentile)."""
KEPT, BROKEN, ABSENT, NO_BAR = "kept", "NOT KEPT", "not run", "no bar"


class Bar(NamedTuple):
    """A greatest value of one metric of one trial."""

    trial: str
    metric: str
    most: Value
    says: str


def _bar(trial: str, metric: str, most: float) -> Bar:
    return Bar(trial, metric, most, METRICS[metric].says)


BARS = (
    *(_bar(trial, "speed_bias_relative", 0.02) for trial in LEVEL),
    *(_bar(trial, "speed_error_rms_relative", 0.06) for trial in LEVEL),
    _bar("velocity_step", "settling_periods", 3.0),
    _bar("velocity_pipe", "speed_bias_relative", 0.05),
    _bar("path_line", "heading_error_mean_deg", 1.0),
    _bar("path_line", OFFSET, 0.0015),
    _bar("path_circle", OFFSET, 0.0025),
    _bar("path_s_curve", OFFSET, 0.0025),
    _bar("path_line_uphill", "speed_bias_relative", 0.05),
    *(_bar(f"side_slope{kind}", OFFSET, 0.006) for kind in ("", "_compass")),
    *(_bar(f"side_slope{kind}", "cross_track_mean_bl", 0.002) for kind in ("", "_compass")),
    _bar("from_apart", "joining_periods", 10.0),
    _bar("circle_0.6", OFFSET, 0.01),
    _bar("circle_0.6", "head_offset_rms_bl", 0.09),
    *(_bar("s_curve_slow", metric, most) for metric, most in (("speed_bias_m_s", 0.0005), (OFFSET, 0.005))),
    *(_bar("s_curve_fast", metric, most) for metric, most in (("speed_bias_relative", 0.02), (OFFSET, 0.005))),
    *(_bar(trial, OFFSET, 0.006) for trial in ("s_curve_noise", "eight_segments", "soft_springs")),
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
    for trial, share in RIVALS.items():
        theirs = of.get((trial, RIVAL))
        error = None if theirs is None else theirs.metrics[OFFSET]
        part = "" if share == 1.0 else f"{share:.2g} of "
        bar = Bar(trial, OFFSET, None if error is None else share * error, f"rms offset below {part}line-of-sight's")
        yield _verdict(bar, of.get((trial, MPC)), below=True)
    for row in mine:
        if row.trial not in {bar.trial for bar in BARS} | RIVALS.keys():
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
