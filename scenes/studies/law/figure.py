"""The figure of a segment law: force and radius over the length, for the states and for the law."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenes.studies.law.bench import Cycle
from scenes.studies.law.law import Law
from worm3d.values.arrays import FloatArray

SHOWN_INPUTS = 6
"""Number of inputs for which curves are drawn."""


def draw(law: Law, title: str, measured: FloatArray | None = None) -> Figure:
    """Return the figure. `measured` is the measured force of a record of cycles by the model, shape (T,) [N]."""
    cycle = law.prepared.cycle
    count = 2 if cycle is None or measured is None else 3
    figure = Figure(figsize=(5.2 * count, 4.6), layout="constrained", dpi=110)
    axes = figure.subplots(1, count)
    states, table = law.states, law.prepared.table
    unit, scale = ("kPa", 1e-3) if table.input_name == "pressure" else ("N", 1.0)
    values = ((axes[0], states.force, law.fit.force, 1.0), (axes[1], states.radius, law.fit.outer_radius, 1e3))
    for each, known, curve, factor in values:
        _draw_states(each, law, factor * known)
        for level in np.linspace(states.input.min(), states.input.max(), SHOWN_INPUTS):
            length = _lengths(law, level)
            label = f"{scale * level:.3g} {unit}"
            each.plot(
                1e3 * length,
                factor * curve(length, np.full(len(length), level)),
                color=_colour(law, level),
                label=label,
            )
        each.set_xlabel("length [mm]")
    axes[0].axhline(0.0, color="0.8", lw=0.8, zorder=0)
    axes[0].set(ylabel="force [N]", title="lines: law, dots: states, circles: held-out states")
    axes[1].set(ylabel="outer radius [mm]")
    axes[0].legend(fontsize=8, title=table.input_name)
    if cycle is not None and measured is not None:
        _draw_cycle(axes[2], cycle, measured)
    figure.suptitle(title, fontsize=11)
    return figure


def _colour(law: Law, level: float) -> tuple[float, ...]:
    low, high = law.states.input.min(), law.states.input.max()
    return tuple(colormaps["viridis"](0.9 * float((level - low) / max(high - low, 1e-300))))


def _lengths(law: Law, level: float) -> FloatArray:
    """Return the range of lengths of the states with inputs near `level`, shape (100,)."""
    apart = np.abs(law.states.input - level)
    near = law.states.length[apart <= max(0.1 * np.ptp(law.states.input), float(np.sort(apart)[4]))]
    return np.linspace(near.min(), near.max(), 100)


def _draw_states(axes: Axes, law: Law, values: FloatArray) -> None:
    colours = np.array([_colour(law, level) for level in law.states.input])
    length, held = 1e3 * law.states.length, law.held_out
    axes.scatter(length[~held], values[~held], c=colours[~held], s=12)
    axes.scatter(length[held], values[held], edgecolors=colours[held].tolist(), facecolors="none", s=36)


def _draw_cycle(axes: Axes, cycle: Cycle, predicted: FloatArray) -> None:
    length = 1e3 * cycle.record.length
    axes.plot(length, cycle.record.force, ".", color="0.6", ms=3, label="measured")
    axes.plot(length, predicted, color="C3", label="law and friction")
    axes.set(xlabel="length [mm]", ylabel="measured force [N]")
    axes.legend(fontsize=8)
