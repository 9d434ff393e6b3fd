"""Figures of a sweep: a metric plotted against one or two varied keys, with marks for failed cases."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scenes.sweep.design import CASE, SAMPLE, Varied
from scenes.sweep.table import Table, cell, is_numeric
from worm3d.values.arrays import FloatArray

FAILED_MARKER: dict[str, Any] = {"marker": "x", "color": "C3", "s": 36, "linewidths": 1.5}

MOST_LABELS = 12
"""Maximum number of numeric values on an axis with a label for each value, and maximum number of curves with a
legend."""
MOST_NUMBERS = 64
"""Maximum number of cells of a map with the value printed in each cell."""
LEAST_RATIO = 8.0
"""Minimum ratio of the largest to the smallest value on a logarithmic axis."""
CATEGORIES = ("seed",)
"""Keys whose values are numbers but are treated as categories, because their magnitude has no meaning."""


def draw(table: Table, metric: str, label: str, title: str) -> Figure:
    """Return the figure of a metric of a sweep with one or two varied keys.

    The kind of figure depends on the keys. A numeric key gives a curve, or points if its values are random. A category
    gives bars. Two numeric keys give a map, or coloured points if their values are random. Two categories give a map. A
    numeric key and a category give one curve per category. A category and seeds give bars with one point per seed.
    """
    figure = Figure(figsize=(6.4, 4.4), layout="constrained", dpi=120)
    axes = figure.subplots()
    values = table.figures[metric]
    numbers = [each for each in table.design.varied if _is_axis(each)]
    others = [each for each in table.design.varied if not _is_axis(each)]
    names = [each for each in others if each.key not in CATEGORIES]
    if len(numbers) == 2 and len(table.design.sizes) == 2 and not any(map(_is_drawn, numbers)):
        _draw_map(axes, table, numbers, values, label)
    elif len(numbers) == 2:
        _draw_points(axes, table, numbers, values, label)
    elif len(names) == 2:
        _draw_map(axes, table, names, values, label)
    elif numbers:
        _draw_curves(axes, table, numbers[0], others, values, label)
    else:
        _draw_bars(axes, table, (names or others)[0], values, label)
    lost = int(table.failed.sum())
    said = f"; {lost} of {len(table)} cases failed (marked x)" if lost else ""
    axes.set_title(f"{title}: {label}{said}", fontsize=10)
    return figure


def _is_axis(varied: Varied) -> bool:
    return is_numeric(varied) and varied.key not in CATEGORIES


def _is_drawn(varied: Varied) -> bool:
    return varied.dim in (CASE, SAMPLE)


def _along(table: Table, varied: Varied) -> NDArray[Any]:
    """Return the value of a key in each case, shape (C,): numbers, or strings if the key is a category."""
    return np.array([case[varied.key] for case in table.values()], dtype=float if _is_axis(varied) else str)


def _draw_curves(
    axes: Axes, table: Table, varied: Varied, others: list[Varied], values: FloatArray, label: str
) -> None:
    """Draw a metric against a numeric key, with one curve for each value of another key, if there is one."""
    x = _along(table, varied)
    style = "o" if _is_drawn(varied) else "o-"
    for name, chosen in _groups(table, others):
        order = np.flatnonzero(chosen)[np.argsort(x[chosen], kind="stable")]
        axes.plot(x[order], values[order], style, ms=4, label=name)
    axes.plot(x, np.full(len(x), np.nanmean(values)), linestyle="none")  # invisible: extends the axis to all cases
    _mark_absent(axes, table, x, values)
    if others and len(axes.lines) <= MOST_LABELS:
        axes.legend(title=others[0].key, fontsize=8, title_fontsize=8)
    _scale(axes, "x", x)
    _name(axes, varied.key, label)


def _groups(table: Table, others: list[Varied]) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Yield each value of a key and a mask of the cases with this value; without a key, all cases as one group."""
    if not others:
        yield "", np.ones(len(table), dtype=bool)
    for key in others:
        along = _along(table, key)
        for value in dict.fromkeys(along.tolist()):
            yield value, along == value


def _draw_bars(axes: Axes, table: Table, varied: Varied, values: FloatArray, label: str) -> None:
    """Draw a metric for each value of a category.

    A bar shows the mean of the cases with this value. If there are several cases per value, points show the cases.
    """
    names = _along(table, varied).tolist()
    places = {name: place for place, name in enumerate(dict.fromkeys(names))}
    x = np.array([places[name] for name in names], dtype=float)
    known = np.isfinite(values)
    means = {place: values[known & (x == place)].mean() for place in np.unique(x[known])}
    alone = len(places) == len(names)
    axes.bar(list(means), list(means.values()), width=0.6, alpha=1.0 if alone else 0.4)
    axes.axhline(0.0, color="0.4", lw=0.8)
    if not alone:
        axes.plot(x, values, "o", color="C0", ms=4, alpha=0.7)
    _mark_absent(axes, table, x, values)
    _ticks(axes, "x", list(places))
    _name(axes, varied.key, label)


def _draw_points(axes: Axes, table: Table, keys: list[Varied], values: FloatArray, label: str) -> None:
    """Draw cases as points in the plane of two numeric keys, coloured by a metric."""
    x, y = (_along(table, key) for key in keys)
    shown = np.isfinite(values)
    points = axes.scatter(x[shown], y[shown], c=values[shown], s=28, **colours(values))
    axes.scatter(x[table.failed], y[table.failed], **FAILED_MARKER)
    assert isinstance(axes.figure, Figure)
    axes.figure.colorbar(points, ax=axes, label=label)
    for which, along in (("x", x), ("y", y)):
        _scale(axes, which, along)
    _name(axes, keys[0].key, keys[1].key)


