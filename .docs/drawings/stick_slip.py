"""Drawing of sticking, breakaway and sliding: a worm that is pulled along its axis, from a run of the program."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from _style import ANCHOR, FORCE, INK, LINK, PALE, SHORT, drawing
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import worm3d
from worm3d import Friction, Plane, Result, Worm

DRAWN_GROUND = Friction(forward=0.20, backward=0.40, lateral=0.30, static_ratio=1.5)
DRAWN_WORM = Worm(segments=3, length=0.3, half_height=0.02, chamber_offset=0.02, k_spring=1e5, k_yaw=1e3, k_twist=1e3)
"""A stiff and low worm, so that all contacts bear about the same load and move together."""
SETTLED, RISE, REST = 0.2, 1.0, 2.0
"""Times at which the pull begins, is greatest, and ends [s]."""
PEAK = 1.3 * 1.5 * 0.20
"""Greatest pull, over the weight."""


def main(folder: Path) -> None:
    """Write drawings/stick_slip.svg."""
    result = _run()
    with drawing(folder, "stick_slip", 5.0) as figure:
        _draw(figure, result)


def _pull(time: float) -> float:
    """Return the pull over the weight at a time [s]."""
    return PEAK * float(np.interp(time, [SETTLED, RISE, REST], [0.0, 1.0, 0.0]))


def _run() -> Result:
    """Pull the worm forward by a force on all joints that rises and falls again."""
    share = DRAWN_WORM.joint_mass / DRAWN_WORM.joint_mass.sum() * DRAWN_WORM.mass * 9.81

    def force(time: float) -> np.ndarray:
        return np.outer(_pull(time) * share, [1.0, 0.0, 0.0])

    return worm3d.simulate(DRAWN_WORM, Plane(), DRAWN_GROUND, duration=2.4, dt=0.001, external_force=force)


def _draw(figure: Figure, result: Result) -> None:
    """Draw forces, displacement, and the displacement before breakaway."""
    forces, moved, small = figure.subplots(3, 1, sharex=True, height_ratios=[1.5, 1.0, 1.0])
    figure.subplots_adjust(left=0.13, right=0.98, top=0.98, bottom=0.1, hspace=0.18)
    slides = _sliding(result)
    for axes in (forces, moved, small):
        for begin, end in slides:
            axes.axvspan(begin, end, color=SHORT, alpha=0.09, lw=0)
        axes.axhline(0.0, color=PALE, lw=0.8)
    _forces(forces, result, slides)
    way = result.com[:, 0] - result.com[0, 0]
    moved.plot(result.time, 1e3 * way, color=INK)
    moved.set_ylabel("displacement\n[mm]")
    small.plot(result.time, 1e6 * way, color=INK)
    small.set(ylabel="the same\n[µm]", xlabel="time [s]", ylim=(-0.4, 3.0), xlim=(0.0, result.time[-1]))


def _sliding(result: Result) -> list[tuple[float, float]]:
    """Return the intervals of time in which contacts slide [s]."""
    moves = np.concatenate([[0], (result.slip.sum(axis=(1, 2)) + result.joint_slip.sum(axis=1) > 0.0).astype(int), [0]])
    edges = np.diff(moves)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(float(result.time[max(a - 1, 0)]), float(result.time[b])) for a, b in zip(begins, ends, strict=True)]


def _forces(axes: Axes, result: Result, slides: list[tuple[float, float]]) -> None:
    """Draw pull and friction, over the weight, with the two limits."""
    weight = DRAWN_WORM.mass * 9.81
    axes.plot(result.time, [_pull(t) for t in result.time], color=LINK, lw=1.6)
    axes.plot(result.time, -result.contact_force[..., 0].sum(axis=(1, 2)) / weight, color=FORCE, lw=2.4)
    for level, name in (
        (DRAWN_GROUND.forward * DRAWN_GROUND.static_ratio, "static limit"),
        (DRAWN_GROUND.forward, "kinetic limit"),
    ):
        axes.axhline(level, color=ANCHOR, lw=1.0, ls=(0, (4, 2)))
        axes.text(0.02, level + 0.006, name, color=ANCHOR, va="bottom")
    axes.set(ylabel="force over weight", ylim=(-0.02, 0.46))
    begin, end = slides[0]
    axes.text(RISE + 0.12, _pull(RISE + 0.1) + 0.005, "pull", color=LINK, va="bottom")
    axes.text(begin + 0.3, DRAWN_GROUND.forward - 0.012, "friction", color=FORCE, va="top")
    for x, text in (
        (begin / 2.0, "sticks"),
        ((begin + end) / 2.0, "slides"),
        ((end + result.time[-1]) / 2.0, "sticks"),
    ):
        axes.text(x, 0.44, text, ha="center", va="top")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
