"""The foot of a hill: a slope that ends at a steeper face.

The slope goes through the origin; n_1 is the slope's outward normal. The face, with the outward normal n_2, meets the
slope in a level line through the point p. With a = n_1.x, b = n_2.(x - p) and c = n_1.n_2, the signed distance is

    g = min(a, b),   and -d where a < c b and b < c a,   d^2 = (a^2 + b^2 - 2 a b c)/(1 - c^2)                    (WF1)

The distance is exact everywhere, as slope and face meet at less than 180 degrees in free space. Behind the common line,
d is the distance from the line. With m normal to the line and to the gradient, gradient and Hessian there are

    n = ((c b - a) n_1 + (c a - b) n_2)/((1 - c^2) d),   H = -m m^T/d                                             (WF2)

The normal thus turns from n_1 to n_2, and a point in the corner rests on slope and face.
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
    """A slope through the origin up to a steeper face across the ascent.

    Raises
    ------
    ValueError
        A value out of range, or a face that is not steeper than the slope.
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
        """Slope and face, each as a plane through the origin."""
        return Plane(self.slope, self.heading), Plane(self.face, self.heading)

    @property
    def corner(self) -> FloatArray:
        """Point of the slope where the face begins, shape (3,) [m]."""
        return np.asarray(self.place * self.sides[0].axes[0])

    def symbolic(self) -> Formula:
        """Return the world's rows as a function of a point and parameters, and the parameters."""
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
