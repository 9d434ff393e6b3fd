"""Drawing of the error against the time step: smooth motion in free flight, and a crawl with contacts, from runs."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from _style import FORCE, LINK, LONG, PALE, drawing, letter
from matplotlib.axes import Axes

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Plane, Result, Worm

STEPS = (0.02, 0.01, 0.005, 0.002, 0.001, 0.0005)
"""Time steps [s]."""
FINEST = 0.000125
"""Time step of the reference [s]."""
KINDS = {"implicit_euler": ("implicit Euler", FORCE, "s"), "bdf2": ("BDF2", LONG, "o")}


def main(folder: Path) -> None:
    """Write drawings/time_step.svg."""
    with drawing(folder, "time_step", 3.6) as figure:
        smooth, crawl = figure.subplots(1, 2)
        figure.subplots_adjust(left=0.1, right=0.985, top=0.92, bottom=0.15, wspace=0.28)
        _smooth(smooth)
        _crawl(crawl)


def _flight(dt: float, integrator: str) -> Result:
    """Let a worm that contracts in waves fly freely, without contact."""
    gait = TravellingWave(period=0.5, amplitude=0.2, rectified=False)
    return worm3d.simulate(Worm(actuator_lag=0.0), None, None, gait, 0.5, dt, integrator, gravity=(0.0, 0.0, 0.0))


def _crawled(dt: float, integrator: str) -> Result:
    gait = TravellingWave(period=1.0, amplitude=0.2)
    return worm3d.simulate(Worm(), Plane(), Friction(), gait, 4.0, dt, integrator)


def _axes(axes: Axes, name: str, title: str, unit: str) -> None:
    axes.set(xscale="log", yscale="log", xlabel="time step [ms]", ylabel=f"error [{unit}]", title="")
    axes.set_title(title, loc="left")
    letter(axes, name)
    axes.set_xticks([0.5, 1.0, 2.0, 5.0, 10.0, 20.0], ["0.5", "1", "2", "5", "10", "20"])
    axes.minorticks_off()
    axes.grid(color=PALE, alpha=0.3, lw=0.6)


def _smooth(axes: Axes) -> None:
    """Draw the error of the chambers' lengths at the end of a flight."""
    right = _flight(FINEST, "bdf2").chamber_length[-1]
    for kind, (name, colour, mark) in KINDS.items():
        errors = [float(np.abs(_flight(dt, kind).chamber_length[-1] - right).max()) for dt in STEPS]
        axes.plot(1e3 * np.array(STEPS), 1e3 * np.array(errors), marker=mark, color=colour, label=name)
        order = 1 if kind == "implicit_euler" else 2
        line = 0.5 * errors[2] * (np.array(STEPS[:-1]) / STEPS[2]) ** order
        axes.plot(1e3 * np.array(STEPS[:-1]), 1e3 * line, color=LINK, lw=0.9, ls=(0, (4, 2)))
        at = (2.2, 0.6 * line[3]) if order == 1 else (5.5, 0.9 * line[2])
        axes.text(at[0], 1e3 * at[1], f"order {order}", color=LINK, va="top", fontsize=9)
    _axes(axes, "A", "smooth motion, lengths", "mm")
    axes.legend(loc="upper left")


def _crawl(axes: Axes) -> None:
    """Draw the error of the distance of a crawl."""
    right = _crawled(FINEST, "bdf2").distance
    for kind, (_, colour, mark) in KINDS.items():
        errors = [100.0 * abs(_crawled(dt, kind).distance / right - 1.0) for dt in STEPS]
        axes.plot(1e3 * np.array(STEPS), errors, marker=mark, color=colour)
    _axes(axes, "B", "a crawl, distance", "% of the distance")
    axes.set_yticks([0.5, 1.0, 2.0, 5.0, 10.0], ["0.5", "1", "2", "5", "10"])
    axes.set_ylim(0.2, 10.0)
    axes.minorticks_off()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
