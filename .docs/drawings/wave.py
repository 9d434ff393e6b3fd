"""Drawing of one period of a retrograde wave: six instants of a crawling worm, from a run of the program."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from _style import ANCHOR, DRAWN_GROUND, FACE, INK, LINK, PALE, REST, SHORT, TRAIL, colour_of, drawing
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Plane, Result, Worm
from worm3d.values.arrays import FloatArray

GAIT = TravellingWave(period=2.0, wavelength=1.0, amplitude=0.3, direction="retrograde")
START, INSTANTS = 8.0, 6
"""Begin of the period [s], and number of instants."""
AT_REST = 1e-3
"""Largest slide of an anchored contact, in body lengths a period."""
GAP = 0.24
"""Distance between the grounds of two instants in the drawing [m]."""


def main(folder: Path) -> None:
    """Write drawings/wave.svg."""
    result = worm3d.simulate(Worm(), Plane(), Friction(), GAIT, duration=START + GAIT.period, dt=0.01)
    rows = np.searchsorted(result.time, START + GAIT.period / INSTANTS * np.arange(INSTANTS) - 1e-9)
    origin = result.joints[rows[0], 0, 0]
    with drawing(folder, "wave", 6.6) as figure:
        axes = figure.add_axes((0.09, 0.115, 0.9, 0.875))
        for k, row in enumerate(rows):
            _worm(axes, result, int(row), origin, -GAP * k)
            axes.text(-0.1, -GAP * k + 0.06, f"${k}/{INSTANTS}$" if k else "$t = 0$", ha="right", va="center")
        _finish(axes, result, rows, origin)


def _worm(axes: Axes, result: Result, row: int, origin: float, ground: float) -> None:
    """Draw the left chambers, the joints and the contacts of an instant, above a line for the ground."""
    shift = np.array([-origin, ground])
    axes.axhspan(ground - 0.03, ground, color=DRAWN_GROUND, lw=0)
    joints, apexes = result.joints[row][:, [0, 2]] + shift, result.apexes[row][:, :2, [0, 2]] + shift
    for i in range(result.worm.segments):
        corners = np.array([joints[i], apexes[i, 1], joints[i + 1], apexes[i, 0]])
        colour = colour_of(float(result.chamber_strain[row, i, 0]), 0.3)
        axes.fill(*corners.T, facecolor=colour, edgecolor=LINK, lw=1.0, zorder=3)
    axes.plot(*joints.T, ".", color=LINK, ms=4, zorder=4)
    for end, inner in ((0, 1), (-1, -2)):  # discs across the ends, seen from the side
        along = (joints[end] - joints[inner]) / np.linalg.norm(joints[end] - joints[inner])
        rim = float(np.max(result.worm.half_height)) * np.array([-along[1], along[0]])
        axes.plot(*np.array([joints[end] - rim, joints[end] + rim]).T, color=FACE, lw=2.0, zorder=3)
    faces = result.points[row][[0, -1], [6, 7]][:, [0, 2]] + shift
    _contacts(axes, result, row, np.vstack([apexes[:, 0], faces]), ground)
    axes.plot(result.com[row, 0] - origin, ground + 0.142, "v", color=TRAIL, ms=6, zorder=6)


def _contacts(axes: Axes, result: Result, row: int, points: FloatArray, ground: float) -> None:
    """Mark loaded contacts: anchored or sliding. `points` are the lower left apexes, then the end faces."""
    load = np.append(result.normal_load[row, :, 0], result.joint_load[row, [0, -1]])
    slide = np.append(result.slip[row, :, 0], result.joint_slip[row, [0, -1]])
    anchored = slide <= AT_REST * result.worm.length * result.dt / GAIT.period
    for k in np.flatnonzero(load > 1e-3 * result.worm.mass * 9.81):
        look = {"mfc": ANCHOR if anchored[k] else "white", "mec": ANCHOR if anchored[k] else INK}
        axes.plot(points[k, 0], ground, "o", ms=8, mew=1.5, zorder=8, clip_on=False, **look)


def _finish(axes: Axes, result: Result, rows: FloatArray, origin: float) -> None:
    """Draw the way of the centre of mass, scale and legend."""
    way = result.com[rows, 0] - origin
    axes.plot(way, -GAP * np.arange(len(rows)) + 0.142, color=TRAIL, lw=0.9, ls=(0, (4, 2)), zorder=2)
    axes.set(xlim=(-0.06, 1.16), ylim=(-GAP * (len(rows) - 1) - 0.035, 0.18), xlabel="x [m]", yticks=[])
    axes.spines["left"].set_visible(False)
    axes.set_aspect("equal", adjustable="box", anchor="N")
    marks = [
        Line2D([], [], ls="", marker="o", color=ANCHOR, ms=8, label="anchored"),
        Line2D([], [], ls="", marker="o", mfc="white", mec=INK, mew=1.5, ms=8, label="slides"),
        Patch(fc=SHORT, ec=LINK, label="contracted"),
        Patch(fc=REST, ec=LINK, label="at rest"),
        Line2D([], [], color=FACE, lw=2.0, label="end face"),
        Line2D([], [], ls="", marker="v", color=TRAIL, ms=6, label="centre of mass"),
    ]
    axes.figure.legend(handles=marks, loc="lower center", ncols=6, columnspacing=1.1, handletextpad=0.4)
    axes.annotate("", (1.1, 0.06), (1.02, 0.06), arrowprops={"arrowstyle": "-|>", "color": PALE, "lw": 1.5})
    axes.text(1.06, 0.085, "head", ha="center", color=LINK)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
