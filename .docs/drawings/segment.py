"""Drawing of one segment: the rhombic linkage from the side, from above and from behind."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from _style import ANCHOR, FACE, INK, LINK, PALE, Segment, arrow, colour_of, dimension, drawing, label, segment, sketch
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from worm3d import Worm

DRAWN_WORM = Worm()
DRAWN_CONTRACTION, DRAWN_BEND = 0.25, 0.9
"""Contraction of the side view, and chamber bend of the view from above [rad]."""


def main(folder: Path) -> None:
    """Write drawings/segment.svg."""
    with drawing(folder, "segment", 5.6) as figure:
        side, behind, above = figure.subplot_mosaic(
            [["side", "behind"], ["above", "above"]], width_ratios=[1.75, 1.0], height_ratios=[1.0, 1.05]
        ).values()
        figure.subplots_adjust(left=0.01, right=0.99, top=0.95, bottom=0.01, wspace=0.02, hspace=0.1)
        _side(side)
        _behind(behind)
        _above(above)


def _at_rest() -> Segment:
    return segment(DRAWN_WORM, (0.0, 0.0, 0.0), (DRAWN_WORM.l0, 0.0, 0.0))


def _contracted(bend: float = 0.0) -> Segment:
    shorter = DRAWN_CONTRACTION * DRAWN_WORM.l0 / 2.0
    return segment(DRAWN_WORM, (shorter, 0.0, 0.0), (DRAWN_WORM.l0 - shorter, 0.0, 0.0), bend=bend)


def _side(axes: Axes) -> None:
    sketch(axes, "from the side: at rest (grey), contracted (red)", (-0.055, 0.225), (-0.11, 0.1))
    rest, now = _at_rest(), _contracted()
    before, after = rest.rhombus(DRAWN_WORM, 0)[:, [0, 2]], now.rhombus(DRAWN_WORM, 0)[:, [0, 2]]
    axes.fill(*before.T, facecolor="none", edgecolor=PALE, lw=1.6, ls=(0, (4, 2)))
    axes.fill(*after.T, facecolor=colour_of(-DRAWN_CONTRACTION), alpha=0.4)
    axes.plot(*after[[0, 1, 2, 3, 0]].T, color=LINK, lw=2.4)
    _side_sizes(axes, before, after)
    for corner in after:
        axes.plot(*corner, "o", color=LINK, ms=5, zorder=8)
    label(axes, after[0] + (-0.007, -0.012), "$p_i$", bbox=None)
    label(axes, after[2] + (0.007, -0.012), "$p_{i+1}$", bbox=None)


def _side_sizes(axes: Axes, before: np.ndarray, after: np.ndarray) -> None:
    """Write the sizes at rest to the left and below, the present sizes inside."""
    low = after[3, 1] - 0.016
    dimension(axes, (before[0, 0], low), (before[2, 0], low), "$l_0$", LINK)
    dimension(axes, (-0.015, 0.0), (-0.015, before[1, 1]), "$h_0$", LINK)
    axes.plot([-0.015, before[1, 0]], [before[1, 1]] * 2, color=PALE, lw=0.7, zorder=0)
    for x in before[[0, 2], 0]:
        axes.plot([x, x], [0.0, low], color=PALE, lw=0.7, zorder=0)
    dimension(axes, after[0], after[2], "$l$", "black", shift=(-0.025, 0.0))
    dimension(axes, (after[1, 0], 0.0), after[1], "$h$", "black")
    label(axes, 0.6 * after[1] + 0.4 * after[2] + (0.006, 0.002), "link, length $a$", ha="left", bbox=None)
    label(axes, after[1] + (0.006, 0.006), "apex above", ha="left", bbox=None)
    label(axes, after[3] + (0.008, 0.0), "apex below", ha="left", bbox=None)


def _behind(axes: Axes) -> None:
    sketch(axes, "from behind", (-0.125, 0.125), (-0.105, 0.1))
    now, b = _contracted(), DRAWN_WORM.chamber_offset
    points = -now.apexes[:, 1], now.apexes[:, 2]
    axes.add_patch(
        Circle((0.0, 0.0), float(np.max(DRAWN_WORM.half_height)), fill=False, ec=FACE, lw=1.3, ls=(0, (4, 2)))
    )
    for k in (0, 3):
        axes.plot(points[0][[k, k + 1]], points[1][[k, k + 1]], color=colour_of(-DRAWN_CONTRACTION), lw=5, zorder=2)
    axes.plot([points[0][2], points[0][5]], [0.0, 0.0], color=PALE, lw=0.8, zorder=1)
    axes.plot(*points, "o", color=ANCHOR, ms=6, zorder=8)
    for sign, name in ((-1.0, "L"), (1.0, "R")):
        label(axes, (sign * b * 1.15, 0.086), f"{name} above", bbox=None)
        label(axes, (sign * b * 1.15, -0.088), f"{name} below", bbox=None)
        label(axes, (sign * 0.1, -0.012), f"{name}\noutward", va="top", bbox=None)
    label(axes, (0.0, -0.034), "end\nface", color=FACE, bbox=None)
    dimension(axes, (0.0, 0.012), (-b, 0.012), "$b$", shift=(0.0, 0.009))
    dimension(axes, (b, 0.012), (float(points[0][5]), 0.012), "$h$", shift=(0.004, 0.009))


def _above(axes: Axes) -> None:
    sketch(axes, "from above: the left chamber is shorter", (-0.135, 0.345), (-0.115, 0.125))
    now, b = _contracted(DRAWN_BEND), DRAWN_WORM.chamber_offset
    for side in (0, 1):
        line = now.rhombus(DRAWN_WORM, side)[[0, 2], :2]
        strain = now.chambers[side] / DRAWN_WORM.l0 - 1.0
        axes.plot(*line.T, color=colour_of(strain), lw=7, solid_capstyle="butt", zorder=3)
        apex = now.apexes[3 * side + 2, :2]
        axes.plot(*np.array([line[0], apex, line[1]]).T, color=LINK, lw=1.2, zorder=2)
        axes.plot(*apex, "o", color=ANCHOR, ms=6, zorder=8)
    _above_words(axes, now, b)


def _above_words(axes: Axes, now: Segment, b: float) -> None:
    """Write the names of the parts seen from above."""
    (x0, _, _), (x1, _, _) = now.ends
    radius = float(np.max(DRAWN_WORM.half_height))
    for x in (x0, x1):
        axes.plot([x, x], [-radius, radius], color=FACE, lw=1.3, ls=(0, (4, 2)), zorder=1)
    axes.annotate("end face", (x0, -radius), (-0.035, -0.065), ha="right", va="center", arrowprops=_THIN)
    axes.plot([x0, x1], [0.0, 0.0], "o-", color=LINK, ms=5, lw=1.4, zorder=4)
    left, right = now.rhombus(DRAWN_WORM, 0)[[0, 2], :2], now.rhombus(DRAWN_WORM, 1)[[0, 2], :2]
    axes.annotate("left chamber, $l_L = l - b\\,\\theta$", left[1], (0.19, b + 0.022), va="center", arrowprops=_THIN)
    axes.annotate("right chamber, $l_R = l + b\\,\\theta$", right[1], (0.19, -b - 0.022), va="center", arrowprops=_THIN)
    label(axes, now.apexes[2, :2] + (0.008, 0.0), "L outward", ha="left", bbox=None)
    label(axes, now.apexes[5, :2] + (0.008, 0.0), "R outward", ha="left", bbox=None)
    label(axes, (x0 - 0.004, -0.01), "$p_i$", ha="right", bbox=None)
    label(axes, (x1 + 0.003, -0.011), "$p_{i+1}$", ha="left", bbox=None)
    dimension(axes, (x0, 0.0), (x1, 0.0), "$l$")
    dimension(axes, (-0.012, 0.0), (-0.012, b), "$b$", shift=(-0.01, 0.0))
    axes.plot([-0.016, x0], [0.0, 0.0], color=PALE, lw=0.7)
    axes.plot([-0.016, left[0, 0]], [b, b], color=PALE, lw=0.7)
    arrow(axes, (x1, 0.0), (x1 + 0.045, 0.0), INK)
    label(axes, (x1 + 0.05, 0.0), "towards the head", ha="left", bbox=None)


_THIN = {"arrowstyle": "-", "color": LINK, "lw": 0.8, "shrinkA": 2, "shrinkB": 1}

if __name__ == "__main__":
    main(Path(sys.argv[1]))
