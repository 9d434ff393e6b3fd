"""The state at the start or end of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from worm3d.physics import elements
from worm3d.physics.worm import Worm
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.documented import with_fields
from worm3d.values.read_only import ReadOnly, read_only
from worm3d.values.spelling import spelled
from worm3d.worlds.base import World

TOUCHES = 1e-12
"""Depth of an apex in the world that still counts as rounding, as a fraction of the body length."""


RIM_POINTS = 49
"""Number of points on the rim of an end face where a worm is laid on a world. The lowest point of the rim is one of
them. With half this number, the rim may be 1 % of its radius too deep on the side of a pipe."""


class StateError(ValueError):
    """Raised if a run cannot start from a state: the state does not fit the worm, or lies inside the world."""


@with_fields
@dataclass(frozen=True, eq=False, kw_only=True)
class State(ReadOnly):
    """Pose and motion of a worm of N segments. Frozen, with read-only arrays.

    Raises
    ------
    ValueError
        An array of the wrong shape, a value that is not finite, or directors that are not unit vectors normal to their
        segments.
    """

    joints: FloatArray
    """Positions of the joints, tail first, shape (N+1, 3) [m]."""
    directors: FloatArray
    """Unit vector that points to the left of each segment, normal to the segment, shape (N, 3)."""
    bend: FloatArray
    """Chamber bend th of each segment, shape (N,) [rad]. The left chamber is b th shorter than the segment."""
    joint_velocity: FloatArray
    """Velocity of the joints, shape (N+1, 3) [m/s]."""
    roll_rate: FloatArray
    """Rate of roll of each segment, shape (N,) [rad/s]."""
    bend_rate: FloatArray
    """Rate of bend of each segment, shape (N,) [rad/s]."""
    contraction: FloatArray
    """Output of the actuators: contraction of each chamber [left, right], shape (N, 2).

    A worm may start contracted, for example wedged in a pipe. An output that is not a contraction, such as a pressure,
    may exceed 1. It is then stored as `GREATEST_CONTRACTION` here, and unchanged in `memory`.
    """
    time: float
    """Time [s]."""
    laid: bool
    """Whether `straight` has placed the worm on a world. A run then settles it, even if rough ground leaves gaps."""
    memory: Mapping[str, NDArray[Any]] = field(repr=False)
    """Arrays that the integrator, contacts and actuators need to continue, by name; empty if a user made the state.

    From a state with these arrays, a run continues as if it had never been stopped, to the last bit.
    """

    def __init__(
        self,
        *,
        joints: ArrayLike,
        directors: ArrayLike | None = None,
        bend: ArrayLike = 0.0,
        joint_velocity: ArrayLike = 0.0,
        roll_rate: ArrayLike = 0.0,
        bend_rate: ArrayLike = 0.0,
        contraction: ArrayLike = 0.0,
        time: float = 0.0,
        laid: bool = False,
        memory: Mapping[str, NDArray[Any]] | None = None,
    ) -> None:
        points = arguments.floats("joints", joints)
        if points.ndim != 2 or points.shape[0] < 2 or points.shape[1] != 3:
            raise ValueError(f"joints: got shape {points.shape}, must be (N+1, 3): x, y, z of each joint, tail first")
        n = len(points) - 1
        self._set("joints", points, (n + 1, 3))
        self._set("bend", bend, (n,))
        self._set("joint_velocity", joint_velocity, (n + 1, 3))
        self._set("roll_rate", roll_rate, (n,))
        self._set("bend_rate", bend_rate, (n,))
        self._set("contraction", contraction, (n, 2))
        if not (self.contraction < 1.0).all():
            raise ValueError(f"contraction: got {float(self.contraction.max())!r}, must be below 1")
        self._set("directors", level_directors(self.joints) if directors is None else directors, (n, 3))
        self._check_directors()
        object.__setattr__(self, "time", arguments.number("time", time, "s"))
        object.__setattr__(self, "laid", arguments.flag("laid", laid))
        if not isinstance(memory, Mapping | None):
            raise ValueError(f"memory: got {type(memory).__name__}, must be the memory of another state, or None")
        copies = {name: np.array(value) for name, value in (memory or {}).items()}  # `Plant.remember` checks each
        object.__setattr__(self, "memory", read_only(copies))

    @classmethod
    def unchecked(cls, **values: Any) -> State:
        """Return the state with these fields. All fields must be given and valid, with unshared arrays."""
        state = cls.__new__(cls)
        state.__setstate__(values)
        return state

    def _set(self, name: str, value: ArrayLike, shape: tuple[int, ...]) -> None:
        object.__setattr__(self, name, arguments.array(name, value, shape, fill=True))

    def _check_directors(self) -> None:
        edges = np.diff(self.joints, axis=0)
        length = np.linalg.norm(edges, axis=1)
        if not (length > 0.0).all():
            raise ValueError(f"joints: segment {int(np.argmin(length))} has no length")
        along = np.abs(np.sum(self.directors * edges, axis=1)) / length
        off = np.maximum(along, np.abs(np.linalg.norm(self.directors, axis=1) - 1.0))
        if off.max() > 1e-6:
            raise ValueError(
                f"directors: the director of segment {int(np.argmax(off))} is off by {off.max():.3g}, must be a unit "
                "vector normal to the segment"
            )

    @property
    def segments(self) -> int:
        """Number of segments N."""
        return len(self.bend)

    @property
    def moves(self) -> bool:
        """Whether any velocity is not 0."""
        return any(bool(np.any(getattr(self, name))) for name in ("joint_velocity", "roll_rate", "bend_rate"))

    @classmethod
    @spelled
    def straight(
        cls,
        worm: Worm,
        world: World | None = None,
        position: ArrayLike = (0.0, 0.0),
        azimuth: float = 0.0,
        contraction: ArrayLike = 0.0,
    ) -> State:
        """Return the state of a worm at rest on its world. The worm is straight, or follows the centre line of a pipe.

        Without a world, the worm lies at height 0.

        Parameters
        ----------
        worm : Worm
        world : World, optional
        position : array_like, shape (2,) or (3,)
            Position x, y of the tail. A third number is the height of the worm above the surface [m]. In a pipe, the
            first number is the position of the tail along the pipe, and the second is 0. In no world can a worm start
            below the surface. On the clamped ground it cannot start above the surface either.
        azimuth : float
            Heading, from x towards y [rad]. In a pipe it is 0 (along the pipe) or pi (in the opposite direction).
        contraction : float or array_like, shape (N, 2)
            Contraction of the chambers. The pose of the state still has the rest lengths; settling contracts the worm
            as far as the world allows.

        Raises
        ------
        ValueError
            A position or azimuth that is not finite or of another shape.
        StateError
            The world has no room for the worm at this position.
        """
        arguments.instance("worm", worm, Worm, "a worm3d.Worm")
        arguments.instance("world", world, World | None, "a world such as worm3d.Plane(), or None")
        at = arguments.floats("position", position)
        if at.shape not in ((2,), (3,)) or not (np.abs(at) <= arguments.MAX_MAGNITUDE).all():
            raise ValueError(f"position: got {arguments.shown(position)} m, must be finite: x, y (and a lift)")
        azimuth = arguments.number("azimuth", azimuth, "rad")
        along = worm.l0 * np.arange(worm.segments + 1.0)
        lift = float(at[2]) if len(at) == 3 and abs(at[2]) > TOUCHES * worm.length else 0.0
        _require_lift(lift, world)
        if world is None:
            tangent = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            joints = np.append(at[:2], lift) + along[:, None] * tangent
            left = np.array([-tangent[1], tangent[0], 0.0])
        else:
            clearance = float(np.max(worm.half_height)) + lift
            start = arguments.array("contraction", contraction, (worm.segments, 2), fill=True)
            joints, left = _laid(worm, world, along, clearance, at[:2], azimuth, start)
        directors, laid = np.broadcast_to(left, (worm.segments, 3)), world is not None and lift == 0.0
        return cls(joints=joints, directors=directors, contraction=contraction, laid=laid)

    def with_changes(self, **changes: Any) -> State:
        """Return a copy with some fields changed.

        The copy has no memory unless `memory` is an argument, and `laid` becomes False if the pose changes.
        """
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        laid = self.laid and not {"joints", "directors", "bend"} & changes.keys()
        return State(**{**given, "memory": None, "laid": laid, **changes})


def _require_lift(lift: float, world: World | None) -> None:
    """Raise ValueError if no worm can start at this height above the surface of a world."""
    if world is None or lift == 0.0 or (lift > 0.0 and not world.clamped):
        return
    allowed = "0 on a ClampedGround, which holds the joints at its height" if world.clamped else "at least 0"
    raise ValueError(
        f"position: got {lift:g} m as its third number, must be {allowed}: it is a height above the "
        "surface, not above z = 0"
    )


def _laid(
    worm: Worm,
    world: World,
    along: FloatArray,
    clearance: float,
    at: FloatArray,
    azimuth: float,
    contraction: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return joints and directors of the worm on its world, lifted if apexes would lie inside the world."""
    lift = before = np.inf
    for _ in range(50):
        try:
            joints, left = world.placed(along, clearance, at, azimuth)
        except ValueError as error:
            raise StateError(f"state: {error}") from error
        if world.clamped:
            return joints, left
        directors = np.broadcast_to(left, (worm.segments, 3))
        rest = np.full((worm.segments, 2), worm.l0)
        points = apexes_of(worm, joints, directors, rest, contraction).reshape(-1, 3)
        deep = -float(world.distance(np.concatenate([points, _wide_rims(worm, joints, directors)])).min())
        if deep <= TOUCHES * worm.length:
            return joints, left
        lift = 2.0 * deep if deep < 0.5 * before else 2.0 * lift
        clearance, before = clearance + min(lift, worm.length), deep
    raise StateError(f"state: the worm lies {deep:.3g} m inside the world even if lifted to {clearance:.3g} m; move it")


