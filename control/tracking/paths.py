"""Paths to follow: lines, circles, S-curves, splines, way points, and pipes seen from above.

A path is a curve in the plane by its arc length s [m], (L1). An open one goes straight on beyond both ends (s < 0 and
s > length), a closed one repeats, its heading counting on. Places lie to the left of a path at a positive distance

    e = (p - r(s)) . n(s),   n = (-sin(heading), cos(heading)),   s the projection of p                       (L2)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol, get_args, runtime_checkable

import numpy as np
import scipy
from numpy.typing import ArrayLike

from control.tracking.curves import Curve, require_apart, require_points
from control.tracking.waypoints import PlanView, WayPoints
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly

Side = Literal["left", "right"]

MOST_WAVES = 10_000
"""Largest number of waves of an S-curve, whose length is summed up piece by piece."""

__all__ = ["Circle", "Line", "Path", "PlanView", "SCurve", "Side", "SplinePath", "WayPoints", "offset", "track"]


@runtime_checkable
class Path(Protocol):
    """What can be followed."""

    @property
    def length(self) -> float:
        """Length, infinite for a line without end [m]."""

    @property
    def closed(self) -> bool:
        """Whether it leads back to its start."""

    def point(self, s: ArrayLike) -> FloatArray:
        """Return the points at arc lengths of shape (...) [m], shape (..., 2) [m]."""

    def heading(self, s: ArrayLike) -> FloatArray:
        """Return the azimuths of the path there, continuous along it, shape (...) [rad]."""

    def curvature(self, s: ArrayLike) -> FloatArray:
        """Return the curvatures there, positive to the left, shape (...) [1/m]."""

    def project(self, xy: ArrayLike, near: float | None = None) -> FloatArray:
        """Return the arc lengths of the points nearest to places (..., 2) [m], shape (...); by preference near one."""


@dataclass(frozen=True)
class Line:
    """A straight line.

    Attributes
    ----------
    start : tuple of float
        x, y of s = 0 [m].
    azimuth : float
        [rad]
    length : float
        Where it ends, as far as that matters [m].
    """

    start: tuple[float, float] = (0.0, 0.0)
    azimuth: float = 0.0
    length: float = math.inf

    closed = False

    def __post_init__(self) -> None:
        _require_start(self.start, self.azimuth)
        arguments.number("length", self.length, "m", gt=0.0, infinite=True)

    def point(self, s: ArrayLike) -> FloatArray:
        """Return points; see `Path`."""
        return np.array(self.start) + np.multiply.outer(s, _direction(self.azimuth))

    def heading(self, s: ArrayLike) -> FloatArray:
        """Return azimuths; see `Path`."""
        return np.full(np.shape(s), self.azimuth)

    def curvature(self, s: ArrayLike) -> FloatArray:
        """Return curvatures; see `Path`."""
        return np.zeros(np.shape(s))

    def project(self, xy: ArrayLike, near: float | None = None) -> FloatArray:
        """Return arc lengths; see `Path`."""
        along: FloatArray = np.asarray((np.asarray(xy, dtype=float) - self.start) @ _direction(self.azimuth))
        return along


@dataclass(frozen=True)
class Circle:
    """A circle.

    Attributes
    ----------
    radius : float
        [m]
    start : tuple of float
        x, y of s = 0 [m].
    azimuth : float
        Of its tangent there [rad].
    towards : str
        "left": its centre is to the left of the tangent, or "right".
    """

    radius: float
    start: tuple[float, float] = (0.0, 0.0)
    azimuth: float = 0.0
    towards: Side = "left"

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
        """Return points; see `Path`."""
        turn = np.asarray(s, dtype=float) / self.radius
        ahead, aside = np.sin(turn)[..., None], (1.0 - np.cos(turn))[..., None]
        return np.array(self.start) + self.radius * (ahead * _direction(self.azimuth) + aside * self._inwards)

    def heading(self, s: ArrayLike) -> FloatArray:
        """Return azimuths; see `Path`."""
        return self.azimuth + _sign(self.towards) * np.asarray(s, dtype=float) / self.radius

    def curvature(self, s: ArrayLike) -> FloatArray:
        """Return curvatures; see `Path`."""
        return np.full(np.shape(s), _sign(self.towards) / self.radius)

    def project(self, xy: ArrayLike, near: float | None = None) -> FloatArray:
        """Return arc lengths; see `Path`. Without `near` within the first lap."""
        out = np.asarray(xy, dtype=float) - self.start - self.radius * self._inwards
        turn = np.arctan2(out @ _direction(self.azimuth), -(out @ self._inwards))
        laps = 0.0 if near is None else np.round((near / self.radius - turn) / (2.0 * np.pi))
        within = np.mod(turn, 2.0 * np.pi) if near is None else turn + 2.0 * np.pi * laps
        return np.asarray(self.radius * within)

    @property
    def _inwards(self) -> FloatArray:
        """Unit vector from the start to the centre."""
        return _sign(self.towards) * _left(self.azimuth)


@dataclass(frozen=True)
class SCurve(Curve):
    """A sine wave, y = amplitude sin(2 pi x / wavelength), turned so that it begins along `azimuth`, without curvature.

    Attributes
    ----------
    amplitude, wavelength : float
        [m]
    waves : float
        Length along its axis in wavelengths.
    start : tuple of float
        x, y of s = 0 [m].
    azimuth : float
        Of its tangent there [rad].
    towards : str
        To which side of the axis of the wave it lies at first: "left" or "right".
    """

    amplitude: float = 0.4
    wavelength: float = 4.0
    waves: float = 2.0
    start: tuple[float, float] = (0.0, 0.0)
    azimuth: float = 0.0
    towards: Side = "left"

    def __post_init__(self) -> None:
        _require_start(self.start, self.azimuth)
        arguments.choice("towards", self.towards, get_args(Side))
        for name in ("amplitude", "wavelength"):
            arguments.number(name, getattr(self, name), gt=0.0)
        arguments.number("waves", self.waves, gt=0.0, le=MOST_WAVES)

    def knots(self) -> FloatArray:
        """Return every eighth of a wave; see `Curve`."""
        return np.linspace(0.0, self.waves * self.wavelength, max(2, math.ceil(8 * self.waves) + 1))

    def derivatives(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return r, r' and r'' at places u along the axis; see `Curve`."""
        k, side = 2.0 * np.pi / self.wavelength, _sign(self.towards)
        axis = self.azimuth - side * math.atan(self.amplitude * k)
        ahead, left = _direction(axis), side * _left(axis)
        y = self.amplitude * np.array([np.sin(k * u), k * np.cos(k * u), -(k**2) * np.sin(k * u)])
        r = np.array(self.start) + np.outer(u, ahead) + np.outer(y[0], left)
        return r, ahead + np.outer(y[1], left), np.outer(y[2], left)


