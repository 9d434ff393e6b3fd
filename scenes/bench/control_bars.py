"""What the MPC is held to in `worm3d bench control`, and whether it keeps to it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from scenes.bench.control import Row, Value

MPC, RIVAL = "mpc", "pi_los"
LEVEL = ("velocity_step", "path_line", "path_circle", "path_s_curve")


@dataclass(frozen=True)
class Bar:
    """A greatest value of one figure of one trial; `percent` for shares that are told in percent."""

    trial: str
    figure: str
    most: float
    says: str


BARS = (
    *(Bar(trial, "speed_bias_relative", 0.02, "bias of the speed") for trial in LEVEL),
    *(Bar(trial, "speed_error_rms_relative", 0.06, "rms error of the speed") for trial in LEVEL),
    Bar("velocity_step", "settling_periods", 3.0, "periods until a step of the speed has settled to 10 %"),
    Bar("path_line", "heading_error_mean_deg", 1.0, "mean error of the heading [deg]"),
    Bar("path_line", "cross_track_rms_bl", 0.01, "rms offset from the line [body lengths]"),
    Bar("path_circle", "cross_track_rms_bl", 0.02, "rms offset from the circle [body lengths]"),
    Bar("path_s_curve", "cross_track_rms_bl", 0.03, "rms offset from the S-curve [body lengths]"),
    Bar("path_line_uphill", "speed_bias_relative", 0.05, "bias of the speed up 3 degrees that it does not know of"),
)
PATHS = ("path_line", "path_circle", "path_s_curve")
"""On which the MPC is to be better than line-of-sight guidance."""
SHARE = 0.1
"""Of the control period that a control step may take (99th percentile)."""


@dataclass(frozen=True)
class Verdict:
    """A bar, what was found, and whether it is kept; None: it was not run.

    Where a run lacks a figure (a speed that never settles) or did not reach its end, the bar is not kept.
    """

    trial: str
    says: str
    found: Value
    most: Value
    kept: bool | None


def verdicts(rows: Sequence[Row]) -> Iterator[Verdict]:
    """Yield what became of each bar."""
    of = {(row.trial, row.controller): row for row in rows}
    for bar in BARS:
        yield _verdict(bar.trial, bar.says, of.get((bar.trial, MPC)), bar.figure, bar.most)
    for trial in PATHS:
        theirs, key = of.get((trial, RIVAL)), "cross_track_rms_bl"
        most = None if theirs is None else theirs.figures[key]
        yield _verdict(trial, "rms offset below that of line-of-sight", of.get((trial, MPC)), key, most, below=True)
    for (trial, controller), row in of.items():
        if controller == MPC:
            period = row.figures["control_period_ms"]
            most = None if period is None else SHARE * period
            yield _verdict(trial, "99th percentile of the control steps [ms]", row, "control_step_ms_p99", most)


def _verdict(trial: str, says: str, row: Row | None, figure: str, most: Value, *, below: bool = False) -> Verdict:
    found = None if row is None else row.figures[figure]
    if row is None or most is None:
        return Verdict(trial, says, found, most, None)
    reached = found is not None and row.failed == 0 and (abs(found) < most or (abs(found) == most and not below))
    return Verdict(trial, says, found, most, reached)
