"""Drawing of the chain: joints, material frames of the segments, and the strains of a segment."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from _style import (
    ANCHOR,
    FORCE,
    LINK,
    LONG,
    PALE,
    Segment,
    arrow,
    colour_of,
    dimension,
    drawing,
    label,
    letter,
    segment,
    sketch,
)
from matplotlib.axes import Axes

from worm3d import Worm
from worm3d.values.arrays import FloatArray

DRAWN_WORM = Worm()
CHAIN = np.array([[0.0, 0.0, 0.0], [0.16, 0.01, 0.0], [0.31, 0.06, 0.02], [0.44, 0.14, 0.05]])
"""Joints of the chain [m]."""
ROLLS = (0.0, 0.15, 0.3)
"""Rolls of the segments of the chain [rad]."""
VIEW = np.array([[0.94, -0.34, 0.0], [0.16, 0.42, 0.89]])
"""Picture coordinates of a point, as a matrix: a view from the right and from above."""
DRAWN_SIZE = 0.075
"""Length of a unit vector in the picture [m]."""


def main(folder: Path) -> None:
    """Write drawings/frames.svg."""
    with drawing(folder, "frames", 5.1) as figure:
        chain, longer, bent, turned = figure.subplot_mosaic(
            [["chain"] * 3, ["longer", "bent", "turned"]], height_ratios=[1.15, 1.0]
        ).values()
        figure.subplots_adjust(left=0.01, right=0.99, top=0.95, bottom=0.01, wspace=0.03, hspace=0.12)
        _chain(chain)
        _longer(longer)
        _bent(bent)
        _turned(turned)


def _chain(axes: Axes) -> None:
    sketch(axes, "joints $p_j$, and the frame $t$, $d$, $u$ of each segment", (-0.12, 0.52), (-0.055, 0.225))
    letter(axes, "A")
    flat = CHAIN @ VIEW.T
    axes.plot(*flat.T, "-", color=PALE, lw=9, solid_capstyle="round", alpha=0.5)
    axes.plot(*flat.T, "o-", color=LINK, ms=7, zorder=5)
    for j, (at, more) in enumerate(zip(flat, ("  (tail)", "", "", "  (head)"), strict=True)):
        label(axes, np.add(at, (0.004, -0.02)), f"$p_{j}${more}", bbox=None, ha="left")
    _axes_of_world(axes, np.array([-0.1, 0.1]))
    for i, roll in enumerate(ROLLS):
        _frame(axes, segment(DRAWN_WORM, CHAIN[i], CHAIN[i + 1], roll=roll), i)


def _axes_of_world(axes: Axes, at: FloatArray) -> None:
    """Draw the directions of x (forward), y (left) and z (up) at a place of the picture."""
    for vector, name in zip(np.eye(3), "xyz", strict=True):
        along = 0.04 * (VIEW @ vector)
        arrow(axes, at, at + along, LINK, 1.2)
        label(axes, at + along * 1.35, f"${name}$", bbox=None)


def _frame(axes: Axes, of: Segment, i: int) -> None:
    """Draw the frame of segment i at its midpoint."""
    at = VIEW @ of.middle
    for vector, name, colour in ((of.t, "t", FORCE), (of.d, "d", ANCHOR), (of.u, "u", LONG)):
        along = DRAWN_SIZE * (VIEW @ vector)
        arrow(axes, at, at + along, colour)
        place = at + along * (1.0 + 0.014 / np.linalg.norm(along))
        if name == "t":  # below the arrow, because a joint is ahead of its tip
            place = at + 0.45 * along + (0.008, -0.015)
        label(axes, place, f"${name}_{i}$", color=colour, bbox=None, fontsize=12)
    axes.plot(*at, "o", color="white", mec=LINK, ms=5, zorder=8)


def _longer(axes: Axes) -> None:
    sketch(axes, "length $l$", (-0.035, 0.235), (-0.115, 0.115))
    letter(axes, "B")
    for y, length, name in ((0.045, DRAWN_WORM.l0, "$l_0$"), (-0.055, 0.75 * DRAWN_WORM.l0, "$l$")):
        middle = DRAWN_WORM.l0 / 2.0 + 0.015
        now = segment(DRAWN_WORM, (middle - length / 2.0, y, 0.0), (middle + length / 2.0, y, 0.0))
        corners = now.rhombus(DRAWN_WORM, 0)[:, [0, 2]] * (1.0, 0.7) + (0.0, y)
        axes.fill(*corners.T, facecolor=colour_of(length / DRAWN_WORM.l0 - 1.0), edgecolor=LINK, lw=1.4, alpha=0.6)
        dimension(axes, corners[0], corners[2], name)


def _bent(axes: Axes) -> None:
    sketch(axes, "chamber bend $\\theta$", (-0.065, 0.205), (-0.115, 0.115))
    letter(axes, "C")
    bend, y = 1.1, DRAWN_WORM.chamber_offset
    now = segment(DRAWN_WORM, (0.0, 0.0, 0.0), (0.85 * DRAWN_WORM.l0, 0.0, 0.0), bend=bend)
    ends = [now.rhombus(DRAWN_WORM, side)[[0, 2], 0] for side in (0, 1)]
    for side, x in enumerate(ends):
        strain = now.chambers[side] / DRAWN_WORM.l0 - 1.0
        axes.plot(x, [y, y] if side == 0 else [-y, -y], color=colour_of(strain), lw=8, solid_capstyle="butt")
    axes.plot(now.ends[:, 0], [0.0, 0.0], "o-", color=LINK, ms=5)
    for k in (0, 1):  # the line through the ends of both chambers
        slope = (ends[0][k] - ends[1][k]) / (2.0 * y)
        axes.plot(
            [now.ends[k, 0] + slope * s for s in (-0.05, 0.09)], [-0.05, 0.09], color=PALE, lw=1.0, ls=(0, (4, 2))
        )
    x = now.middle[0]
    label(axes, (x, y + 0.018), "$l_L = l - b\\,\\theta$", bbox=None)
    label(axes, (x, -y - 0.02), "$l_R = l + b\\,\\theta$", bbox=None)
    label(axes, (x, 0.088), "$\\theta$", fontsize=12, bbox=None)
    label(axes, (x, 0.0), "$l$")


def _turned(axes: Axes) -> None:
    sketch(axes, "roll $g$, seen from behind", (-0.135, 0.135), (-0.115, 0.115))
    letter(axes, "D")
    roll = 0.45
    now = segment(DRAWN_WORM, (0.0, 0.0, 0.0), (DRAWN_WORM.l0, 0.0, 0.0), roll=roll)
    seen = _from_behind(now.apexes)
    for k in (0, 3):
        axes.plot(*seen[[k, k + 1]].T, color=colour_of(0.0), lw=6, zorder=2)
    axes.plot(*seen[[2, 5]].T, color=PALE, lw=1.0, zorder=1)
    axes.plot(*seen.T, "o", color=LINK, ms=4, zorder=5)
    for vector, name, colour in ((now.d, "d", ANCHOR), (now.u, "u", LONG)):
        tip = DRAWN_SIZE * _from_behind(vector)
        arrow(axes, (0.0, 0.0), tip, colour)
        label(axes, tip * 1.2, f"${name}$", color=colour, fontsize=12, bbox=None)
    axes.plot([0.0, -0.12], [0.0, 0.0], color=PALE, lw=1.0, ls=(0, (4, 2)))
    label(axes, (-0.1, -0.016), "$P\\,d_\\mathrm{ref}$", bbox=None)
    angle = np.linspace(0.0, roll, 20)
    axes.plot(-0.06 * np.cos(angle), 0.06 * np.sin(angle), color=LINK, lw=1.0)
    label(axes, 0.072 * np.array([-np.cos(roll / 2.0), np.sin(roll / 2.0)]), "$g$", bbox=None)


def _from_behind(points: FloatArray) -> FloatArray:
    """Return -y and z of points: an observer behind the tail who looks ahead sees y on the left."""
    return np.asarray(points[..., 1:] * (-1.0, 1.0))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