def apexes_of(
    worm: Worm, joints: FloatArray, directors: FloatArray, length: FloatArray, contraction: FloatArray
) -> FloatArray:
    """Return the apexes of a worm, (E3), shape (N, 6, 3) [m].

    `length` and `contraction` are the lengths [m] and contractions of the chambers [left, right], shape (N, 2).
    """
    edges = np.diff(joints, axis=0)
    tangents, middles = edges / np.linalg.norm(edges, axis=1)[:, None], (joints[:-1] + joints[1:]) / 2.0
    outlines = worm.segment.outlines(worm, length, contraction)
    sizes = np.column_stack([*outlines, np.full(worm.segments, worm.chamber_offset)])
    points = _rest_apexes(worm.segments)(middles.T, tangents.T, directors.T, sizes.T)
    return np.array(points).T.reshape(worm.segments, 6, 3)


def _wide_rims(worm: Worm, joints: FloatArray, directors: FloatArray) -> FloatArray:
    """Return points on the rims of the end faces that are wider than their segments are tall, shape (K, 3) [m]."""
    radius, angle = worm.segment.face_radius(worm), np.linspace(0.0, 2.0 * np.pi, RIM_POINTS)[:, None]
    found = [np.zeros((0, 3))]
    for end in (0, -1) if worm.end_faces else ():
        if radius[end] > np.asarray(worm.half_height)[end]:
            edge = joints[1] - joints[0] if end == 0 else joints[-1] - joints[-2]
            up = np.cross(edge / np.linalg.norm(edge), directors[end])
            found.append(joints[end] + radius[end] * (np.cos(angle) * directors[end] + np.sin(angle) * up))
    return np.concatenate(found)


