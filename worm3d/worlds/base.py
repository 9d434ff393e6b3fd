"""The base class of all worlds, with the methods that the simulator, the metrics and the pictures call."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import Spelled
from worm3d.worlds.kernels import Formula, WorldKernel, compiled, looked_up

WORLDS: dict[str, type[World]] = {}
"""World classes by name. `world.kind` in a scene is such a name."""


class World(Spelled):
    """Base of everything to crawl on or in.

    A world is described by a signed distance from its surface, negative inside the solid. A user-defined world
    overrides `symbolic` (a formula), or both `kernel` and `distance`. It also overrides `height` or `placed`. The
    constructor `from_distance` needs only a Python function. A subclass with a name, for example
    `class Hill(World, name="hill")`, is a dataclass whose fields are declared by
    `worm3d.values.parameters.parameter`. Scenes refer to the world by that name.
    """

    def __init_subclass__(cls, name: str = "") -> None:
        super().__init_subclass__()
        known = WORLDS.get(name)
        if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise ValueError(f"name: got {name!r}, must be another than those of the worlds that there are")
        if name:  # a class that is defined again, as in a notebook, replaces the former one
            WORLDS[name] = cls

    @staticmethod
    def from_distance(
        f: Callable[[FloatArray], ArrayLike], bounds: ArrayLike, spacing: float | None = None, grip: float = 1.0
    ) -> World:
        """Return a world from a Python function for the signed distance; the function is sampled once on a grid.

        Every such world counts as `uneven`, so that a worm comes to rest with friction. On a plane made in this way, a
        worm starts up to some millimetres away from where it starts on `Plane`.

        Parameters
        ----------
        f : callable
            Function of points of shape (n, 3) [m] that returns their signed distances, shape (n,) [m]. The distance is
            positive in free space, where the worm is, and negative inside the solid. The function is called only for
            points within the bounds, which are widened to a whole number of spacings.
        bounds : array_like, shape (2, 3)
            Lowest and highest corner of the sampled box [m]. Beyond the box the world continues straight, along the
            tangent plane at the nearest point of the box.
        spacing : float, optional
            Spacing of the grid [m]. If it is left out, the grid has up to a million nodes. The distance is a cubic
            spline through the nodes. Its errors on smooth surfaces scale with the fourth power of the spacing, and
            edges are rounded by about one spacing.
        grip : float
            Multiplier of the friction coefficients.

        Raises
        ------
        ValueError
            `f` returns a wrong shape or values that are not finite, has no surface within the bounds, or is not a
            distance there (its gradient is far from a unit vector). The bounds or the spacing are out of range, or the
            grid is too large.
        """
        return World.sampled(f, bounds, spacing, grip)

    sampled: ClassVar[Callable[[Callable[[FloatArray], ArrayLike], ArrayLike, float | None, float], World]]
    """Constructor that `from_distance` calls. The module `worm3d.worlds.sampled` sets this attribute."""

    clamped: ClassVar[bool] = False
    """Whether the world prescribes the heights of the joints instead of acting through contacts."""

    flat: ClassVar[bool] = False
    """Whether the surface is a single plane. On a plane, a worm that rises on its feet has not moved forward."""

    velocity_threshold: float = 0.0
    """For a `clamped` world: speed below which there is no friction, eps of (P10) [m/s]."""

    def symbolic(self) -> Formula | None:
        """Return the formula of the world's rows (`worm3d.worlds.kernels`), or None if there is no formula.

        The formula is a function of a point and of parameters, together with the values of the parameters.
        """
        return None

    def kernel(self) -> WorldKernel:
        """Return the compiled world."""
        formula = self.symbolic()
        if formula is None:
            raise NotImplementedError(f"{type(self).__name__}: has neither `symbolic` nor a `kernel` of its own")
        return compiled(*formula)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""
        return np.asarray(looked_up(self.kernel(), points)[0])

    @property
    def uneven(self) -> bool:
        """Whether a worm without friction could slide away under the load of `pressing`.

        On such a world the worm is first brought to rest with contacts that stick, and then with the friction of the
        run.
        """
        return True

    def pressing(self, gravity: FloatArray) -> FloatArray:
        """Return the part of gravity that presses a resting worm against the world, shape (3,) [m/s^2].

        The result is zero if gravity does not press the worm against the world.
        """
        return np.array(gravity, dtype=float)

    def bumps(self, within: float) -> float:
        """Return the height [m] of bumps that are narrower than `within` [m] and could pass between contact points."""
        return 0.0

    def normal(self, at: FloatArray, length: float) -> FloatArray:
        """Return the gradient of the distance at points, by central differences with a step of 1e-6 times `length` [m].

        The points and the gradient have the shape (..., 3).
        """
        h = 1e-6 * length
        d = self.distance(np.asarray(at)[..., None, None, :] + h * np.stack([np.eye(3), -np.eye(3)], axis=1))
        return np.asarray((d[..., 0] - d[..., 1]) / (2.0 * h))

    def forward(self, joints: FloatArray, level: FloatArray) -> FloatArray:
        """Return the heading of a worm with joints of shape (N+1, 3), as a unit vector.

        The heading is the horizontal direction `level`, tilted into the tangent plane. Worlds whose normal changes from
        place to place return the direction from tail to head instead.
        """
        normal = self.normal(joints.mean(axis=0), float(np.linalg.norm(joints[-1] - joints[0])))
        along = np.array(level, dtype=float)
        along[2] = -float(along[:2] @ normal[:2]) / normal[2] if abs(normal[2]) > 1e-3 else 0.0
        return along / float(np.linalg.norm(along))

    def course(self, points: FloatArray, joints: FloatArray) -> FloatArray | None:
        """Return distances of points along the course of the world, for example along a pipe, shape (K,) [m].

        The points have the shape (K, 3). Distances increase from the tail to the head of a worm with `joints` of shape
        (N+1, 3). The result is None if the world has no course. Distances are then measured along `forward`.
        """
        return None

    def height(self, places: FloatArray) -> FloatArray:
        """Return the height of the ground at places x, y, NaN where there is no ground, shape (M,) [m].

        The places have the shape (M, 2).
        """
        raise NotImplementedError(f"{type(self).__name__}: has neither `height` nor a `placed` of its own")

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints of a straight worm on the world, and the director to the left.

        The worm is laid from above on the ground that `height` describes.

        Parameters
        ----------
        along : ndarray, shape (N+1,)
            Distances of the joints from the tail, along the worm [m].
        clearance : float
            Distance of the joints from the surface [m].
        position : ndarray, shape (2,)
            Horizontal position of the tail [m].
        azimuth : float
            Heading [rad].

        Returns
        -------
        ndarray, shape (N+1, 3)
            Joints [m].
        ndarray, shape (3,) or (N, 3)
            Director to the left: the same for all segments, or one per segment.

        Raises
        ------
        ValueError
            There is no ground under a part of the worm.
        """
        joints = position + along[:, None] * [np.cos(azimuth), np.sin(azimuth)]
        bare = np.isnan(self.height(joints))
        if bare.any():
            x, y = joints[bare][0]
            raise ValueError(
                f"position: got {np.asarray(position).tolist()!r} m: the world has no ground under the worm at "
                f"x = {x:.4g}, y = {y:.4g} m; move or turn it, or give a State"
            )
        pit = -1e3 * float(along[-1] - along[0])  # where there is no ground beside the worm
        return laid(lambda places: np.nan_to_num(self.height(places), nan=pit), along, clearance, position, azimuth)


