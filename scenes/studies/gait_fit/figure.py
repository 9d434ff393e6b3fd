"""The figure of a chain of neurons that was fitted to recordings of animals.

The figure shows the delays of the waves along the body, and a part of each recording with the waves in it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenes.studies.gait_fit.comparison import Comparison
from scenes.studies.gait_fit.recordings import Recording

HALF_STRETCH_S = 12.5
"""Half of the duration of the drawn part of a recording [s]. The part is centred at the middle wave."""


def draw(found: Comparison, recordings: Sequence[Recording], title: str) -> Figure:
    """Return the figure, which has a row for each of the first eight recordings.

    The left panel of a row compares the recorded delays with the delays in the fitted chain and in a wave with uniform
    delays. The right panel shows a part of the recording.

    Parameters
    ----------
    found : Comparison
        Comparison of the fitted chain with the recordings.
    recordings : sequence of Recording
    title : str
        Title of the figure.
    """
    shown = recordings[:8]
    figure = Figure(figsize=(13.0, 1.0 + 2.6 * len(shown)), layout="constrained", dpi=110)
    grid = figure.subplots(len(shown), 2, squeeze=False, width_ratios=(1.0, 2.2))
    for (left, right), each in zip(grid, shown, strict=True):
        _draw_delays(left, found, each)
        _draw_stretch(right, each)
    grid[0][0].legend(fontsize=8)
    grid[-1][0].set_xlabel("bands, in the order in which a wave reaches them")
    grid[-1][1].set_xlabel("time [s]")
    grid[0][1].set_title("grey: recorded values of each band; red: the troughs of each wave", fontsize=9)
    figure.suptitle(title, fontsize=11)
    return figure


def _draw_delays(axes: Axes, found: Comparison, each: Recording) -> None:
    waves = each.waves
    rows = {row.band: row for row in found.rows if row.recording == each.name}
    places = [k for k in range(len(waves.bands)) if k != waves.middle]
    own = [rows[waves.bands[k]] for k in places]
    middle = [row.delay_s for row in own]
    reach = np.array([[row.delay_s - row.low_s, row.high_s - row.delay_s] for row in own]).T
    axes.axhline(0.0, color="0.8", lw=0.8)
    axes.errorbar(places, middle, np.abs(reach), fmt="o", color="k", ms=4, capsize=3, label="recorded, 90 % interval")
    axes.plot(places, [row.network_s for row in own], "C3.-", label="network")
    axes.plot(places, [row.uniform_s for row in own], "C0--", lw=1.0, label="uniform delays")
    axes.set_xticks(range(len(waves.bands)), waves.bands)
    axes.set_ylabel(f"delay after {waves.bands[waves.middle]} [s]", fontsize=8)
    use = own[0].use
    axes.set_title(f"{each.name}: {use}, {len(waves.times)} waves, period {waves.period:.2f} s", fontsize=9)
    axes.grid(alpha=0.25)


def _draw_stretch(axes: Axes, each: Recording) -> None:
    waves = each.waves
    centre = float(waves.times[len(waves.times) // 2, waves.middle])
    near = np.abs(each.time - centre) < HALF_STRETCH_S
    scale = 0.4 / max(float(np.nanmax(np.abs(each.values[near]))), 1e-300)
    for k in range(len(waves.bands)):
        axes.plot(each.time[near], k + 2.0 * scale * each.values[near, k], color="0.4", lw=0.8)
    for wave in waves.times:
        if abs(wave[waves.middle] - centre) < HALF_STRETCH_S:
            axes.plot(wave, np.arange(len(wave)), "C3.-", lw=1.0, ms=5)
    axes.set_yticks(range(len(waves.bands)), waves.bands)
    axes.set_xlim(centre - HALF_STRETCH_S, centre + HALF_STRETCH_S)
