"""The figure of the validation report, with a line for each row of the report.

It shows the errors relative to their tolerances, and the ratios of model and published number with their bands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scenes.studies.validate.rows import AGREES, DEPENDS, MISSES, Row

Range = tuple[float, float]

RATIOS: Range = (0.03, 30.0)
"""Range of the axis of ratios. A ratio outside is drawn at the end of the range."""

ERRORS: Range = (1e-4, 30.0)
"""Range of the axis of errors relative to tolerances. An error outside is drawn at the end of the range."""

AGREEMENT_COLOURS = {AGREES: "C2", DEPENDS: "C1", MISSES: "C3"}
"""Colour of a row by its agreement."""

NOT_COUNTED = "0.6"
"""Colour of rows that do not count."""

RATIO_LABEL = "model over published number (trends: model), bands, and spreads"


def draw(chapters: Mapping[str, Sequence[Row]]) -> Figure:
    """Return the figure. One panel has the rows with a tolerance, the other panel the rows with a band."""
    rows = [row for each in chapters.values() for row in each]
    exact = [row for row in rows if not isinstance(row.tolerance, tuple)]
    banded = [row for row in rows if isinstance(row.tolerance, tuple) and _scale(row) is not None]
    both = ((exact, _error, ERRORS, "error over tolerance"), (banded, _ratio, RATIOS, RATIO_LABEL))
    panels = [panel for panel in both if panel[0]]
    if not panels:
        return Figure()
    heights = [len(panel[0]) + 3 for panel in panels]
    figure = Figure(figsize=(9.0, 0.22 * sum(heights) + 0.3), layout="constrained", dpi=110)
    grid = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, panel in zip(grid, panels, strict=True):
        _panel(axes, *panel)
    words = {**AGREEMENT_COLOURS, "fitted or input, not counted": NOT_COUNTED}
    marks = [Line2D([], [], marker="o", ls="", color=colour, label=word) for word, colour in words.items()]
    figure.legend(handles=marks, loc="outside upper right", ncols=len(marks), fontsize=7)
    return figure


def _panel(axes: Axes, rows: Sequence[Row], mark: Callable[[Axes, int, Row], None], limits: Range, label: str) -> None:
    axes.axvline(1.0, color="0.4", lw=0.8)
    for place, row in enumerate(reversed(rows)):
        mark(axes, place, row)
    axes.set(xscale="log", xlim=limits, ylim=(-0.7, len(rows) - 0.3))
    axes.set_xlabel(label, fontsize=8)
    axes.set_yticks(range(len(rows)), [row.name for row in reversed(rows)], fontsize=7)
    axes.tick_params(axis="x", labelsize=7)


def _error(axes: Axes, place: int, row: Row) -> None:
    low, high = row.band
    if math.isfinite(row.model):
        _dot(axes, place, abs(row.model - 0.5 * (low + high)) / (0.5 * (high - low)), ERRORS, row)


def _ratio(axes: Axes, place: int, row: Row) -> None:
    scale = _scale(row)
    assert scale is not None
    low, high = (_within(end / scale, RATIOS) for end in row.band)
    axes.barh(place, high - low, left=low, height=0.7, color="0.88", zorder=0)
    if row.spread is not None:
        ends = [_within(end / scale, RATIOS) for end in row.spread]
        axes.plot(ends, (place, place), color=_colour(row), lw=1.5)
    if math.isfinite(row.model):
        _dot(axes, place, row.model / scale, RATIOS, row)


def _dot(axes: Axes, place: int, value: float, limits: Range, row: Row) -> None:
    marker = "<" if value < limits[0] else ">" if value > limits[1] else "o" if row.ok else "X"
    axes.plot(_within(value, limits), place, marker, color=_colour(row), ms=5, clip_on=False, zorder=3)


def _colour(row: Row) -> str:
    return AGREEMENT_COLOURS[row.agreement] if row.counts else NOT_COUNTED


def _scale(row: Row) -> float | None:
    """Return the divisor of the values of a row; None if a logarithmic axis cannot show the row."""
    if row.published is None:
        return 1.0 if row.unit == "1" else None
    return row.published or None


def _within(value: float, limits: Range) -> float:
    return min(max(value, limits[0]), limits[1])
