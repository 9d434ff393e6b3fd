"""The figure of `scenes.bench.lanes`: a step of one worm alone, and the least that it could cost in a batch's lanes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenes.bench.lane_bound import LaneStudy
from scenes.bench.plant_figure import COLOURS, DARK

LEAST_LABELLED = 1.5
"""Parts below this time have no number in their bar [µs]."""


def draw(study: LaneStudy, bar: float) -> Figure:
    """Return the figure, with what a step may cost if the batch is to have the gain `bar`."""
    figure = Figure(figsize=(10.0, 5.0), layout="constrained", dpi=120)
    axes = figure.subplots()
    bounds = sorted(study.bounds, key=lambda bound: [each.scheme for each in study.bounds].index(bound.scheme))
    labels = ["alone", *("\n".join((*bound.scheme.split(), f"{bound.worms} worms")) for bound in bounds)]
    gains = [study.throughput.gain, *(bound.batch_gain for bound in bounds)]
    _bars(axes, [study.now, *(bound.us for bound in bounds)], gains)
    allowed = sum(study.now.values()) * study.allowed(bar)
    label = f"allowed if the batch is to have\n{bar:g} times the throughput of single runs"
    axes.axhline(allowed, color="black", lw=1.2, ls="--", label=label, zorder=0)
    axes.set_xticks(range(len(labels)), labels, fontsize=8)
    axes.set_ylabel("time of a step of one worm [µs]")
    axes.set_title(
        "A step as it is, and the least with several worms in the lanes; on top the gain of the batch", fontsize=11
    )
    handles, names = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], names[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    return figure


def _bars(axes: Axes, steps: list[dict[str, float]], gains: list[float]) -> None:
    places, bottom = np.arange(len(steps)), np.zeros(len(steps))
    for part, colour in zip(steps[0], COLOURS, strict=False):
        heights = np.array([us[part] for us in steps])
        bars = axes.bar(places, heights, 0.7, bottom=bottom, color=colour, label=part)
        texts = [f"{height:.1f}" if height >= LEAST_LABELLED else "" for height in heights]
        axes.bar_label(bars, texts, label_type="center", fontsize=7, color="white" if colour in DARK else "black")
        bottom += heights
    plain = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
    axes.bar_label(bars, [f"{gain:.2f}x" for gain in gains], padding=4, fontsize=9, bbox=plain)
    axes.set_ylim(0.0, 1.12 * bottom.max())
