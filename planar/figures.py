"""Figures of planar runs from plain arrays; each returns (figure, axes) and never shows a window."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planar.metrics import FloatArray


def centre_of_mass(
    time: FloatArray,
    curves: Mapping[str, FloatArray],
    title: str = "Centre of mass",
    axes: Axes | None = None,
) -> tuple[Figure, Axes]:
    """Draw the displacement of the centre of mass along x over time.

    Parameters
    ----------
    time : ndarray, shape (T,)
        [s].
    curves : mapping of label to ndarray, shape (T,)
        Centre of mass along x [m]; each is drawn from its own start.
    axes : Axes, optional
        Where to draw; a new figure if left out.
    """
    figure, axes = _prepared(axes, title, "displacement of the centre of mass [m]")
    for label, com in curves.items():
        axes.plot(time, com - com[0], label=label)
    _legend(axes, len(curves))
    return figure, axes


def cumulative_cost(
    time: FloatArray,
    curves: Mapping[str, FloatArray],
    title: str = "Cumulative cost of transport",
    axes: Axes | None = None,
) -> tuple[Figure, Axes]:
    """Draw the cumulative cost of transport over time.

    Parameters
    ----------
    time : ndarray, shape (S,)
        End of each step [s].
    curves : mapping of label to ndarray, shape (S,)
        Cumulative cost of transport [J/m].
    axes : Axes, optional
        Where to draw; a new figure if left out.
    """
    figure, axes = _prepared(axes, title, "cumulative cost of transport [J/m]")
    for label, cost in curves.items():
        axes.plot(time, cost, label=label)
    _legend(axes, len(curves))
    return figure, axes


def activation(
    time: FloatArray,
    values: FloatArray,
    title: str = "Activation",
    quantity: str = "activation",
    unit: str = "",
    axes: Axes | None = None,
) -> tuple[Figure, Axes]:
    """Draw what each segment is told to do over time, the segments one above the other, the head on top.

    Parameters
    ----------
    time : ndarray, shape (S,)
        [s].
    values : ndarray, shape (S, n)
        Activation or force of each segment; zero is drawn at the height of the segment's number.
    quantity, unit : str
        What the values are.
    axes : Axes, optional
        Where to draw; a new figure if left out.
    """
    segments = values.shape[1]
    figure, axes = _prepared(axes, title, "segment (0 = tail)")
    peak = float(np.abs(values).max()) or 1.0
    for i in range(segments):
        height = i + 0.45 * values[:, i] / peak
        axes.fill_between(time, i, height, color=f"C{i % 10}", alpha=0.35, lw=0)
        axes.plot(time, height, color=f"C{i % 10}", lw=1)
    axes.set_yticks(range(segments))
    axes.set_title(f"{title}\nhighest {quantity}: {peak:.3g} {unit}".rstrip(), fontsize=10)
    return figure, axes


def _prepared(axes: Axes | None, title: str, ylabel: str) -> tuple[Figure, Axes]:
    if axes is None:
        axes = Figure(figsize=(6.4, 4.0), layout="constrained", dpi=120).subplots()
    axes.set_xlabel("time [s]")
    axes.set_ylabel(ylabel)
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    return cast(Figure, axes.figure), axes


def _legend(axes: Axes, curves: int) -> None:
    if curves > 1:
        axes.legend(fontsize=8)