@cache
def _rest_apexes(segments: int) -> ca.Function:
    """Return a function of middle, tangent, director and sizes of each segment that returns its apexes (18).

    The sizes are the half-heights and the outward distances of both chambers, and the offset of the chambers.
    """
    (m, t, d), sizes = (ca.SX.sym(name, 3) for name in ("middle", "tangent", "director")), ca.SX.sym("sizes", 5)
    frame = elements.Frame(ca.SX(1.0), t, d, ca.cross(t, d))
    points = elements.apexes(m, frame, [(sizes[0], sizes[2]), (sizes[1], sizes[3])], sizes[4])
    return ca.Function("apexes", [m, t, d, sizes], [ca.vertcat(*points)]).map(segments)


def level_directors(joints: FloatArray) -> FloatArray:
    """Return horizontal directors that point to the left, shape (N, 3). A vertical segment gets the y axis."""
    edges = np.diff(joints, axis=0)
    left = np.column_stack([-edges[:, 1], edges[:, 0], np.zeros(len(edges))])
    size = np.linalg.norm(left, axis=1)
    vertical = size < 1e-9 * np.linalg.norm(edges, axis=1)
    left[vertical] = [0.0, 1.0, 0.0]
    size[vertical] = 1.0
    tangent = edges / np.maximum(np.linalg.norm(edges, axis=1), 1e-300)[:, None]
    left = left / size[:, None]
    left -= np.sum(left * tangent, axis=1)[:, None] * tangent
    unit: FloatArray = left / np.linalg.norm(left, axis=1)[:, None]
    return unit
