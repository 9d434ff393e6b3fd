"""The figure of a study, with one panel for each view: curves, bars or a map."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from scenes.studies.study.study import Grid
from scenes.studies.study.view import Axis, View
from scenes.sweep.figures import FAILED_MARKER, colours, edges, is_logarithmic
from worm3d.values.arrays import FloatArray

PANEL = (4.2, 3.4)
"""Width and height of a panel [inch]."""
HATCHES = ("///", "\\\\\\", "...")
MARKERS = "os^Dv<>ph*X"


def draw(grid: Grid) -> Figure:
    """Return the figure of a study."""
    panels = [view for view in grid.views() if np.isfinite(view.values).any()]
    columns = min(len(panels), 2 if len(panels) == 4 else 3)
    rows = math.ceil(len(panels) / columns)
    figure = Figure(figsize=(PANEL[0] * columns, PANEL[1] * rows + 0.8), layout="constrained", dpi=120)
    places = figure.subplots(rows, columns, squeeze=False)
    for axes, view in zip(places.flat, panels, strict=False):
        (_map if grid.is_map else _curves if grid.x.is_number else _bars)(axes, grid, view)
        said = "; ".join(filter(None, (view.where, _errors(view.without(grid.left_out())))))
        axes.set_title(textwrap.fill(said, 50), fontsize=8)
    for axes in places.flat[len(panels) :]:
        axes.set_axis_off()
    handles, labels = places.flat[0].get_legend_handles_labels()
    marks = [
        Patch(facecolor="none", edgecolor="k", hatch=hatch, label=name)
        for name, hatch in zip(grid.marked(), HATCHES, strict=False)
    ]
    if named := [*(h for h, label in zip(handles, labels, strict=True) if label), *marks]:
        figure.legend(handles=named, loc="outside lower center", ncols=min(len(named), 5), fontsize=8)
    title = getattr(grid.scene.settings, "title", "") or grid.scene.name
    figure.suptitle(title, fontsize=11)
    return figure


def _errors(view: View) -> str:
    """Return a text with the errors of the values of a panel; empty if no error is known."""
    known = view.off[np.isfinite(view.off) & np.isfinite(view.values)]
    return f"errors: median {np.median(known):.1g}, largest {known.max():.1g}" if known.size else ""


def _curves(axes: Axes, grid: Grid, view: View) -> None:
    values = view.values
    x = np.array(grid.x.varied.values, dtype=float)
    order, foot = np.argsort(x, kind="stable"), axes.get_xaxis_transform()
    for c, (name, y, off) in enumerate(zip(grid.curves, values.T, np.nan_to_num(view.off).T, strict=True)):
        style, colour = f"{MARKERS[c % len(MARKERS)]}-", f"C{c}" if c < 10 else "k"  # ten colours, then black
        axes.errorbar(x[order], y[order], yerr=off[order], fmt=style, color=colour, label=name, ms=4)
    for marked in grid.marked().values():
        rows, columns = np.nonzero(marked)
        axes.plot(x[rows], values[rows, columns], "o", ms=9, mfc="none", color="k")
    failed = x[grid.failed.any(axis=1)]
    axes.scatter(failed, np.full(len(failed), 0.03), transform=foot, **FAILED_MARKER)
    _number_axis(axes, "x", grid.x, x)
    if np.nanmin(values) <= 0.0 <= np.nanmax(values):
        axes.axhline(0.0, color="0.5", lw=0.8)
    elif _spans_much(values):
        axes.set_yscale("log")
        _plain_ticks(axes, "y")
    axes.set_ylabel(view.measure.label, fontsize=9)
    axes.grid(alpha=0.3)


def _bars(axes: Axes, grid: Grid, view: View) -> None:
    values, offs = view.values, np.nan_to_num(view.off)
    names, width = [grid.x.told(k) for k in range(len(values))], 0.8 / values.shape[1]
    for c, (name, y, off) in enumerate(zip(grid.curves, values.T, offs.T, strict=True)):
        at = np.arange(len(values)) + (c + 0.5) * width - 0.4
        axes.barh(at, y, xerr=off, height=width, color=f"C{c}", label=name, capsize=2.0)
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel(view.measure.label, fontsize=9)
    axes.grid(alpha=0.3, axis="x")
    axes.set_axisbelow(True)


def _map(axes: Axes, grid: Grid, view: View) -> None:
    assert grid.other is not None
    values = view.values
    keys = (grid.x, grid.other)
    marks = [np.array(each.varied.values, dtype=float) for each in keys]
    orders = [np.argsort(each, kind="stable") for each in marks]
    x, y = (each[order] for each, order in zip(marks, orders, strict=True))
    cells = values[np.ix_(*orders)].T
    corners = (edges(x), edges(y))
    counted = view.without(grid.left_out()).values
    style = _colours(counted if np.isfinite(counted).any() else values)
    mesh = axes.pcolormesh(*corners, np.ma.masked_invalid(cells), **style)
    axes.set_facecolor("0.92")
    columns, rows = np.nonzero(grid.failed[np.ix_(*orders)])
    axes.scatter(x[columns], y[rows], **FAILED_MARKER)
    for marked, hatch in zip(grid.marked().values(), HATCHES, strict=False):
        shown = np.ma.masked_equal(marked[np.ix_(*orders)].T.astype(float), 0.0)
        axes.pcolor(*corners, shown, hatch=hatch, cmap=ListedColormap([(0.0, 0.0, 0.0, 0.0)]))
    assert isinstance(axes.figure, Figure)
    bar = axes.figure.colorbar(mesh, ax=axes, label=view.measure.label)
    if _spans_much(values):
        _plain_ticks(bar.ax, "y")
    for which, key, along in (("x", grid.x, x), ("y", grid.other, y)):
        _number_axis(axes, which, key, along)


def _colours(values: FloatArray) -> dict[str, Any]:
    """Return the options for the colours of a map, for the range of the given values."""
    if not _spans_much(values):
        return colours(_without_faint(values))
    return {"cmap": "viridis", "norm": LogNorm(float(np.nanmin(values)), float(np.nanmax(values)))}


def _spans_much(values: FloatArray) -> bool:
    """Return whether values need a logarithmic scale, because all are positive and span a factor above 20."""
    known = values[np.isfinite(values)]
    return bool(known.min() > 0.0 and known.max() > 20.0 * known.min())


def _without_faint(values: FloatArray) -> FloatArray:
    """Return the values, with negative values replaced by 0 if their magnitude is at most 5 % of the largest value."""
    known = values[np.isfinite(values)]
    return np.maximum(values, 0.0) if -known.min() <= 0.05 * known.max() else values


def _plain_ticks(axes: Axes, which: str) -> None:
    """Label a logarithmic axis with plain numbers instead of powers of ten."""
    axis = getattr(axes, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _number_axis(axes: Axes, which: str, axis: Axis, values: FloatArray) -> None:
    """Label an axis and its values without overlap. The axis is logarithmic if the values are (`is_logarithmic`)."""
    distinct = np.unique(values)
    if is_logarithmic(distinct):
        getattr(axes, f"set_{which}scale")("log")
    shown = list(_apart(np.log(distinct) if is_logarithmic(distinct) else distinct))
    getattr(axes, f"set_{which}ticks")(distinct[shown], [f"{distinct[k]:.3g}" for k in shown], fontsize=8)
    getattr(axes, f"set_{which}ticks")([], minor=True)
    getattr(axes, f"set_{which}label")(axis.label, fontsize=9)


def _apart(places: FloatArray) -> Iterator[int]:
    """Yield the indices of at most ten values of an axis whose labels do not overlap."""
    last = -np.inf
    for k, place in enumerate(places):
        if place - last >= np.ptp(places) / 9.0:
            yield k
            last = float(place)
