"""Paths that a worm can follow: lines, circles, S-curves, splines, waypoints, and pipes seen from above.

A path is a plane curve as a function of its arc length s [m], (L1). An open path continues straight beyond both ends
(s < 0 and s > length). A closed path repeats, and its heading accumulates over the laps. The offset e of a place p is
positive to the left of the path:

    e = (p - r(s)) . n(s),   n = (-sin(heading), cos(heading)),   s the projection of p                       (L2)
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol, get_args, runtime_checkable

import numpy as np
import scipy
from numpy.typing import ArrayLike

from control.tracking.curves import Curve
from worm3d import Bend, Centreline, Straight
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly
from worm3d.values.spelling import Spelled

Side = Literal["left", "right"]


@runtime_checkable
class Path(Protocol):
    """Interface of a path that a worm can follow."""

    @property
    @abstractmethod
    def length(self) -> float:
        """Length [m]. It is infinite for a line without end."""

    @property
    @abstractmethod
    def closed(self) -> bool:
        """Whether the path leads back to its start."""

    @abstractmethod
    def point(self, s: ArrayLike) -> FloatArray:
        """Return the points at arc lengths `s` [m], shape (..., 2) for `s` of shape (...) [m]."""

    @abstractmethod
    def heading(self, s: ArrayLike) -> FloatArray:
        """Return the azimuths at arc lengths `s`, of the same shape [rad]. They are continuous along the path."""

    @abstractmethod
    def curvature(self, s: ArrayLike) -> FloatArray:
        """Return the curvatures at arc lengths `s`, of the same shape, positive to the left [1/m]."""

    @abstractmethod
    def project(self, xy: ArrayLike, near: float | None = None) -> FloatArray:
        """Return the arc lengths of the points nearest to places `xy`, shape (...) for places of shape (..., 2) [m].

        If a path passes a place more than once, the pass near the arc length `near` is preferred.
        """


@dataclass(frozen=True)
class Line(Spelled, Path):
    """A straight line."""

    start: tuple[float, float] = (0.0, 0.0)
    """Point (x, y) at s = 0 [m]."""
    azimuth: float = 0.0
    """Azimuth of the line's direction [rad]."""
    length: float = math.inf
    """Arc length at the line's end, if the reference has an end [m]."""

    closed = False

    def __post_init__(self) -> None:
        _require_start(self.start, self.azimuth)
        arguments.number("length", self.length, "m", gt=0.0, infinite=True)

    def point(self, s: ArrayLike) -> FloatArray:
        """Return the points; see `Path`."""
        return np.array(self.start) + np.multiply.outer(s, _direction(self.azimuth))

    def heading(self, s: ArrayLike) -> FloatArray:
        """Return the azimuths; see `Path`."""
        return np.full(np.shape(s), self.azimuth)

    def curvature(self, s: ArrayLike) -> FloatArray:
        """Return the curvatures; see `Path`."""
        return np.zeros(np.shape(s))

    def project(self, xy: ArrayLike, near: float | None = None) -> FloatArray:
        """Return the arc lengths; see `Path`."""
        return np.asarray((np.asarray(xy, dtype=float) - self.start) @ _direction(self.azimuth))


@dataclass(frozen=True)
class Circle(Spelled, Path):
    """A circle."""

    radius: float
    """Radius [m]."""
    start: tuple[float, float] = (0.0, 0.0)
    """Point (x, y) at s = 0 [m]."""
    azimuth: float = 0.0
    """Azimuth of the tangent at s = 0 [rad]."""
    towards: Side = "left"
    """The circle's centre lies on this side of the tangent: "left" or "right"."""

    closed = True

    def __post_init__(self) -> None:
        _require_start(self.start, self.azimuth)
        arguments.choice("towards", self.towards, get_args(Side))
        arguments.number("radius", self.radius, "m", gt=0.0)

    @property
    def length(self) -> float:
        """Circumference [m]."""
        return 2.0 * math.pi * self.radius

    def point(self, s: ArrayLike) -> FloatArray:
        """Return the points; see `Path`."""
        turn = np.asarray(s, dtype=float) / self.radius
        ahead, aside = np.sin(turn)[..., None], (1.0 - np.cos(turn))[..., None]
        return np.array(self.start) + self.radius * (ahead * _direction(self.azimuth) + aside * self._inwards)

    def heading(self, s: ArrayLike) -> FloatArray:
        """Return the azimuths; see `Path`."""
        return self.azimuth + _sign(self.towards) * np.asarray(s, dtype=float) / self.radius

    def curvature(self, s: ArrayLike) -> FloatArray:
        """Return the curvatures; see `Path`."""
        return np.full(np.shape(s), _sign(self.towards) / self.radius)

    def project(self, xy: ArrayLike, near: float | None = None) -> FloatArray:
        """Return the arc lengths, see `Path`. Without `near`, they are within the first lap."""
        out = np.asarray(xy, dtype=float) - self.start - self.radius * self._inwards
        turn = np.arctan2(out @ _direction(self.azimuth), -(out @ self._inwards))
        if near is None:
            return np.asarray(self.radius * np.mod(turn, 2.0 * np.pi))
        laps = np.round((near / self.radius - turn) / (2.0 * np.pi))
        return np.asarray(self.radius * (turn + 2.0 * np.pi * laps))

    @property
    def _inwards(self) -> FloatArray:
        return _sign(self.towards) * _left(self.azimuth)


