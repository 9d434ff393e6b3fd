"""Parts of figures that several models share."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from planar import figures
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray

ALWAYS = ("work_contract", "kinetic")
"""Terms of the energy balance that are drawn even if they are zero during the whole run."""


def stacked(height: float, ratios: tuple[float, ...] = (1,), *, shared: bool = True) -> tuple[Figure, NDArray[Any]]:
    """Return a figure and its panels, one above the other.

    `height` is the height of the figure [inch], `ratios` are the relative heights of the panels. If `shared` is true,
    all panels have the same time axis.
    """
    figure = Figure(figsize=(6.6, height), layout="constrained", dpi=120)
    rows = np.ravel(figure.subplots(len(ratios), 1, sharex=shared, height_ratios=ratios))
    for axes in rows:
        axes.grid(alpha=0.3)
    rows[-1].set_xlabel("time [s]")
    return figure, rows


def at_least(axes: Axes, span: float) -> None:
    """Widen the vertical axis to at least `span`, so that tiny variations do not look large."""
    low, high = axes.get_ylim()
    if high - low < span:
        axes.set_ylim(0.5 * (low + high - span), 0.5 * (low + high + span))


def from_above(axes: Axes) -> None:
    """Give a view from above the same scale on both axes; a narrow view is widened."""
    limits = np.array([axes.get_xlim(), axes.get_ylim()])
    span = np.ptp(limits, axis=1)
    half = 0.5 * np.maximum(span, 0.35 * span.max())
    (left, bottom), (right, top) = limits.mean(axis=1) - half, limits.mean(axis=1) + half
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xlabel="x [m]", ylabel="y [m]")


def ends(axes: Axes, joints: FloatArray) -> None:
    """Draw the body from above at the start and at the end of a run, with a mark at the head."""
    for row, colour, label in ((0, "0.75", "body at the start"), (-1, "0.35", "body at the end")):
        axes.plot(*joints[row, :, :2].T, "o-", color=colour, ms=3, lw=2, label=label)
        axes.plot(*joints[row, -1, :2], "o", color=colour, ms=8)


def energy_ledger(record: Record, time: str, *terms: Iterable[str]) -> tuple[Figure, Axes]:
    """Draw the energy balance of a record, cumulative over the run.

    `time` is the variable for the horizontal axis; `terms` are the names of the supplied, the stored and the lost
    terms.
    """
    drawn = ([name for name in names if name in ALWAYS or np.any(record[name])] for names in terms)
    supplied, stored, lost = ({name.replace("_", " "): np.cumsum(record[name]) for name in names} for names in drawn)
    title = f"{record.title}: energy, summed over the run"
    return figures.energy_ledger(record[time], supplied, stored, lost, title=title)
