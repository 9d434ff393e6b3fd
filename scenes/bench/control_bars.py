"""What the MPC is held to in `worm3d bench control`, and whether it keeps to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from scenes.bench.control import Row, Value

MPC, RIVAL = "mpc", "pi_los"
LEVEL = ("velocity_step", "path_line", "path_circle", "path_s_curve")


@dataclass(frozen=True)
class Bar:
    """A greatest value of one figure of one trial."""

    trial: str
    figure: str
    most: Value
    says: str


BARS = (
    *(Bar(trial, "speed_bias_relative", 0.02, "bias of the speed") for trial in LEVEL),
    *(Bar(trial, "speed_error_rms_relative", 0.06, "rms error of the speed") for trial in LEVEL),
    Bar("velocity_step", "settling_periods", 3.0, "periods until a step of the speed has settled to 10 %"),
    Bar("path_line", "heading_error_mean_deg", 1.0, "mean error of the heading"),
    Bar("path_line", "cross_track_rms_bl", 0.01, "rms offset from the line"),
    Bar("path_circle", "cross_track_rms_bl", 0.02, "rms offset from the circle"),
    Bar("path_s_curve", "cross_track_rms_bl", 0.03, "rms offset from the S-curve"),
    Bar("path_line_uphill", "speed_bias_relative", 0.05, "bias of the speed up 3 degrees that it does not know of"),
)
FREE = {
    "speed_bias_relative": "bias of the speed",
    "speed_error_rms_relative": "rms error of the speed",
    "heading_error_rms_deg": "rms error of the heading",
    "cross_track_rms_bl": "rms offset from the path",
    "cross_track_max_bl": "greatest offset from the path",
}
"""What is told of trials that have no bar."""
PATHS = ("path_line", "path_circle", "path_s_curve")
"""On which the MPC is to be better than line-of-sight guidance."""
SHARE = 0.1
"""Of the control period that a control step may take (99th percentile)."""
KEPT, BROKEN, ABSENT, NO_BAR = "kept", "NOT KEPT", "not run", "no bar"


@dataclass(frozen=True)
class Verdict:
    """A bar, what was found, and whether it is kept.

    Where a run lacks a figure (a speed that never settles) or did not reach its end, the bar is not kept.

    Attributes
    ----------
    trial, figure, says : str
    found, most : float or None
    word : str
        `KEPT`, `BROKEN`, `ABSENT` (the MPC or its rival was not run) or `NO_BAR` (the trial has none).
    """

    trial: str
    figure: str
    says: str
    found: Value
    most: Value
    word: str


def verdicts(rows: Sequence[Row]) -> Iterator[Verdict]:
    """Yield what became of each bar, and the figures of trials without one."""
    of = {(row.trial, row.controller): row for row in rows}
    for bar in BARS:
        yield _verdict(bar, of.get((bar.trial, MPC)))
    for trial in PATHS:
        theirs, key = of.get((trial, RIVAL)), "cross_track_rms_bl"
        most = None if theirs is None else theirs.figures[key]
        yield _below(Bar(trial, key, most, "rms offset below that of line-of-sight"), of.get((trial, MPC)))
    mine = [row for (_, controller), row in of.items() if controller == MPC]
    for row in mine:
        yield from _free(row)
    for row in mine:
        period = row.figures["control_period_ms"]
        most = None if period is None else SHARE * period
        yield _verdict(Bar(row.trial, "control_step_ms_p99", most, "99th percentile of the control steps"), row)


def _verdict(bar: Bar, row: Row | None) -> Verdict:
    return _told(bar, row, lambda found, most: abs(found) <= most)


def _below(bar: Bar, row: Row | None) -> Verdict:
    return _told(bar, row, lambda found, most: abs(found) < most)


def _told(bar: Bar, row: Row | None, keeps: Callable[[float, float], bool]) -> Verdict:
    found = None if row is None else row.figures[bar.figure]
    if row is None or bar.most is None:
        word = ABSENT
    else:
        word = KEPT if found is not None and row.failed == 0 and keeps(found, bar.most) else BROKEN
    return Verdict(bar.trial, bar.figure, bar.says, found, bar.most, word)


def _free(row: Row) -> Iterator[Verdict]:
    """Yield the figures of a trial without a bar of its own; that of the control steps is everybody's."""
    if row.trial not in {bar.trial for bar in BARS}:
        for figure, says in FREE.items():
            if row.figures[figure] is not None:
                yield Verdict(row.trial, figure, says, row.figures[figure], None, NO_BAR)
