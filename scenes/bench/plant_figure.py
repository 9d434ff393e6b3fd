"""The figure of `worm3d bench plant`: time of a step against the number of segments, and what it is spent on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from scenes.bench.shares import Shares
from scenes.bench.speed import Growth, Speed

COLOURS = ("#1f5a94", "#3f8fc4", "#8cc0df", "#f0b35a", "#d9793a", "#9c4a2f", "#c4c4c4")
"""Of the parts, from the bottom of a bar; the last is "other"."""
DARK = (COLOURS[0], COLOURS[1], COLOURS[5])
"""On which white is easier to read."""
LEAST_LABELLED = 0.03
"""Parts below this fraction of a step have no number in their bar."""


def draw(speeds: Sequence[Speed], growth: Growth, shares: Sequence[Shares]) -> Figure:
    """Return the figure."""
    figure = Figure(figsize=(10.0, 4.6), layout="constrained", dpi=120)
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _times(left, speeds, growth)
    _bars(right, shares)
    return figure


def _times(axes: Axes, speeds: Sequence[Speed], growth: Growth) -> None:
    sizes = [speed.segments for speed in speeds]
    ends = np.array([min(growth.segments), max(growth.segments)], dtype=float)
    label = f"fit: N$^{{{growth.exponent:.2f}}}$ over N = {ends[0]:.0f} to {ends[1]:.0f}"
    axes.loglog(ends, growth.us_of_one * ends**growth.exponent, color=COLOURS[4], lw=1.5, label=label)
    axes.loglog(sizes, [speed.us_per_step for speed in speeds], "o", color=COLOURS[0], label="measured")
    for speed in speeds:
        text = f"{speed.us_per_step:.{0 if speed.us_per_step >= 100.0 else 1}f}"
        place = (speed.segments, speed.us_per_step)
        axes.annotate(text, place, xytext=(5, -10), textcoords="offset points", ha="left", fontsize=8)
    axes.set_xticks(sizes, [str(size) for size in sizes])
    axes.set_xticks([], minor=True)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("segments N")
    axes.set_ylabel("time of a step [µs]")
    axes.set_title("Time of a step, dt = 10 ms", fontsize=11)
    axes.margins(x=0.12, y=0.12)
    axes.grid(True, alpha=0.25)
    axes.legend(loc="upper left", fontsize=9)


def _bars(axes: Axes, shares: Sequence[Shares]) -> None:
    places, bottom = np.arange(len(shares)), np.zeros(len(shares))
    for part, colour in zip(shares[0].us if shares else (), COLOURS, strict=False):
        # Parts timed alone may add up to more than the step, where only some segments are evaluated anew.
        heights = np.array([max(0.0, 100.0 * each.fractions[part]) for each in shares])
        bars = axes.bar(places, heights, 0.55, bottom=bottom, color=colour, label=part)
        texts = [f"{height:.0f} %" if height >= 100.0 * LEAST_LABELLED else "" for height in heights]
        dark = colour in DARK
        axes.bar_label(bars, texts, label_type="center", fontsize=8, color="white" if dark else "black")
        bottom += heights
    axes.set_xticks(places, [f"N = {each.segments}\n{each.us_per_step:.3g} µs" for each in shares])
    axes.set_xlim(-0.6, len(shares) - 0.4)
    axes.set_ylabel("share of a step [%]")
    axes.set_title("What it is spent on", fontsize=11)
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