def chord(joints: FloatArray) -> FloatArray:
    """Return the unit vector from the tail to the head of joints (N+1, 3), shape (3,)."""
    chord = joints[-1] - joints[0]
    return np.asarray(chord / np.linalg.norm(chord))


BODY_REACH = 1.6
"""Half the width of the body, in clearances. It is the distance of the default worm's outward apexes from the axis."""

SOLE = 0.8
"""Half the width of the flat bottom of the body, in clearances. The bottom lies one clearance below the axis there, and
rises from there to the height of the axis at `BODY_REACH`."""

EVEN = 1e-9
"""Largest distance that counts as a rounding error, as a fraction of the length of the sampled line."""


def laid(
    height: Callable[[FloatArray], FloatArray],
    along: FloatArray,
    clearance: float,
    position: FloatArray,
    azimuth: float,
) -> tuple[FloatArray, FloatArray]:
    """Return joints and director of a straight worm on ground of the given height; see `World.placed`.

    At each place, the body needs a minimum height of the axis above the ground. Of all straight lines that are nowhere
    lower than this, the axis is the lowest at the middle of the worm. This line is the edge of the upper convex hull of
    the needed heights above the middle.
    """
    forward = np.array([np.cos(azimuth), np.sin(azimuth)])
    left = np.array([-forward[1], forward[0]])
    s = np.linspace(along[0] - clearance, along[-1] + clearance, 129)
    w = clearance * BODY_REACH * np.linspace(-1.0, 1.0, 17)
    deep = clearance * np.clip((BODY_REACH - np.abs(w) / clearance) / (BODY_REACH - SOLE), 0.0, 1.0)
    ground = height((position + s[:, None, None] * forward + w[:, None] * left).reshape(-1, 2))
    needed = _widened((ground.reshape(len(s), len(w)) + deep).max(axis=1), s, clearance / 2.0)
    begin, rise = _lowest_line_above(s, needed, float(along[[0, -1]].mean()))
    tangent = np.append(forward, rise) / np.hypot(1.0, rise)
    # The clearance is needed along the line's normal, not only upwards.
    lift = begin + (np.hypot(1.0, rise) - 1.0) * clearance
    return np.append(position, lift) + along[:, None] * tangent, np.append(left, 0.0)


def _widened(values: FloatArray, s: FloatArray, reach: float) -> FloatArray:
    """Return the largest of the values within a distance `reach` of each place `s`."""
    near = np.abs(s[:, None] - s) <= reach + EVEN * (s[-1] - s[0])
    return np.asarray(np.where(near, values, -np.inf).max(axis=1))


def _lowest_line_above(s: FloatArray, values: FloatArray, middle: float) -> tuple[float, float]:
    """Return the height at 0 and the slope of the line above all values that is lowest at `middle`.

    If the middle lies below a corner of the hull, for example on the top of a bump, there are several such lines. The
    result is then the flattest line.
    """
    floor, slack = values.min() - (s[-1] - s[0]), EVEN * (s[-1] - s[0])
    points = np.vstack([np.column_stack([s, values]), [[s[0], floor], [s[-1], floor]]])
    import scipy.spatial  # slow to import, and rarely needed

    ends = points[scipy.spatial.ConvexHull(points).simplices]
    low, high = ends.min(axis=1), ends.max(axis=1)
    over = ends[(low[:, 0] <= middle + slack) & (middle - slack <= high[:, 0]) & (low[:, 1] > floor)]
    rises = [(z_1 - z_0) / (s_1 - s_0) for (s_0, z_0), (s_1, z_1) in over]
    (s_0, z_0), flattest = over[0, 0], float(np.clip(0.0, min(rises), max(rises)))
    return float(z_0 - rises[0] * s_0 + (rises[0] - flattest) * middle), flattest