@dataclass(frozen=True)
class SCurve(Curve, Path):
    """A sine wave, y = amplitude sin(2 pi x / wavelength), rotated so that it begins in the direction `azimuth`."""

    amplitude: float = 0.4
    """Amplitude of the sine [m]."""
    wavelength: float = 4.0
    """Wavelength of the sine [m]."""
    waves: float = 2.0
    """Length along the wave's axis [wavelengths]."""
    start: tuple[float, float] = (0.0, 0.0)
    """Point (x, y) at s = 0 [m]."""
    azimuth: float = 0.0
    """Azimuth of the tangent at s = 0 [rad]."""
    towards: Side = "left"
    """The first half-wave lies on this side of the wave's axis: "left" or "right"."""

    def __post_init__(self) -> None:
        _require_start(self.start, self.azimuth)
        arguments.choice("towards", self.towards, get_args(Side))
        arguments.number("amplitude", self.amplitude, gt=0.0)
        arguments.number("wavelength", self.wavelength, gt=0.0)
        arguments.number("waves", self.waves, gt=0.0, le=10_000)  # the length is summed up piece by piece

    def knots(self) -> FloatArray:
        """Return the ends of every eighth of a wave, see `Curve`."""
        return np.linspace(0.0, self.waves * self.wavelength, max(2, math.ceil(8 * self.waves) + 1))

    def derivatives(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return r, r' and r'' at places u along the axis; see `Curve`."""
        k, side = 2.0 * np.pi / self.wavelength, _sign(self.towards)
        axis = self.azimuth - side * math.atan(self.amplitude * k)
        ahead, left = _direction(axis), side * _left(axis)
        u = u[:, None]
        sin, cos = np.sin(k * u), np.cos(k * u)
        r = np.array(self.start) + u * ahead + self.amplitude * sin * left
        return r, ahead + self.amplitude * (k * cos) * left, self.amplitude * (-(k**2) * sin) * left


@dataclass(frozen=True, eq=False)
class SplinePath(ReadOnly, Curve, Path):
    """A cubic spline through points, with continuous curvature.

    The parameter is the sum of the chord lengths. At the ends of an open path the curvature is 0.
    """

    points: FloatArray
    """At least two points [m], shape (P, 2). Consecutive points must differ. A closed path does not repeat the first
    point."""
    closed: bool = False
    """Whether the path continues from the last point to the first."""

    def __post_init__(self) -> None:
        closed = arguments.flag("closed", self.closed)
        object.__setattr__(self, "points", _points(self.points, 3 if closed else 2, closed=closed))
        super().__post_init__()

    def knots(self) -> FloatArray:
        """Return the sums of the chord lengths, see `Curve`."""
        chords = np.linalg.norm(np.diff(_run(self.points, self.closed), axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(chords)])

    def derivatives(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return r, r' and r''; see `Curve`."""
        return self._spline(u), self._spline(u, 1), self._spline(u, 2)

    @cached_property
    def _spline(self) -> scipy.interpolate.CubicSpline:
        ends = "periodic" if self.closed else "natural"
        return scipy.interpolate.CubicSpline(self.knots(), _run(self.points, self.closed), bc_type=ends)


@dataclass(frozen=True, eq=False)
class PlanView(ReadOnly, Curve, Path):
    """The centre line of a pipe seen from above."""

    centreline: Centreline
    """Centre line, which must not be vertical anywhere."""

    def __post_init__(self) -> None:
        arguments.instance("centreline", self.centreline, Centreline, "a worm3d.Centreline")
        line = np.linspace(0.0, self.centreline.total, 64 * len(self.centreline.length) + 1)
        if np.linalg.norm(self.centreline.at(line)[1][:, :2], axis=1).min() < 1e-3:
            raise ValueError("centreline: it is vertical somewhere, where it has no heading; follow a level part of it")

    def knots(self) -> FloatArray:
        """Return the ends of the pieces of the centre line, see `Curve`."""
        return np.concatenate([[0.0], self.centreline.ends])

    def derivatives(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return r, r' and r'' at distances u along the centre line, see `Curve`."""
        line = self.centreline
        points, tangents = line.at(u)
        begins = line.ends - line.length
        k = np.clip(np.searchsorted(begins, u, side="right") - 1, 0, len(begins) - 1)
        turn = (line.curvature[k] * (u - begins[k]))[:, None]
        normal = np.cos(turn) * line.normal[k] - np.sin(turn) * line.tangent[k]
        return points[:, :2], tangents[:, :2], (line.curvature[k][:, None] * normal)[:, :2]

    def lengthening(self, s: ArrayLike) -> FloatArray:
        """Return the length of the centre line divided by its length seen from above.

        `s` contains arc lengths of the path and has the same shape as the result.
        """
        u = self._parameter(np.ravel(np.clip(s, 0.0, self.length)).astype(float))
        level = np.linalg.norm(self.derivatives(u)[1], axis=1)
        return np.asarray(1.0 / level.reshape(np.shape(s)))


class WayPoints(PlanView):
    """Straight pieces between waypoints, with corners rounded by arcs of one radius.

    Raises
    ------
    ValueError
        Two consecutive points coincide, the path turns back on itself, or two points are too close for the radius.
    """

    points: FloatArray
    """At least two points [m], shape (P, 2). Consecutive points must differ. Since corners are rounded, the path only
    passes near inner points."""
    radius: float
    """Radius of the arcs [m]."""

    def __init__(self, points: ArrayLike, radius: float = 1.0) -> None:
        object.__setattr__(self, "points", _points(points, 2))
        object.__setattr__(self, "radius", arguments.number("radius", radius, "m", gt=0.0))
        super().__init__(_rounded(self.points, self.radius))


def lengthening(path: Path | None, s: ArrayLike) -> FloatArray:
    """Return the length of a path divided by its length seen from above.

    It is 1 except in pipes that rise or fall. `s` contains arc lengths and has the same shape as the result.
    """
    rising = getattr(path, "lengthening", None)
    return np.ones(np.shape(s)) if rising is None else np.asarray(rising(s))


def offset(path: Path, xy: ArrayLike, s: ArrayLike, azimuth: ArrayLike | None = None) -> FloatArray:
    """Return the offsets (L2) of places to the left of a path, shape (...) [m].

    Parameters
    ----------
    path : Path
    xy : array_like, shape (..., 2)
        Places [m].
    s : array_like, shape (...)
        Projections of the places onto the path [m].
    azimuth : array_like, shape (...), optional
        Azimuths of the path at the projections [rad], if they are already known.
    """
    azimuth = path.heading(s) if azimuth is None else azimuth
    off = np.asarray(xy, dtype=float) - path.point(s)
    return np.asarray(off[..., 1] * np.cos(azimuth) - off[..., 0] * np.sin(azimuth))


def track(path: Path, xy: FloatArray, near: float | None = None) -> FloatArray:
    """Return the projections of successive places onto a path, shape (K,) for places of shape (K, 2) [m].

    Each projection is searched near the previous one.
    """
    found = [near := float(path.project(place, near)) for place in xy]
    return np.array(found)


def _direction(azimuth: float) -> FloatArray:
    return np.array([math.cos(azimuth), math.sin(azimuth)])


def _left(azimuth: float) -> FloatArray:
    return np.array([-math.sin(azimuth), math.cos(azimuth)])


def _sign(side: Side) -> float:
    return 1.0 if side == "left" else -1.0


def _rounded(points: FloatArray, radius: float) -> Centreline:
    """Return a centre line of straight pieces between points, with arcs that round the corners."""
    chords = np.diff(points, axis=0)
    length, azimuth = np.linalg.norm(chords, axis=1), np.arctan2(chords[:, 1], chords[:, 0])
    turn = np.mod(np.diff(azimuth) + np.pi, 2.0 * np.pi) - np.pi
    if (np.abs(turn) > math.pi - 0.01).any():
        k = int(np.argmax(np.abs(turn))) + 1
        raise ValueError(f"points: the path turns back on itself at point {k}; put a point beside it to turn round")
    cut = np.concatenate([[0.0], radius * np.tan(np.abs(turn) / 2.0), [0.0]])
    left = length - cut[:-1] - cut[1:]
    if left.min() < -1e-9 * length.max():
        k = int(np.argmin(left))
        raise ValueError(
            f"radius: got {radius!r} m, too large for the stretch of {length[k]:.4g} m from point {k} to {k + 1}: its "
            f"corners take {cut[k] + cut[k + 1]:.4g} m; choose a smaller radius or move the points apart"
        )
    pieces: list[Straight | Bend] = []
    for k, rest in enumerate(left):
        if rest > 1e-9 * length.max():
            pieces.append(Straight(float(rest)))
        if k < len(turn) and abs(turn[k]) > 1e-9:
            pieces.append(Bend(abs(float(turn[k])), radius, "left" if turn[k] > 0.0 else "right"))
    return Centreline.of(pieces, (*points[0], 0.0), float(azimuth[0]))


def _require_start(start: tuple[float, float], azimuth: float) -> None:
    arguments.array("start", start, (2,))
    arguments.number("azimuth", azimuth, "rad")


def _points(points: ArrayLike, least: int, *, closed: bool = False) -> FloatArray:
    """Return points as a read-only array of shape (P, 2).

    ValueError if there are fewer than `least` points, or if consecutive points coincide.
    """
    found = arguments.array("points", points, ("P", 2), least=least)
    if not (np.linalg.norm(np.diff(_run(found, closed), axis=0), axis=1) > 0.0).all():
        first = ", as the first one of a closed path after the last" if closed else ""
        raise ValueError(f"points: two that follow each other coincide{first}; leave one of them out")
    return found


def _run(points: FloatArray, closed: bool) -> FloatArray:
    """Return points. For a closed path, the first point is repeated at the end."""
    return np.vstack([points, points[:1]]) if closed else points
