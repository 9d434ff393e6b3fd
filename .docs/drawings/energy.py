"""Drawing of the energy ledger: where the work of the actuators goes, over time and for three worms."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from _style import ANCHOR, FORCE, INK, LINK, LONG, PALE, TRAIL, drawing, letter
from matplotlib.axes import Axes

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Plane, Result, Worm
from worm3d.recorded.energy import STORED_ENERGY
from worm3d.values.arrays import FloatArray

USE_COLOURS = {"damping": LONG, "friction": ANCHOR, "impact": TRAIL, "gained": FORCE, "numerical": PALE}
"""Colour of each use of the work. Friction in the joints of the chambers is left out, because the worms have none."""
DURATION = 10.0
SHOWN = 10
"""Every row with this distance is drawn."""


def main(folder: Path) -> None:
    """Write drawings/energy.svg."""
    level, damped, slope = Plane(), Worm(), Plane(slope=0.1)
    light = Worm(kelvin_voigt_time=0.01)
    runs = {
        "level ground": _run(damped, level),
        "level ground,\nlittle damping": _run(light, level),
        "slope of\n0.1 rad": _run(damped, slope),
    }
    with drawing(folder, "energy", 5.2) as figure:
        over_time, bars = figure.subplots(2, 1, height_ratios=[1.25, 1.0])
        figure.subplots_adjust(left=0.155, right=0.98, top=0.94, bottom=0.1, hspace=0.5)
        _over_time(over_time, runs["slope of\n0.1 rad"])
        _bars(bars, runs)


def _run(worm: Worm, world: Plane) -> Result:
    return worm3d.simulate(worm, world, Friction(), TravellingWave(amplitude=0.2), duration=DURATION, dt=0.005)


def _uses(result: Result) -> dict[str, FloatArray]:
    """Return each use of the work up to each row, shape (T,) [J]."""
    energy = result.energy
    parts = {
        "damping": energy.viscous_loss + energy.actuator_loss,
        "friction": energy.friction_loss,
        "impact": energy.impact,
        "gained": energy.sum(STORED_ENERGY) - energy.load_change,
        "numerical": energy.numerical_loss,
    }
    return {name: np.cumsum(part) for name, part in parts.items()}


def _over_time(axes: Axes, result: Result) -> None:
    axes.set_title("up a slope of 0.1 rad: work, and its uses", loc="left")
    letter(axes, "A")
    time = result.time[::SHOWN]
    low = np.zeros(len(time))
    for name, part in _uses(result).items():
        part = part[::SHOWN]
        axes.fill_between(time, low, low + part, color=USE_COLOURS[name], lw=0, alpha=0.8)
        low = low + part
    work = np.cumsum(result.energy.work_contract)[::SHOWN]
    axes.plot(time, work, color=INK, lw=1.4)
    axes.set(xlim=(0.0, DURATION), ylim=(0.0, None), xlabel="time [s]", ylabel="energy [J]")
    axes.annotate(
        "work of the actuators",
        (5.6, np.interp(5.6, time, work)),
        (2.2, 0.41),
        va="center",
        ha="center",
        arrowprops={"arrowstyle": "-", "color": LINK, "lw": 0.8},
    )


def _bars(axes: Axes, runs: dict[str, Result]) -> None:
    axes.set_title(f"uses of the work in {DURATION:.0f} s", loc="left")
    letter(axes, "B")
    for y, result in enumerate(runs.values()):
        right = left = 0.0
        for name, colour in USE_COLOURS.items():
            value = result.energy.uses[name]
            axes.barh(y, value, left=right if value > 0.0 else left, color=colour, height=0.55, alpha=0.8)
            right, left = right + max(value, 0.0), left + min(value, 0.0)
        axes.text(right + 0.008, y, f"{result.energy.work_contract.sum():.2f} J", va="center", color=INK)
    axes.axvline(0.0, color=LINK, lw=0.8)
    axes.set(yticks=range(len(runs)), yticklabels=runs, xlabel="energy [J]", xlim=(-0.02, 0.78), ylim=(2.6, -0.6))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    handles = [axes.barh(0, 0, color=colour, alpha=0.8, label=name) for name, colour in USE_COLOURS.items()]
    axes.legend(handles=handles, loc="center right", handlelength=1.0)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
