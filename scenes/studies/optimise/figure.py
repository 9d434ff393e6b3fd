"""The figure of an optimised gait: the activations over a period, and the progress of the searches."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenes.studies.optimise.card import Card
from scenes.studies.optimise.goals import BROKEN
from worm3d.values.arrays import FloatArray


def draw(card: Card) -> Figure:
    """Return the figure of a card."""
    gait, space = card.gait, card.trials.space
    times = np.asarray((np.arange(200) + 0.5) / 200.0 * gait.period, dtype=np.float64)
    active: FloatArray = gait.activations(times, space.segments).reshape(len(times), space.segments, -1)
    sides = active.shape[2]
    figure = Figure(figsize=(10.0, 3.6), layout="constrained", dpi=110)
    axes = figure.subplots(1, sides + 1, width_ratios=[1.0] * sides + [1.2])
    titles = ("left chambers", "right chambers") if sides == 2 else ("both chambers",)
    for side, title in enumerate(titles):
        edges = np.linspace(0.0, 1.0, len(times) + 1), np.arange(space.segments + 1) + 0.5
        mesh = axes[side].pcolormesh(*edges, active[:, :, side].T, cmap="Reds", vmin=0.0, vmax=1.0)
        axes[side].set(title=title, xlabel="time [periods]", yticks=np.arange(space.segments) + 1)
    axes[0].set_ylabel("segment, from the tail")
    figure.colorbar(mesh, ax=axes[sides - 1], label="activation")
    _draw_progress(axes[sides], card)
    return figure


def _draw_progress(axes: Axes, card: Card) -> None:
    sign = 1.0 if card.trials.goal.smallest else -1.0
    for each in card.found:
        least = np.minimum.accumulate(each.costs)
        axes.plot(np.arange(len(least)) + 1, np.where(least < BROKEN, sign * least, np.nan), label=f"seed {each.seed}")
    axes.axhline(card.trials.own_value, color="0.5", ls=":", label="gait of the scene")
    axes.axhline(card.first.simple.score.value, color="0.5", ls="--", label="best simple gait")
    axes.set(xlabel="runs", ylabel=card.trials.goal.meaning, title="best value so far")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.25)
