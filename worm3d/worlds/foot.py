"""The foot of a hill: a slope that ends at a steeper face.

With the outward normals n_1 of the slope, which goes through the origin, and n_2 of the face, which meets it in a
level line through the point p, the signed distance is

    g = min(n_1.x, n_2.(x - p)),   exact in free space, as the two meet at less than 180 degrees there            (WF1)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.worlds.base import World
from worm3d.worlds.kernels import Formula
from worm3d.worlds.plane import Plane


@documented
@dataclass(frozen=True)
class Foot(World):
    """A slope through the origin up to a steeper face across its ascent.

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
        """Point of the slope at which the face begins, shape (3,) [m]."""
        return np.asarray(self.place * self.sides[0].axes[0])

    def symbolic(self) -> Formula:
        """Return the world's rows as a function of a point and parameters, and the parameters."""
        return _function(), np.concatenate([*(side.axes[2] for side in self.sides), self.corner])

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""
        slope, face = self.sides
        return np.minimum(slope.distance(points), face.distance(np.asarray(points) - self.corner))

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
    on_slope, on_face = ca.dot(slope, x), ca.dot(face, x - corner)
    first = on_slope < on_face
    normal = ca.if_else(first, slope, face)
    rows = ca.vertcat(ca.if_else(first, on_slope, on_face), normal, ca.SX.zeros(6), 1.0)
    return ca.Function("foot", [x, given], [ca.densify(rows)])
