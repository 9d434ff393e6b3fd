"""The figure of `worm3d study identify`: turn, speed and slip against the steering, and turn against the phase."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from control.identification.identified import Identified
from scenes.studies.identify import study
from scenes.studies.identify.study import Curve, Phases

CURVE_COLOURS = dict(
    zip((study.IN_STEP, *study.YAW_FACTORS), ("#9a9a9a", "#8cc0df", "#1f5a94", "#d9793a"), strict=True)
)
PANELS = (
    ("turn_deg", "turn to the left [° a wave]"),
    ("speed_bl_s", "speed [body lengths/s]"),
    ("slip_bl", "slip of all feet [body lengths a wave]"),
)
LABELS = {"hinge": "hinges [rad]", "bias": "bias"}


def draw(curves: Sequence[Curve], phases: Sequence[Phases], identified: Identified) -> Figure:
    """Return the figure."""
    figure = Figure(figsize=(15.5, 7.4), layout="constrained", dpi=110)
    grid = figure.subplots(len(study.CURVE_STEERINGS), len(PANELS) + 1, squeeze=False)
    for row, mechanism in zip(grid, study.CURVE_STEERINGS, strict=True):
        for axes, (quantity, label) in zip(row[:-1], PANELS, strict=True):
            for curve in curves:
                if curve.mechanism == mechanism:
                    _draw_curve(axes, curve, quantity)
            axes.set_xlabel(f"steering by {LABELS[mechanism]}")
            axes.set_ylabel(label)
            axes.grid(True, alpha=0.25)
        _draw_fit(row, identified, mechanism)
        _draw_phases(row[-1], [each for each in phases if each.mechanism == mechanism])
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9)
    wave = f"amplitude {study.WAVE_AMPLITUDE:g}, {1.0 / study.WAVE_PERIOD_S:g} Hz"
    figure.suptitle(f"Steering at {wave}; to the right it is the mirror image", fontsize=12)
    return figure


def _draw_curve(axes: Axes, curve: Curve, quantity: str) -> None:
    colour = CURVE_COLOURS[curve.name]
    s = np.array([point.steering for point in curve.points])
    y = np.array([getattr(point, quantity) for point in curve.points])
    lying = np.array([point.tipped for point in curve.points])
    axes.plot(s, np.where(lying, np.nan, y), "-o", color=colour, ms=4, lw=1.5, label=curve.name)
    axes.plot(s[lying], y[lying], "x", color=colour, ms=5)


def _draw_phases(axes: Axes, phases: Sequence[Phases]) -> None:
    """Draw the turn [degrees] and the drift [% of the body length] of each bending wave over the phase."""
    for each, colour in zip(phases, (CURVE_COLOURS["its own yaw joints"], "#9a9a9a"), strict=True):
        name = f"bending wave of {each.steering_wavelength:g} body lengths"
        axes.plot(each.phase_deg, each.turn_deg, "-o", color=colour, ms=3, lw=1.5, label=f"turn [°], {name}")
        drift = 100.0 * np.array(each.drift_bl)
        axes.plot(each.phase_deg, drift, "--", color=colour, lw=1.2, label="drift to the left [% of the body]")
    axes.axvline(phases[0].chosen_deg, color="k", lw=0.8, ls=":")
    axes.set_xticks(range(0, 361, 90))
    axes.set_xlabel("bend ahead of the contraction by [°]")
    axes.set_ylabel("turn, drift a wave")
    mechanism = phases[0].mechanism
    axes.set_title(f"{LABELS[mechanism]} {study.STEERING[mechanism]:g}; dotted: the schedule's phase", fontsize=9)
    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.45 * (high - low), high)  # room for the legend
    axes.grid(True, alpha=0.25)
    axes.legend(fontsize=7, loc="lower left")


def _draw_fit(row: Sequence[Axes], identified: Identified, mechanism: str) -> None:
    """Draw the identified map over the measured points, and a line at the turn `GOAL_DEG`."""
    found = identified.maps[mechanism]  # type: ignore[index]
    s = np.linspace(0.0, found.ranges.steering, 60)
    row[0].axhline(study.GOAL_DEG, color="k", lw=0.8, ls=":", label=f"{study.GOAL_DEG:g}° a wave")
    style: dict[str, Any] = {"color": "k", "lw": 1.0, "ls": "--", "label": "identified map"}
    row[0].plot([], [], "x", color="k", ms=5, label="tipped over: lies on its side")
    row[0].plot(s, np.rad2deg(found.turn(study.WAVE_AMPLITUDE, 1.0 / study.WAVE_PERIOD_S, s)), **style)
    row[1].plot(s, found.speed(study.WAVE_AMPLITUDE, 1.0 / study.WAVE_PERIOD_S, s), **style)
