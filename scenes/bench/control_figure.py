"""The figure of `worm3d bench control`: how well each controller did in each scene, every seed a point.

The scales are logarithmic and go down to a true zero: a point on the left edge is a zero, no point is no value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from scenes.bench.control import CONTROLLERS, Found

PANELS = (
    ("speed_error_rms_relative", 100.0, "speed error, rms [%]"),
    ("cross_track_rms_bl", 1.0, "offset from the path, rms [BL]"),
    ("heading_error_rms_deg", 1.0, "heading error, rms [deg]"),
    ("control_step_ms_p99", 1.0, "control step, 99th percentile [ms]"),
)
COLOURS = dict(zip(CONTROLLERS, ("#1f5a94", "#d9793a", "#a0a0a0"), strict=True))
LEAST = {
    "speed_error_rms_relative": 0.1,
    "cross_track_rms_bl": 1e-3,
    "heading_error_rms_deg": 0.1,
    "control_step_ms_p99": 0.1,
}
"""Where the logarithmic scale of a panel begins; below it is linear and goes down to zero."""


def draw(found: Sequence[Found]) -> Figure:
    """Return the figure."""
    trials = list(dict.fromkeys(each.trial for each in found))
    figure = Figure(figsize=(11.0, 2.4 + 0.42 * len(trials)), layout="constrained", dpi=120)
    for axes, panel in zip(figure.subplots(1, len(PANELS), sharey=True), PANELS, strict=True):
        _panel(axes, found, trials, *panel)
    figure.axes[0].set_yticks(range(len(trials)), trials)
    figure.axes[0].set_ylim(len(trials) - 0.4, -0.6)
    there = [name for name in CONTROLLERS if name in {each.controller for each in found}]
    handles = [Patch(color=COLOURS[name], alpha=0.6, label=name) for name in there]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=9)
    return figure


def _panel(axes: Axes, found: Sequence[Found], trials: list[str], name: str, scale: float, label: str) -> None:
    for k, controller in enumerate(CONTROLLERS):
        height = 0.8 / len(CONTROLLERS)
        aside = (k - 0.5 * (len(CONTROLLERS) - 1)) * height
        for place, trial in enumerate(trials):
            values = _values(found, trial, controller, name)
            if len(values) == 0:
                continue
            seen = scale * np.abs(values)
            axes.barh(place + aside, seen.max(), height, color=COLOURS[controller], alpha=0.6)
            axes.plot(seen, np.full(len(seen), place + aside), ".", color="black", ms=2.5, clip_on=False)
    axes.set_xscale("symlog", linthresh=LEAST[name], linscale=0.4)
    axes.set_xlim(left=0.0)
    axes.set_xlabel(label, fontsize=9)
    axes.grid(True, axis="x", alpha=0.3)


def _values(
    found: Sequence[Found], trial: str, controller: str, name: str
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    of = (each.figures[name] for each in found if (each.trial, each.controller) == (trial, controller))
    return np.array([value for value in of if value is not None], dtype=float)
