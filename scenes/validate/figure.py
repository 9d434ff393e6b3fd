"""The figure of the validation report: model over published number, row by row, with the bands."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenes.validate.rows import Row

LEAST, GREATEST = 0.03, 30.0
"""Range of the axis; what lies outside is drawn at its end."""

HIT, MISS = "C2", "C3"
"""Colours of rows in their bands, and of the others."""


def draw(chapters: Mapping[str, Sequence[Row]]) -> Figure:
    """Draw the ratio of model to published number of each row; a row without a number as it is, where 1 divides."""
    rows = [row for each in chapters.values() for row in each if _scale(row) is not None]
    figure = Figure(figsize=(9.0, 1.2 + 0.24 * len(rows)), layout="constrained", dpi=110)
    axes = figure.subplots()
    for place, row in enumerate(reversed(rows)):
        _row(axes, place, row)
    axes.axvline(1.0, color="0.4", lw=0.8)
    axes.set_xscale("log")
    axes.set(xlim=(LEAST, GREATEST), ylim=(-0.7, len(rows) - 0.3), xlabel="model over published number (trends: model)")
    axes.set_yticks(range(len(rows)), [row.name for row in reversed(rows)], fontsize=7)
    axes.set_title("Validation: bands, what the model gives, and its spread over what is not published", fontsize=9)
    return figure


def _row(axes: Axes, place: int, row: Row) -> None:
    scale = _scale(row)
    assert scale is not None
    low, high = (_within(end / scale) for end in row.band)
    axes.barh(place, high - low, left=low, height=0.7, color="0.88", zorder=0)
    colour, marker = (HIT, "o") if row.ok else (MISS, "X")
    if row.spread is not None:
        axes.plot([_within(end / scale) for end in row.spread], (place, place), color=colour, lw=1.5)
    if math.isfinite(row.model):
        ratio = row.model / scale
        marker = "<" if ratio < LEAST else ">" if ratio > GREATEST else marker
        axes.plot(_within(ratio), place, marker, color=colour, ms=6, clip_on=False, zorder=3)


def _scale(row: Row) -> float | None:
    """Return by what a row is divided; None if a logarithmic axis cannot show it."""
    if row.published is None:
        return 1.0 if row.unit == "1" else None
    return row.published or None


def _within(ratio: float) -> float:
    return min(max(ratio, LEAST), GREATEST)
