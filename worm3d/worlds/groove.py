"""A groove with walls that rise to both sides of a round bottom.

The bottom is a circular cylinder of radius r. In a section across the groove, y is the coordinate to the left, z is the
height above the lowest line, and q = (|y|, z - r) is the position of a point relative to the axis of the cylinder. The
wall rises at the angle a. It has the outward normal N = (-sin a, cos a) and the direction of ascent T = (cos a, sin a).
Signed distance and gradient are

    g = r - |q|,      -q/|q|     where q.T < 0, if the nearest place lies on the bottom,                     (WG1)
    g = r + q.N,      N          elsewhere, if the nearest place lies on the wall.

The two formulas agree where q.T = 0. The Hessian is -(1/|q|) t t' if the nearest place lies on the bottom, where t is
the unit vector normal to q in the section. It is 0 elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.worlds.base import World
from worm3d.worlds.kernels import ON_AXIS, Formula, rows


@documented
@dataclass(frozen=True)
class Groove(World, name="groove"):
    """A straight groove with a round bottom, whose lowest line goes through the origin.

    Raises
    ------
    ValueError
        A value is out of range.
    """

    uneven = False
    """A worm without friction comes to rest on the bottom, at any place along the groove."""

    wall: float = parameter(
        np.pi / 4, meaning="angle of its walls with the horizontal", unit="rad", ge=0, lt=np.pi / 2, key="wall_deg"
    )
    bottom: float = parameter(0.1, meaning="radius of its round bottom", unit="m", gt=0)
    heading: float = parameter(0.0, meaning="azimuth of its direction", unit="rad")
    grip: float = parameter(1.0, meaning="multiplier of the friction coefficients", ge=0)

    def __post_init__(self) -> None:
        check(self)

    @property
    def left(self) -> FloatArray:
        """Horizontal unit vector across the groove to the left, x and y, shape (2,)."""
        return np.array([-np.sin(self.heading), np.cos(self.heading)])

    def symbolic(self) -> Formula:
        """Return the formula of the world's rows."""
        return _function(), np.array([*self.left, np.sin(self.wall), np.cos(self.wall), self.bottom, self.grip])

    def height(self, places: FloatArray) -> FloatArray:
        """Return the height of the surface at x, y of shape (M, 2), shape (M,) [m]."""
        y, r = np.abs(places @ self.left), self.bottom
        on_bottom = r - np.sqrt(np.maximum(r * r - y * y, 0.0))
        on_wall = r + (y * np.sin(self.wall) - r) / np.cos(self.wall)
        return np.where(y < r * np.sin(self.wall), on_bottom, on_wall)


@cache
def _function() -> ca.Function:
    x, given = ca.SX.sym("x", 3), ca.SX.sym("given", 6)
    left, sine, cosine, r, grip = given[:2], given[2], given[3], given[4], given[5]
    y = ca.dot(left, x[:2])
    side = ca.if_else(y < 0.0, -1.0, 1.0)
    q = ca.vertcat(side * y, x[2] - r)
    away = ca.sqrt(ca.sumsqr(q) + ON_AXIS)
    on_bottom = q[0] * cosine + q[1] * sine < 0.0
    g = r + ca.if_else(on_bottom, -away, q[1] * cosine - q[0] * sine)
    across = ca.if_else(on_bottom, -q / away, ca.vertcat(-sine, cosine))
    n = ca.vertcat(side * across[0] * left, across[1])
    t = ca.vertcat(-side * across[1] * left, across[0])
    H = -ca.if_else(on_bottom, 1.0 / away, 0.0) * t @ t.T
    return ca.Function("groove", [x, given], [rows(g, n, H, grip)])
