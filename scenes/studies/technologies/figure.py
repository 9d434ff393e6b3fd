"""The figure of `worm3d study technologies`: speed and its limit, speed over the period, and cost of transport."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter

from scenes.studies.technologies.limits import ALL, MOVES, Verdict
from scenes.studies.technologies.runs import Bench

LIMIT_COLOURS = {"speed": "C0", "force": "C3", "stroke": "C1", "heat": "C5", ALL: "C4", "": "0.6"}
MEANINGS = {"speed": "too slow", "force": "too weak", "stroke": "too short", "heat": "too warm", ALL: "all together"}
STYLES = ("-", "--", ":")
BELOW: Mapping[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.12), "fontsize": 8}
"""Options of legends: they are placed under the axes, where they do not cover the curves."""


def draw(bench: Bench, verdicts: Sequence[Verdict]) -> Figure:
    """Return the figure."""
    figure = Figure(figsize=(15, max(0.36 * len(verdicts) + 3.0, 4.4)), layout="constrained", dpi=120)
    left, middle, right = figure.subplots(1, 3)
    _speeds(left, bench, verdicts)
    _periods(middle, bench, verdicts)
    _costs(right, verdicts)
    figure.suptitle(f"{bench.name}: the same worm and gait on each technology", fontsize=12)
    return figure


def _speeds(axes: Axes, bench: Bench, verdicts: Sequence[Verdict]) -> None:
    rows = np.arange(len(verdicts))
    own = np.array([each.own.speed for each in verdicts])
    colours = [LIMIT_COLOURS[each.limit] for each in verdicts]
    axes.barh(rows, np.nan_to_num(own), color=colours, height=0.7)
    free = [each.without[each.limit].speed if each.limit else np.nan for each in verdicts]
    axes.plot(free, rows, "k|", ms=14, mew=2)
    for k, each in enumerate(verdicts):
        if not each.moves:
            end = np.nanmax([0.0, free[k]])
            axes.text(end, k, "  does not move it", va="center", fontsize=8, color=colours[k])
    axes.set_yticks(rows, [each.kind for each in verdicts])
    axes.set_ylim(len(verdicts) - 0.4, -0.6)
    axes.set_xlabel(f"speed at the scene's period of {bench.period:g} s [BL/s]")
    shown = [name for name in LIMIT_COLOURS if any(each.limit == name for each in verdicts)]
    marks = [Patch(color=LIMIT_COLOURS[name], label=MEANINGS.get(name, "no limit of its own")) for name in shown]
    axes.legend(handles=marks, title="what limits it (|: without that limit)", title_fontsize=8, ncols=3, **BELOW)
    axes.grid(axis="x", alpha=0.3)


def _periods(axes: Axes, bench: Bench, verdicts: Sequence[Verdict]) -> None:
    for k, each in enumerate(verdicts):
        x = np.array([trial.period for trial in each.periods])
        y = np.array([trial.speed if trial.stride > MOVES else np.nan for trial in each.periods])
        axes.plot(x, y, "o", ls=STYLES[k // 10 % len(STYLES)], ms=3, color=f"C{k % 10}", label=each.kind)
    axes.axvline(bench.period, color="0.5", lw=0.8)
    axes.set(xscale="log", yscale="log", xlabel="period of the gait [s]", ylabel="speed [BL/s]")
    axes.grid(alpha=0.3, which="both")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.legend(ncols=3, handlelength=3.5, **BELOW)


def _costs(axes: Axes, verdicts: Sequence[Verdict]) -> None:
    rows = np.arange(len(verdicts))
    drawn, given = (np.array([getattr(each, name) for each in verdicts]) for name in ("drawn", "given"))
    parts = [each.acting.uncounted for each in verdicts]
    bars = axes.barh(rows - 0.18, drawn, height=0.36, color="C7", label="energy drawn")
    for bar, part in zip(bars, parts, strict=True):
        bar.set(hatch="////" if part else "", facecolor="white" if part else "C7", edgecolor="C7")
    axes.barh(rows + 0.18, given, height=0.36, color="C2", label="work on the worm")
    axes.set_xscale("log")
    axes.set_yticks(rows, [each.kind for each in verdicts])
    axes.set_ylim(len(verdicts) - 0.4, -0.6)
    axes.set_xlabel("energy over weight and distance")
    hatched = [Patch(facecolor="white", edgecolor="C7", hatch="////", label="energy drawn without that of its source")]
    axes.legend(handles=[*axes.get_legend_handles_labels()[0], *(hatched if any(parts) else [])], **BELOW)
    axes.grid(axis="x", alpha=0.3)
