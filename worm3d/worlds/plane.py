"""An inclined plane through the origin, and the paper's level ground, which prescribes the heights of the joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.read_only import read_only
from worm3d.values.spelling import Spelled
from worm3d.worlds.base import World
from worm3d.worlds.kernels import Formula, WorldKernel, rows

MOST_PATCHES = 1000
"""Largest number of patches. With this number the formula takes three seconds to compile. The time grows with the
square of the number."""


@dataclass(frozen=True)
class Patch(Spelled):
    """A rectangle of the plane with another friction.

    Attributes
    ----------
    grip : float
        Multiplier of the friction coefficients, at least 0.
    along, across : tuple of float
        Limits (from, to) of the rectangle along the steepest ascent, and across it to the left [m]. Both are measured
        from the origin.
    """

    grip: float
    along: tuple[float, float] = (-np.inf, np.inf)
    across: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self) -> None:
        arguments.number("grip", self.grip, ge=0.0)
        for name in ("along", "across"):
            side = arguments.floats(name, getattr(self, name))
            if side.shape != (2,) or not side[0] < side[1]:
                given = arguments.shown(getattr(self, name))
                raise ValueError(f"{name}: got {given}, must be (from, to) with from < to")


@dataclass(frozen=True)
class Plane(World):
    """An inclined plane through the origin. Gravity acts along -z.

    Attributes
    ----------
    slope : float
        Angle with the horizontal, less than pi/2 [rad].
    heading : float
        Azimuth of the steepest ascent [rad].
    patches : tuple of Patch
        Rectangles with another friction. Where patches overlap, the last patch applies.
    """

    flat: ClassVar[bool] = True
    uneven = False
    """False, because `pressing` has no component along the plane, so that a worm without friction does not slide."""

    slope: float = 0.0
    heading: float = 0.0
    patches: tuple[Patch, ...] = ()

    def __post_init__(self) -> None:
        arguments.number("slope", self.slope, "rad", gt=-np.pi / 2, lt=np.pi / 2)
        arguments.number("heading", self.heading, "rad")
        object.__setattr__(self, "patches", patches_of(self.patches))

    @property
    def axes(self) -> FloatArray:
        """Unit vectors of the plane as rows, shape (3, 3): steepest ascent, left of the ascent, and outward normal."""
        return _axes(self.slope, self.heading)

    def symbolic(self) -> Formula:
        """Return the formula of the world's rows."""
        # The largest number takes the place of infinity.
        patches = [np.nan_to_num([*p.along, *p.across, p.grip]) for p in self.patches]
        return _function(len(patches)), np.concatenate([self.axes.ravel(), *patches])

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""
        return np.asarray(np.asarray(points) @ self.axes[2])

    def pressing(self, gravity: FloatArray) -> FloatArray:
        """Return the part of gravity normal to the plane, or zero if it points away from the plane.

        The shape is (3,) [m/s^2].
        """
        normal = self.axes[2]
        return np.asarray(min(0.0, float(gravity @ normal)) * normal)

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints of a straight worm on the plane, and the director to the left."""
        normal, horizontal = self.axes[2], np.array([np.cos(azimuth), np.sin(azimuth)])

        def above(xy: FloatArray) -> FloatArray:
            return np.append(xy, -float(xy @ normal[:2]) / normal[2])

        tangent = above(horizontal)
        tangent /= np.linalg.norm(tangent)
        joints = above(position) + along[:, None] * tangent + clearance * normal
        return joints, np.cross(normal, tangent)


@lru_cache(maxsize=100)
def _axes(slope: float, heading: float) -> FloatArray:
    up, turn = (np.array([np.cos(a), np.sin(a)]) for a in (slope, heading))
    ascent = np.array([up[0] * turn[0], up[0] * turn[1], up[1]])
    left = np.array([-turn[1], turn[0], 0.0])
    return np.asarray(read_only(np.array([ascent, left, np.cross(ascent, left)])))


@documented
@dataclass(frozen=True)
class ClampedGround(World, name="clamped"):
    """The paper's level ground in 3D, which prescribes the heights of the joints and has no contacts.

    The joints' z does not change. In each step, a predictor without friction gives the velocity of each joint, and the
    normal load, which is the force (P9) that holds the joint's z. The friction (P10) acts against the motion. The
    friction follows from the load and the velocity, with separate coefficients towards the head, towards the tail and
    sideways. Below `velocity_threshold` there is no friction. A corrector then repeats the step with these forces.
    """

    clamped: ClassVar[bool] = True
    flat: ClassVar[bool] = True
    uneven = False
    """False, because the worm does not rest on contacts."""

    velocity_threshold: float = parameter(
        1e-6, meaning="speed below which there is no friction, eps of (P10)", unit="m/s", ge=0
    )

    def __post_init__(self) -> None:
        check(self)

    def kernel(self) -> WorldKernel:
        """Return the kernel of the level plane, which only computes the distances in records; there are no contacts."""
        return Plane().kernel()

    def pressing(self, gravity: FloatArray) -> FloatArray:
        """Return zero because the worm does not rest on contacts."""
        return np.zeros(3)

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints at z = 0."""
        return Plane().placed(along, 0.0, position, azimuth)


def patches_of(given: Any) -> tuple[Patch, ...]:
    """Return a list or tuple of patches as a checked tuple.

    Raises
    ------
    ValueError
        `given` is of another type, contains an item that is not a `Patch`, or has too many patches.
    """
    arguments.instance("patches", given, list | tuple, "a tuple of worm3d.Patch")
    if len(given) > MOST_PATCHES:
        raise ValueError(
            f"patches: got {len(given)}, must be at most {MOST_PATCHES}; take fewer and larger ones, or a Heightfield "
            "with a grip at each node"
        )
    return tuple(arguments.instance(f"patches[{k}]", patch, Patch, "a worm3d.Patch") for k, patch in enumerate(given))


@cache
def _function(patches: int) -> ca.Function:
    x, axes = ca.SX.sym("x", 3), ca.SX.sym("axes", 9)
    areas = ca.SX.sym("areas", 5 * patches)
    u, v, n = axes[0:3], axes[3:6], axes[6:9]
    grip = ca.SX(1.0)
    for k in range(patches):
        a = areas[5 * k : 5 * k + 5]
        inside = _between(ca.dot(u, x), a[0], a[1]) * _between(ca.dot(v, x), a[2], a[3])
        grip = ca.if_else(inside, a[4], grip)
    found = rows(ca.dot(n, x), n, ca.SX.zeros(3, 3), grip)
    return ca.Function("plane", [x, ca.vertcat(axes, areas)], [found])


def _between(value: ca.SX, low: ca.SX, high: ca.SX) -> ca.SX:
    return ca.logic_and(value >= low, value < high)