def _draw_map(axes: Axes, table: Table, keys: list[Varied], values: FloatArray, label: str) -> None:
    """Draw a metric as a map on the grid of the values of two keys, the first along x."""
    sizes = list(table.design.sizes.values())
    marks = [_marks(key) for key in keys]
    orders = [np.argsort(each, kind="stable") for each in marks]
    x, y = (each[order] for each, order in zip(marks, orders, strict=True))
    cells = values.reshape(sizes)[np.ix_(*orders)].T
    failed = table.failed.reshape(sizes)[np.ix_(*orders)].T
    mesh = axes.pcolormesh(edges(x), edges(y), np.ma.masked_invalid(cells), **colours(values))
    axes.set_facecolor("0.92")
    rows, columns = np.nonzero(failed)
    axes.scatter(x[columns], y[rows], **FAILED_MARKER)
    if cells.size <= MOST_NUMBERS:
        for (row, column), value in np.ndenumerate(cells):
            if np.isfinite(value):
                style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7, "color": _ink(mesh, value)}
                axes.text(float(x[column]), float(y[row]), f"{value:.3g}", **style)
    assert isinstance(axes.figure, Figure)
    axes.figure.colorbar(mesh, ax=axes, label=label)
    for which, key, along in (("x", keys[0], x), ("y", keys[1], y)):
        if _is_axis(key):
            _scale(axes, which, along)
        else:
            _ticks(axes, which, [str(cell(value)) for value in key.values])
    axes.set(xlabel=keys[0].key, ylabel=keys[1].key)


def _marks(varied: Varied) -> FloatArray:
    """Return the positions of the values of a key along an axis: the values, or 0, 1, 2, ... for a category."""
    return np.array(varied.values if _is_axis(varied) else range(len(varied.values)), dtype=float)


def edges(marks: FloatArray) -> FloatArray:
    """Return the edges of the cells around increasing positions, shape (K + 1,) for K positions.

    An edge is half-way between two positions as seen on the axis, which is linear or logarithmic.
    """
    if len(marks) == 1:
        half = 0.5 * abs(float(marks[0])) or 0.5
        return np.array([marks[0] - half, marks[0] + half])
    logarithmic = is_logarithmic(marks)
    seen = np.log(marks) if logarithmic else marks
    inner = 0.5 * (seen[1:] + seen[:-1])
    ends = np.concatenate([[2.0 * seen[0] - inner[0]], inner, [2.0 * seen[-1] - inner[-1]]])
    found: FloatArray = np.exp(ends) if logarithmic else ends
    return found


def is_logarithmic(values: FloatArray) -> bool:
    """Return whether an axis with these values should be logarithmic.

    The values must span a wide range (`LEAST_RATIO`), and their median must be closer to the geometric than to the
    arithmetic mean of the smallest and the largest value.
    """
    low, high = float(values.min()), float(values.max())
    if low <= 0.0 or high < LEAST_RATIO * low:
        return False
    geometric, arithmetic = np.sqrt(low * high), 0.5 * (low + high)
    return bool(np.median(values) < np.sqrt(geometric * arithmetic))


def _scale(axes: Axes, which: str, values: FloatArray) -> None:
    """Choose a linear or logarithmic axis, and label each value if the values are few and far enough apart."""
    distinct, logarithmic = np.unique(values), is_logarithmic(values)
    places = np.log(distinct) if logarithmic else distinct
    if logarithmic:
        getattr(axes, f"set_{which}scale")("log")
    if len(distinct) <= MOST_LABELS and (np.diff(places) > 0.06 * np.ptp(places)).all():
        getattr(axes, f"set_{which}ticks")(distinct, [f"{value:.4g}" for value in distinct])
        getattr(axes, f"set_{which}ticks")([], minor=True)


def _ticks(axes: Axes, which: str, names: list[str]) -> None:
    """Label the categories along an axis. If there are too many, label only every second, third, ... category."""
    step = 1 + (len(names) - 1) // (3 * MOST_LABELS)
    turned = which == "x" and sum(map(len, names)) > 60
    getattr(axes, f"set_{which}ticks")(range(0, len(names), step), names[::step], rotation=30 if turned else 0)
    if turned:
        for text in axes.get_xticklabels():
            text.set_horizontalalignment("right")


def colours(values: FloatArray) -> dict[str, Any]:
    """Return the colour map and its limits. If the metric has both signs, the colours distinguish them."""
    known = values[np.isfinite(values)]
    low, high = float(known.min()), float(known.max())
    if low < 0.0 < high:
        most = max(-low, high)
        return {"cmap": "RdBu", "vmin": -most, "vmax": most}
    return {"cmap": "viridis", "vmin": low, "vmax": high}


def _ink(mesh: Any, value: float) -> str:
    red, green, blue, _ = mesh.cmap(mesh.norm(value))
    return "black" if 0.3 * red + 0.59 * green + 0.11 * blue > 0.5 else "white"


def _mark_absent(axes: Axes, table: Table, x: FloatArray, values: FloatArray) -> None:
    """Mark cases at the bottom of the axes: failed cases by x, and finished cases without a value by "none"."""
    foot = axes.get_xaxis_transform()
    failed = np.unique(x[table.failed])
    axes.scatter(failed, np.full(len(failed), 0.03), transform=foot, **FAILED_MARKER)
    for place in np.unique(x[table.done & ~np.isfinite(values)]):
        axes.text(place, 0.03, "none", transform=foot, ha="center", fontsize=8, color="0.4")


def _name(axes: Axes, x: str, y: str) -> None:
    axes.set(xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    axes.set_axisbelow(True)
