"""The figure of `worm3d identify`: turn, speed and slip against the steering, by schedule and yaw joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from control.identification import Identified
from control.steering import MECHANISMS
from scenes.identify.study import AMPLITUDE, GOAL_DEG, IN_STEP, PERIOD, YAW_FACTORS, Curve

COLOURS = dict(zip((IN_STEP, *YAW_FACTORS), ("#9a9a9a", "#8cc0df", "#1f5a94", "#d9793a"), strict=True))
PANELS = (
    ("turn_deg", "turn to the left [° a wave]"),
    ("speed_bl_s", "speed [body lengths/s]"),
    ("slip_bl", "way slid by all feet [body lengths a wave]"),
)
LABELS = {"hinge": "hinges [rad]", "bias": "bias"}


def draw(curves: Sequence[Curve], identified: Identified) -> Figure:
    """Return the figure."""
    figure = Figure(figsize=(12.0, 7.4), layout="constrained", dpi=110)
    grid = figure.subplots(len(MECHANISMS), len(PANELS), squeeze=False)
    for row, mechanism in zip(grid, MECHANISMS, strict=True):
        for axes, (quantity, label) in zip(row, PANELS, strict=True):
            for curve in curves:
                if curve.mechanism == mechanism:
                    _draw_curve(axes, curve, quantity)
            axes.set_xlabel(f"steering by {LABELS[mechanism]}")
            axes.set_ylabel(label)
            axes.grid(True, alpha=0.25)
        _draw_fit(row, identified, mechanism)
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9)
    figure.suptitle(
        f"Steering at amplitude {AMPLITUDE:g}, {1.0 / PERIOD:g} Hz; to the right it is the mirror image", fontsize=12
    )
    return figure


def _draw_curve(axes: Axes, curve: Curve, quantity: str) -> None:
    colour = COLOURS[curve.name]
    s = np.array([point.steering for point in curve.points])
    y = np.array([getattr(point, quantity) for point in curve.points])
    lying = np.array([point.tipped for point in curve.points])
    axes.plot(s, np.where(lying, np.nan, y), "-o", color=colour, ms=4, lw=1.5, label=curve.name)
    axes.plot(s[lying], y[lying], "x", color=colour, ms=5, label=f"{curve.name}: lies on its side")


def _draw_fit(row: Sequence[Axes], identified: Identified, mechanism: str) -> None:
    """Draw the map over the points it stands for, and what a schedule should reach."""
    found = identified.maps[mechanism]  # type: ignore[index]
    s = np.linspace(0.0, found.ranges.steering, 60)
    row[0].axhline(GOAL_DEG, color="k", lw=0.8, ls=":", label=f"{GOAL_DEG:g}° a wave")
    style = {"color": "k", "lw": 1.0, "ls": "--", "label": "identified map"}
    row[0].plot(s, np.rad2deg(found.turn(AMPLITUDE, 1.0 / PERIOD, s)), **style)
    row[1].plot(s, found.speed(AMPLITUDE, 1.0 / PERIOD, s), **style)
