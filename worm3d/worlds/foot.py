"""The foot of a hill: a slope that ends at a steeper face.

The slope goes through the origin and has the outward normal n_1. The face has the outward normal n_2, and meets the
slope in a horizontal line through the point p. With a = n_1.x, b = n_2.(x - p) and c = n_1.n_2, the signed distance of
a point x is

    g = min(a, b),   but -d where a < c b and b < c a,   d^2 = (a^2 + b^2 - 2 a b c)/(1 - c^2)                    (WF1)

The distance is exact everywhere, because the angle between slope and face in free space is less than 180 degrees. The
second case applies in the solid, to points whose nearest place is the common line. There d is the distance from this
line. With a unit vector m normal to the line and to the gradient, gradient and Hessian are then

    n = ((c b - a) n_1 + (c a - b) n_2)/((1 - c^2) d),   H = -m m^T/d                                             (WF2)

The normal therefore turns continuously from n_1 to n_2, and a point in the corner is supported by slope and face.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.worlds.base import World
from worm3d.worlds.kernels import Formula, rows
from worm3d.worlds.plane import Plane


@documented
@dataclass(frozen=True)
class Foot(World):
    """A slope through the origin that leads up to a steeper face.

    Raises
    ------
    ValueError
        A value is out of range, or the face is not steeper than the slope.
    """

    slope: float = parameter(0.0, meaning="slope up to the face", unit="rad", gt=-np.pi / 2, lt=np.pi / 2)
    face: float = parameter(
        float(np.deg2rad(80.0)), meaning="slope of the face", unit="rad", gt=-np.pi / 2, lt=np.pi / 2
    )
    place: float = parameter(1.3, meaning="how far up the slope the face begins, from the origin", unit="m")
    heading: float = parameter(0.0, meaning="azimuth of the steepest ascent", unit="rad")

    def __post_init__(self) -> None:
        check(self)
        if not self.slope < self.face:
            raise ValueError(
                f"face: got {self.face!r} rad, must be more than the slope ({self.slope!r} rad); without a face take "
                "a Plane"
            )

    @property
    def sides(self) -> tuple[Plane, Plane]:
        """The slope, and a plane through the origin parallel to the face."""
        return Plane(self.slope, self.heading), Plane(self.face, self.heading)

    @property
    def corner(self) -> FloatArray:
        """Point of the slope where the face begins, shape (3,) [m]."""
        return np.asarray(self.place * self.sides[0].axes[0])

    def symbolic(self) -> Formula:
        """Return the formula of the world's rows."""
        return _function(), np.concatenate([*(side.axes[2] for side in self.sides), self.corner])

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""
        slope, face = self.sides
        a, b = slope.distance(points), face.distance(np.asarray(points) - self.corner)
        c, turn = np.cos(self.face - self.slope), np.sin(self.face - self.slope)
        behind = (a < c * b) & (b < c * a)
        return np.where(behind, -np.hypot((a - c * b) / turn, b), np.minimum(a, b))

    def height(self, places: FloatArray) -> FloatArray:
        """Return the height of the surface at x, y of shape (M, 2), shape (M,) [m]."""
        ahead = places @ [np.cos(self.heading), np.sin(self.heading)]
        corner = self.place * np.cos(self.slope)
        rise = np.where(ahead > corner, np.tan(self.face), np.tan(self.slope))
        return np.asarray(corner * np.tan(self.slope) + (ahead - corner) * rise)


@cache
def _function() -> ca.Function:
    x, given = ca.SX.sym("x", 3), ca.SX.sym("given", 9)
    slope, face, corner = given[:3], given[3:6], given[6:]
    a, b, c = ca.dot(slope, x), ca.dot(face, x - corner), ca.dot(slope, face)
    of_slope, of_face = (c * b - a) / (1.0 - c**2), (c * a - b) / (1.0 - c**2)
    behind = ca.logic_and(of_slope > 0.0, of_face > 0.0)
    away = of_slope * slope + of_face * face
    d = ca.if_else(behind, ca.norm_2(away), 1.0)
    side = ca.if_else(a < b, slope, face)
    across = ca.cross(slope, face) / ca.sqrt(1.0 - c**2)
    m = ca.cross(across, away / d)
    g, n = ca.if_else(behind, -d, ca.fmin(a, b)), ca.if_else(behind, away / d, side)
    H = ca.if_else(behind, -m @ m.T / d, ca.SX.zeros(3, 3))
    return ca.Function("foot", [x, given], [rows(g, n, H, 1.0)])
