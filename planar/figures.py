"""Figures of planar runs, drawn from plain arrays. No function opens a window."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from worm3d.values.arrays import FloatArray


def centre_of_mass(
    time: FloatArray, curves: Mapping[str, FloatArray], title: str = "Centre of mass", axes: Axes | None = None
) -> tuple[Figure, Axes]:
    """Draw the displacement of the centre of mass along x over time.

    Parameters
    ----------
    time : ndarray, shape (T,)
        Instants [s].
    curves : mapping of label to ndarray, shape (T,)
        Position of the centre of mass along x [m]. Each curve is drawn relative to its first value.
    axes : Axes, optional
        Axes to draw in; a new figure if left out.
    """
    moved = {label: com - com[0] for label, com in curves.items()}
    return _over_time(time, moved, title, "displacement of the centre of mass [m]", axes)


def cumulative_cost(
    time: FloatArray,
    curves: Mapping[str, FloatArray],
    title: str = "Cumulative cost of transport",
    axes: Axes | None = None,
    logarithmic: bool = False,
) -> tuple[Figure, Axes]:
    """Draw the cumulative cost of transport at the end of each step.

    The parameters are the same as in `centre_of_mass`, but the curves have the shape (S,) and the unit J/m.
    `logarithmic=True` gives the cost a logarithmic axis, for curves of very different magnitude.
    """
    figure, axes = _over_time(time, curves, title, "cumulative cost of transport [J/m]", axes)
    if logarithmic:
        axes.set_yscale("log", nonpositive="mask")
    return figure, axes


def activation(
    time: FloatArray,
    values: FloatArray,
    title: str = "Activation",
    quantity: str = "activation",
    unit: str = "",
    axes: Axes | None = None,
) -> tuple[Figure, Axes]:
    """Draw the command to each segment over time, one curve above the other, with the head at the top.

    Parameters
    ----------
    time : ndarray, shape (S,)
        End of each step [s].
    values : ndarray, shape (S, n)
        Activation or force of each segment. The zero of segment i is drawn at the height i.
    quantity, unit : str
        Name and unit of the values.
    axes : Axes, optional
        Axes to draw in; a new figure if left out.
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


def energy_ledger(
    time: FloatArray,
    incoming: Mapping[str, FloatArray],
    stored: Mapping[str, FloatArray],
    lost: Mapping[str, FloatArray],
    title: str = "Energy",
) -> tuple[Figure, Axes]:
    """Draw the energy balance over time: the supplied energy equals the stored energy plus the lost energy.

    Parameters
    ----------
    time : ndarray, shape (S,)
        End of each step [s].
    incoming, stored, lost : mapping of label to ndarray, shape (S,)
        Cumulative energy at the end of each step [J].
    """
    figure, axes = _prepared(None, title, "energy [J]")
    for style, what, curves in (("-", "in", incoming), ("--", "stored", stored), (":", "lost", lost)):
        for label, energy in curves.items():
            axes.plot(time, energy, style, label=f"{what}: {label} ({energy[-1]:.3g} J)")
    axes.legend(fontsize=7, loc="upper left")
    return figure, axes


def space_time(
    panels: Mapping[str, tuple[FloatArray, FloatArray]], ylabel: str, title: str = "Space and time"
) -> tuple[Figure, Axes]:
    """Draw quantities as colours over time and place, one panel for each quantity.

    The colour scale ends at the 99.5th percentile of the absolute values, so that a short impact does not make the rest
    of the panel pale.

    Parameters
    ----------
    panels : mapping of label to (time, values)
        The label is the name of a quantity with its unit. `time` has the shape (T,) [s]. `values` has the shape (T, n),
        with a column for each place.
    ylabel : str
        Label of the vertical axis, which counts the places (for example segments).

    Returns
    -------
    figure, axes
        The figure and the axes of the lowest panel.
    """
    figure = Figure(figsize=(6.4, 2.6 * len(panels)), layout="constrained", dpi=120)
    rows = np.ravel(figure.subplots(len(panels), 1, sharex=True))
    for axes, (label, (time, values)) in zip(rows, panels.items(), strict=True):
        signed = bool((values < 0.0).any())
        peak = float(np.percentile(np.abs(values), 99.5)) or 1.0
        colours = {"cmap": "RdBu_r", "vmin": -peak} if signed else {"cmap": "viridis", "vmin": 0.0}
        places = np.arange(values.shape[1])
        picture = axes.pcolormesh(time, places, values.T, vmax=peak, shading="nearest", rasterized=True, **colours)
        figure.colorbar(picture, ax=axes, label=label, extend="both" if signed else "max")
        axes.set_yticks(places if len(places) <= 12 else [])
        axes.set_ylabel(ylabel)
    rows[0].set_title(title, fontsize=10)
    rows[-1].set_xlabel("time [s]")
    return figure, rows[-1]


def case_panel(axes: Axes, parameter: FloatArray, values: FloatArray, xlabel: str, ylabel: str) -> None:
    """Draw a figure of merit over the varied parameter; cases without a value are marked with the word "none".

    `parameter` and `values` have the shape (C,), one entry for each case.
    """
    order = np.argsort(parameter)
    axes.plot(parameter[order], values[order], "o-")
    for x in parameter[~np.isfinite(values)]:
        axes.text(x, 0.03, "none", transform=axes.get_xaxis_transform(), ha="center", fontsize=8, color="0.4")
    margin = 0.08 * float(np.ptp(parameter)) or 1.0
    axes.set(xlim=(parameter.min() - margin, parameter.max() + margin), xlabel=xlabel, ylabel=ylabel)
    axes.margins(y=0.12)
    if len(parameter) <= 10:
        axes.set_xticks(np.unique(parameter))
    axes.grid(alpha=0.3)


def _over_time(
    time: FloatArray, curves: Mapping[str, FloatArray], title: str, ylabel: str, axes: Axes | None
) -> tuple[Figure, Axes]:
    figure, axes = _prepared(axes, title, ylabel)
    for label, values in curves.items():
        axes.plot(time, values, label=label)
    if len(curves) > 1:
        axes.legend(fontsize=8)
    return figure, axes


def _prepared(axes: Axes | None, title: str, ylabel: str) -> tuple[Figure, Axes]:
    if axes is None:
        axes = Figure(figsize=(6.4, 4.0), layout="constrained", dpi=120).subplots()
    axes.set(xlabel="time [s]", ylabel=ylabel)
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    return cast(Figure, axes.figure), axes
