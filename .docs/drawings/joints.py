"""Drawing of a joint between two segments: pitch, yaw with chambers and hinge, and twist."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from _style import ANCHOR, FORCE, LINK, PALE, Segment, arrow, colour_of, drawing, label, letter, segment, sketch
from matplotlib.axes import Axes
from matplotlib.patches import Arc

from worm3d import Worm
from worm3d.values.arrays import FloatArray

DRAWN_WORM = Worm(chamber_offset=0.036)
ANGLE = 0.5
"""Angle between the segments [rad]."""
DRAWN_WINDOW = ((-0.2, 0.2), (-0.1, 0.135))


def main(folder: Path) -> None:
    """Write drawings/joints.svg."""
    with drawing(folder, "joints", 4.6) as figure:
        panels = figure.subplots(2, 2)
        figure.subplots_adjust(left=0.02, right=0.99, top=0.94, bottom=0.02, wspace=0.04, hspace=0.12)
        for axes, draw, name in zip(panels.flat, (_pitch, _bends, _hinge, _twist), "ABCD", strict=True):
            draw(axes)
            letter(axes, name)


def _pitch(axes: Axes) -> None:
    sketch(axes, "pitch, from the side", *DRAWN_WINDOW)
    length = DRAWN_WORM.l0
    behind = segment(DRAWN_WORM, (-length, 0.0, 0.0), (0.0, 0.0, 0.0))
    ahead = segment(DRAWN_WORM, (0.0, 0.0, 0.0), (length * np.cos(ANGLE), 0.0, length * np.sin(ANGLE)))
    for each in (behind, ahead):
        axes.fill(
            *each.rhombus(DRAWN_WORM, 0)[:, [0, 2]].T, facecolor=colour_of(0.0), edgecolor=LINK, lw=1.2, alpha=0.6
        )
    _tangents(axes, behind, ahead, (0, 2))
    _angle(axes, ANGLE, "$\\arcsin(-c\\cdot d)$")


def _bends(axes: Axes) -> None:
    sketch(axes, "yaw of bent chambers, without strain", *DRAWN_WINDOW)
    _seen_from_above(axes, bend=ANGLE, hinge=0.0)
    _angle(axes, ANGLE, "$\\theta_1/2 + \\theta_2/2$")


def _hinge(axes: Axes) -> None:
    sketch(axes, "yaw of a hinge, without strain", *DRAWN_WINDOW)
    _seen_from_above(axes, bend=0.0, hinge=ANGLE)
    _angle(axes, ANGLE, "hinge")
    axes.plot(0.0, 0.0, "o", ms=13, mfc="white", mec=FORCE, mew=2.5, zorder=8)
    axes.plot(0.0, 0.0, "o", ms=5, color=LINK, zorder=9)


def _seen_from_above(axes: Axes, bend: float, hinge: float) -> None:
    """Draw two segments with equal chamber bends whose yaw strain (E5) is 0."""
    angle, length = bend + hinge, 0.9 * DRAWN_WORM.l0
    behind = segment(DRAWN_WORM, (-length, 0.0, 0.0), (0.0, 0.0, 0.0), bend=bend)
    ahead = segment(DRAWN_WORM, (0.0, 0.0, 0.0), (length * np.cos(angle), length * np.sin(angle), 0.0), bend=bend)
    for each in (behind, ahead):
        for side in (0, 1):
            strain = each.chambers[side] / length - 1.0
            ends = each.rhombus(DRAWN_WORM, side)[[0, 2], :2]
            axes.plot(*ends.T, color=colour_of(strain, 0.15), lw=6, solid_capstyle="butt", zorder=2)
    _tangents(axes, behind, ahead, (0, 1))


def _tangents(axes: Axes, behind: Segment, ahead: Segment, plane: tuple[int, int]) -> None:
    """Draw the centre lines and tangents of two segments, in the plane of two coordinates."""
    pick = list(plane)
    for each, name, shift in ((behind, "t_1", (0.03, -0.016)), (ahead, "t_2", (0.105, 0.0))):
        ends = each.ends[:, pick]
        axes.plot(*ends.T, "o-", color=LINK, ms=5, lw=1.4, zorder=4)
        tip = each.middle[pick] + 0.06 * each.t[pick]
        arrow(axes, each.middle[pick], tip, FORCE)
        place = each.middle[pick] + shift[0] * each.t[pick] + (0.0, shift[1])
        label(axes, place, f"${name}$", color=FORCE, fontsize=12, bbox=None)
    axes.plot([0.0, 0.17], [0.0, 0.0], color=PALE, lw=1.0, ls=(0, (4, 2)), zorder=1)


def _angle(axes: Axes, angle: float, name: str) -> None:
    """Draw the angle between the dashed line and the segment ahead, with its value below."""
    axes.add_patch(Arc((0.0, 0.0), 0.29, 0.29, theta1=0.0, theta2=np.degrees(angle), color=LINK, lw=1.2))
    axes.annotate(
        name,
        0.145 * np.array([np.cos(0.3 * angle), np.sin(0.3 * angle)]),
        (0.13, -0.055),
        ha="center",
        va="center",
        arrowprops={"arrowstyle": "-", "color": LINK, "lw": 0.8},
    )


def _twist(axes: Axes) -> None:
    sketch(axes, "twist, from behind: 1 (grey) and 2", *DRAWN_WINDOW)
    behind = segment(DRAWN_WORM, (-DRAWN_WORM.l0, 0.0, 0.0), (0.0, 0.0, 0.0))
    ahead = segment(DRAWN_WORM, (0.0, 0.0, 0.0), (DRAWN_WORM.l0, 0.0, 0.0), roll=ANGLE)
    _section(axes, behind, "1", PALE)
    _section(axes, ahead, "2", colour_of(0.0))
    axes.add_patch(Arc((0.0, 0.0), 0.17, 0.17, theta1=180.0 - np.degrees(ANGLE), theta2=180.0, color=LINK, lw=1.2))
    label(axes, 0.098 * np.array([-np.cos(ANGLE / 2.0), np.sin(ANGLE / 2.0)]), "$m$", bbox=None, fontsize=12)


def _section(axes: Axes, of: Segment, number: str, colour: str) -> None:
    """Draw chambers and director of a segment, seen from behind."""
    seen = _from_behind(of.apexes)
    for k in (0, 3):
        axes.plot(*seen[[k, k + 1]].T, color=colour, lw=6, zorder=2, alpha=0.8)
    tip = 0.115 * _from_behind(of.d)
    arrow(axes, (0.0, 0.0), tip, ANCHOR if number == "2" else LINK)
    label(axes, tip * 1.14, f"$d_{number}$", color=ANCHOR if number == "2" else LINK, fontsize=12, bbox=None)


def _from_behind(points: FloatArray) -> FloatArray:
    """Return -y and z of points: an observer behind the tail who looks ahead sees y on the left."""
    return np.asarray(points[..., 1:] * (-1.0, 1.0))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
