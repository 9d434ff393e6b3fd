"""Drawing of the set of friction forces: kinetic and static limit, and the force of a contact that slides."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
from _style import ANCHOR, FORCE, LINK, LONG, PALE, SHORT, arrow, drawing, label, letter, sketch
from matplotlib.axes import Axes

from worm3d import Friction
from worm3d.physics.contact import Coefficients, Directions, Step, friction
from worm3d.values.arrays import FloatArray

DRAWN_GROUND = Friction(forward=0.10, backward=0.22, lateral=0.16, static_ratio=1.3)
DRAWN_WINDOW = ((-0.3, 0.36), (-0.27, 0.27))


def main(folder: Path) -> None:
    """Write drawings/friction_ellipse.svg."""
    with drawing(folder, "friction_ellipse", 3.5) as figure:
        set_, forces = figure.subplots(1, 2)
        figure.subplots_adjust(left=0.01, right=0.99, top=0.92, bottom=0.01, wspace=0.03)
        _set(set_)
        _forces(forces)


@cache
def _formula() -> ca.Function:
    """Return f of (C3) for y of shape (2,) [m], the yield gauge r [m] and c_0."""
    y, r, limit = ca.SX.sym("y", 2), ca.SX.sym("r"), ca.SX.sym("c")
    mu = Directions(*map(ca.SX, (DRAWN_GROUND.forward, DRAWN_GROUND.backward, DRAWN_GROUND.lateral)))
    step = Step(r, limit, ca.SX(2, 1), ca.SX(1.0), type(DRAWN_GROUND.law), {})
    ones = Directions(*map(ca.SX, (1.0, 1.0, 1.0)))
    return ca.Function("f", [y, r, limit], [friction(y, Coefficients(mu, ones), step).f])


def force(angle: float, limit: float = 1.0) -> FloatArray:
    """Return the force on a contact that slides far in a direction [rad], over the normal load, shape (2,)."""
    towards = [np.cos(angle), np.sin(angle)]
    return -np.array(_formula()(towards, 1e-6, limit)).ravel()


def _border(limit: float) -> FloatArray:
    """Return points of the border of the set of forces, shape (2, 361), over the normal load."""
    return np.array([force(angle, limit) for angle in np.linspace(0.0, 2.0 * np.pi, 361)]).T


def _empty(axes: Axes, title: str) -> None:
    """Draw the axes and the borders of both sets."""
    sketch(axes, title, *DRAWN_WINDOW)
    arrow(axes, (-0.3, 0.0), (0.33, 0.0), PALE, 1.0)
    arrow(axes, (0.0, -0.26), (0.0, 0.26), PALE, 1.0)
    label(axes, (0.325, -0.025), "$f_x$", bbox=None)
    label(axes, (0.035, 0.252), "$f_l$", bbox=None)
    axes.fill(*_border(1.0), facecolor=ANCHOR, alpha=0.13, zorder=1)
    axes.plot(*_border(1.0), color=ANCHOR, lw=2.0)


def _set(axes: Axes) -> None:
    _empty(axes, "the limits, over the normal load")
    letter(axes, "A")
    axes.plot(*_border(DRAWN_GROUND.static_ratio), color=ANCHOR, lw=1.4, ls=(0, (4, 2)))
    for at, name, ha, shift in (
        ((DRAWN_GROUND.backward, 0.0), "$\\mu_\\mathrm{backward}$", "center", (-0.055, -0.02)),
        ((-DRAWN_GROUND.forward, 0.0), "$\\mu_\\mathrm{forward}$", "center", (-0.075, 0.026)),
        ((0.0, DRAWN_GROUND.lateral), "$\\mu_\\mathrm{lateral}$", "left", (0.012, -0.03)),
    ):
        axes.plot(*at, "o", color=LINK, ms=5, zorder=8)
        label(axes, np.add(at, shift), name, ha=ha, bbox=None)
    arrow(axes, (0.0, 0.0), (0.1, -0.075), FORCE)
    label(axes, (0.045, -0.1), "a stuck\ncontact", color=FORCE, bbox=None, fontsize=9)
    static = DRAWN_GROUND.static_ratio * np.array([0.175, 0.1])
    axes.annotate(
        "static limit,\nstatic_ratio times\nas large",
        static,
        (0.262, 0.215),
        ha="center",
        va="center",
        arrowprops={"arrowstyle": "-", "color": LINK, "lw": 0.8},
    )


def _forces(axes: Axes) -> None:
    _empty(axes, "a contact that slides")
    letter(axes, "B")
    velocity = np.deg2rad(145.0)
    f, v = force(velocity), np.array([np.cos(velocity), np.sin(velocity)])
    across = np.array([-v[1], v[0]])
    axes.plot(*np.array([f - 0.14 * across, f + 0.14 * across]).T, color=LONG, lw=1.2, ls=(0, (4, 2)))
    arrow(axes, (0.0, 0.0), f, FORCE, 2.4)
    arrow(axes, (0.0, 0.0), 0.2 * v, SHORT, 2.4)
    label(axes, 0.235 * v, "velocity $v$", color=SHORT, bbox=None)
    label(axes, 0.55 * f + (-0.005, -0.04), "$f$", color=FORCE, fontsize=12, bbox=None)
    square = f - 0.022 * v, f - 0.022 * v + 0.022 * across, f + 0.022 * across
    axes.plot(*np.array(square).T, color=LINK, lw=0.8)
    label(axes, f - 0.14 * across + (0.008, 0.05), "tangent,\nnormal to $v$", color=LONG, bbox=None, fontsize=9)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
