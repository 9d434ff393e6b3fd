"""The figure of a fit: data and model over the abscissa of the model (usually time), residuals and autocorrelation."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenes.studies.fit.fitting import Fit
from scenes.studies.fit.noise import autocorrelation
from worm3d.values.arrays import FloatArray


def draw(fit: Fit) -> tuple[Figure, Axes]:
    """Return the figure, which has a row for each chosen channel, and the axes of the first panel."""
    chosen = _chosen(fit)
    figure = Figure(figsize=(12.5, 1.2 + 2.1 * len(chosen)), layout="constrained", dpi=110)
    grid = figure.subplots(len(chosen), 3, squeeze=False, width_ratios=(2.2, 2.2, 1.3))
    for row, k in zip(grid, chosen, strict=True):
        known = np.isfinite(fit.data.values[k])
        over, left = fit.abscissa.values[known], fit.residuals[k, known]
        row[0].plot(over, fit.data.values[k, known], ".", color="0.6", ms=3, label="measured")
        row[0].plot(over, fit.simulated[k, known], color="C3", lw=1.2, label="fitted")
        row[0].set_ylabel(f"{fit.data.names[k]}", fontsize=8)
        row[1].axhline(0.0, color="0.6", lw=0.8)
        row[1].plot(over, left, color="C0", lw=0.8)
        _draw_alike(row[2], fit.data.time[known], left)
    for axes, title in zip(grid[0], ("data and model", "residuals", "their autocorrelation"), strict=True):
        axes.set_title(title, fontsize=9)
    over_what = f"{fit.abscissa.long_name} [{fit.abscissa.units}]"
    for axes, label in zip(grid[-1], (over_what, over_what, "lag [s]"), strict=True):
        axes.set_xlabel(label)
    for axes in grid.flat:
        axes.grid(alpha=0.25)
        axes.tick_params(labelsize=8)
    grid[0][0].legend(fontsize=7)
    figure.suptitle(f"{fit.name} fitted to {fit.measured}", fontsize=11)
    return figure, grid[0][0]


def _chosen(fit: Fit) -> list[int]:
    """Return the indices of the drawn channels in ascending order.

    At most six channels are drawn: the channels with the largest standard deviation of the data relative to the rms of
    the residuals.
    """
    spread = np.nanstd(fit.data.values, axis=1)
    rms = np.array([channel.residual_rms for channel in fit.channels])
    signal = np.divide(spread, rms, out=np.full_like(spread, np.inf), where=rms > 0.0)
    return sorted(np.argsort(-np.where(spread > 0.0, signal, 0.0), kind="stable")[:6].tolist())


def _draw_alike(axes: Axes, time: FloatArray, left: FloatArray) -> None:
    """Draw the autocorrelation of the residuals `left`, and the band that holds 95 % of its values for white noise."""
    lags = max(1, len(left) // 4)
    found = autocorrelation(left, lags)
    bound = 1.96 / np.sqrt(len(left))
    axes.axhspan(-bound, bound, color="0.88")
    axes.axhline(0.0, color="0.6", lw=0.8)
    axes.plot(np.arange(lags + 1) * float(np.median(np.diff(time))), found, color="C0", lw=1.0)
    axes.set_ylim(-1.05, 1.05)
