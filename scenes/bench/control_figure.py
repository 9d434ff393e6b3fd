"""The figure of `worm3d bench control`: how well each controller did in each scene, every seed a point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenes.bench.control import CONTROLLERS, Found

PANELS = (
    ("speed_error_rms_relative", 100.0, "speed error, rms [%]"),
    ("cross_track_rms_bl", 1.0, "offset from the path, rms [BL]"),
    ("heading_error_rms_deg", 1.0, "heading error, rms [deg]"),
    ("control_step_ms_p99", 1.0, "control step, 99th percentile [ms]"),
)
COLOURS = dict(zip(CONTROLLERS, ("#1f5a94", "#d9793a", "#a0a0a0"), strict=True))
LEAST = {"cross_track_rms_bl": 1e-4, "heading_error_rms_deg": 1e-2, "speed_error_rms_relative": 1e-3}
"""What is less lies at the edge of the logarithmic picture."""


def draw(found: Sequence[Found]) -> Figure:
    """Return the figure."""
    trials = list(dict.fromkeys(each.trial for each in found))
    figure = Figure(figsize=(11.0, 2.4 + 0.42 * len(trials)), layout="constrained", dpi=120)
    for axes, panel in zip(figure.subplots(1, len(PANELS), sharey=True), PANELS, strict=True):
        _panel(axes, found, trials, *panel)
    figure.axes[0].set_yticks(range(len(trials)), trials)
    figure.axes[0].set_ylim(len(trials) - 0.4, -0.6)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=9)
    return figure


def _panel(axes: Axes, found: Sequence[Found], trials: list[str], name: str, scale: float, label: str) -> None:
    for k, controller in enumerate(CONTROLLERS):
        height = 0.8 / len(CONTROLLERS)
        aside = (k - 0.5 * (len(CONTROLLERS) - 1)) * height
        for place, trial in enumerate(trials):
            values = _values(found, trial, controller, name)
            if len(values) == 0:
                continue
            seen = scale * np.maximum(np.abs(values), LEAST.get(name, 0.0))
            title = controller if place == 0 else None
            axes.barh(place + aside, seen.max(), height, color=COLOURS[controller], alpha=0.6, label=title)
            axes.plot(seen, np.full(len(seen), place + aside), ".", color="black", ms=2.5)
    axes.set_xscale("log")
    axes.set_xlabel(label, fontsize=9)
    axes.grid(True, axis="x", alpha=0.3)


def _values(
    found: Sequence[Found], trial: str, controller: str, name: str
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    of = (each.figures[name] for each in found if (each.trial, each.controller) == (trial, controller))
    return np.array([value for value in of if value is not None], dtype=float)