@dataclass(frozen=True, eq=False)
class SplinePath(ReadOnly, Curve):
    """A cubic spline through points, with continuous curvature; over the chords, and natural at its ends.

    Attributes
    ----------
    points : ndarray, shape (P, 2)
        At least two, each apart from the next; a closed one does not repeat its first [m].
    closed : bool
        Whether it goes on from the last point to the first.
    """

    points: FloatArray
    closed: bool = False

    def __post_init__(self) -> None:
        closed = arguments.flag("closed", self.closed)
        object.__setattr__(self, "points", require_points(self.points, 3 if closed else 2))
        require_apart(self._run)

    def knots(self) -> FloatArray:
        """Return the sums of the chords; see `Curve`."""
        chords = np.linalg.norm(np.diff(self._run, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(chords)])

    def derivatives(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return r, r' and r''; see `Curve`."""
        return self._spline(u), self._spline(u, 1), self._spline(u, 2)

    @property
    def _run(self) -> FloatArray:
        return np.vstack([self.points, self.points[:1]]) if self.closed else self.points

    @cached_property
    def _spline(self) -> scipy.interpolate.CubicSpline:
        return scipy.interpolate.CubicSpline(self.knots(), self._run, bc_type="periodic" if self.closed else "natural")


def offset(path: Path, xy: ArrayLike, s: ArrayLike) -> FloatArray:
    """Return how far places (..., 2) lie to the left of a path at their projections s (...), (L2) [m]."""
    azimuth = path.heading(s)
    off = np.asarray(xy, dtype=float) - path.point(s)
    return np.asarray(off[..., 1] * np.cos(azimuth) - off[..., 0] * np.sin(azimuth))


def track(path: Path, xy: FloatArray, near: float | None = None) -> FloatArray:
    """Return the projections of places that follow each other, (K, 2) [m], each near the one before, shape (K,) [m].

    Parameters
    ----------
    path : Path
    xy : ndarray, shape (K, 2)
    near : float, optional
        Where to begin; anywhere if left out.
    """
    found: list[float] = []
    for place in xy:
        near = float(path.project(place, near))
        found.append(near)
    return np.array(found)


def _direction(azimuth: float) -> FloatArray:
    return np.array([math.cos(azimuth), math.sin(azimuth)])


def _left(azimuth: float) -> FloatArray:
    return np.array([-math.sin(azimuth), math.cos(azimuth)])


def _sign(side: Side) -> float:
    return 1.0 if side == "left" else -1.0


def _require_start(start: tuple[float, float], azimuth: float) -> None:
    arguments.array("start", start, (2,))
    arguments.number("azimuth", azimuth, "rad")
