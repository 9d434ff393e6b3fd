"""References: how fast to go, and where to, along a path or at a heading; and what they ask for ahead of a worm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from control.tracking.paths import Path
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray

Profile = Callable[[Any], Any]
"""Function of the time [s], a number or an array, that gives as many speeds [m/s] or headings [rad]."""

MOMENT = 0.05
"""Time over which the rate of a heading is taken [s]."""


@dataclass(frozen=True)
class Constant:
    """A profile that is the same at all times."""

    value: float

    def __post_init__(self) -> None:
        _require_finite(self)

    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the value at times of any shape [s]."""
        return np.full(np.shape(t), float(self.value))


@dataclass(frozen=True)
class Steps:
    """A profile that changes in steps."""

    first: float
    """Value before the first step."""
    times: tuple[float, ...]
    """Times of the steps, growing [s]."""
    values: tuple[float, ...]
    """Value from each of them on."""

    def __post_init__(self) -> None:
        arguments.number("first", self.first)
        for name in ("times", "values"):
            given = arguments.array(name, getattr(self, name), ("K",), least=0)
            object.__setattr__(self, name, tuple(given.tolist()))
        if len(self.times) != len(self.values):
            raise ValueError(f"values: got {len(self.values)} for {len(self.times)} times, must be one for each")
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError(f"times: got {self.times!r}, must grow")

    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the values at times of any shape [s]."""
        # A time that equals a step's but for rounding is after it.
        since = np.searchsorted(np.array(self.times) - 1e-9, np.asarray(t, dtype=float), side="right")
        return np.array([self.first, *self.values])[since]


@dataclass(frozen=True)
class Sine:
    """The profile mean + amplitude sin(2 pi t / period)."""

    mean: float
    amplitude: float
    period: float

    def __post_init__(self) -> None:
        _require_finite(self)
        arguments.number("period", self.period, "s", gt=0.0)

    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the values at times of any shape [s]."""
        wave: FloatArray = np.sin(2.0 * np.pi / self.period * np.asarray(t, dtype=float))
        return self.mean + self.amplitude * wave


@dataclass(frozen=True)
class Reference:
    """What the worm is to do: a speed, and at most one of heading and path."""

    speed: Profile
    """Time [s] -> speed forward, along the path if there is one [m/s]; takes arrays."""
    heading: Profile | None = None
    """Time [s] -> heading [rad]; takes arrays."""
    path: Path | None = None

    def __post_init__(self) -> None:
        if self.heading is not None and self.path is not None:
            raise ValueError("heading, path: got both, must be at most one: a path has headings of its own")
        for name in ("speed", "heading"):
            given = getattr(self, name)
            if not (given is None and name == "heading"):
                arguments.function(name, given, "a function of time: control.tracking.references.Constant(0.08)")
        if not (self.path is None or isinstance(self.path, Path)):
            raise ValueError(f"path: got {type(self.path).__name__}, must be a path, as control.tracking.paths.Line()")


@dataclass(frozen=True, eq=False)
class Preview:
    """What a reference asks for at K instants."""

    speed: FloatArray
    """Speed forward [m/s], shape (K,)."""
    point: FloatArray
    """Points of the path [m], shape (K, 2); zeros without a path."""
    heading: FloatArray
    """Heading of the path, or as asked for, on the turn of the worm's own [rad], shape (K,); zeros if there is none."""
    follows: bool
    """Whether there is a path."""
    heads: bool
    """Whether there is a heading."""
    progress: float
    """Arc length of the path's point nearest to the worm [m]; 0 without a path."""
    left: FloatArray
    """Greatest offset to the left of the path that is allowed [m], shape (K,); infinite without a bound."""
    right: FloatArray
    """Greatest offset to the right, as a positive number [m], shape (K,)."""


def look_ahead(
    reference: Reference, begin: float, step: float, steps: int, place: FloatArray, azimuth: float, near: float | None
) -> Preview:
    """Return what is asked for at the ends of the steps of a horizon that begins at a time [s].

    The point of the path advances at the reference speed from where the worm is, whatever the worm does. The worm is at
    a place (2,) [m] with an azimuth [rad]; its progress is looked for near the one before [m].
    """
    ends = begin + step * np.arange(1, steps + 1)
    speed = np.asarray(reference.speed(ends), dtype=float)
    point, heading, progress = np.zeros((steps, 2)), np.zeros(steps), 0.0
    follows = reference.path is not None
    if reference.path is not None:
        progress = float(reference.path.project(place, near))
        ahead = progress + np.cumsum(np.asarray(reference.speed(ends - step / 2.0), dtype=float)) * step
        point, heading = reference.path.point(ahead), reference.path.heading(ahead)
        heading = _on_turn(heading, float(reference.path.heading(progress)), azimuth)
    elif reference.heading is not None:
        heading = np.asarray(reference.heading(ends), dtype=float)
        heading = _on_turn(heading, float(heading[0]), azimuth)
    free = np.full(steps, np.inf)
    return Preview(speed, point, heading, follows, follows or reference.heading is not None, progress, free, free)


def turn_rate(reference: Reference, t: float, progress: float) -> float:
    """Return the turn rate that a reference asks for at time t [s], `progress` [m] along its path, in rad/s."""
    if reference.path is not None:
        return float(reference.path.curvature(progress)) * float(reference.speed(t))
    if reference.heading is not None:
        return (float(reference.heading(t + MOMENT)) - float(reference.heading(t))) / MOMENT
    return 0.0


def turn_of_path(reference: Reference, t: float, place: FloatArray) -> float:
    """Return the turn rate of the path at its point nearest to a place (2,) [m], in rad/s; 0 without a path."""
    if reference.path is None or not np.isfinite(place).all():
        return 0.0
    return turn_rate(reference, t, float(reference.path.project(place)))


def _on_turn(heading: FloatArray, first: float, azimuth: float) -> FloatArray:
    """Return headings counted on or back by whole turns, so that `first` comes nearest to an azimuth [rad]."""
    turns = float(np.round((first - azimuth) / (2.0 * np.pi)))
    return np.asarray(heading - 2.0 * np.pi * turns)


def _require_finite(profile: Constant | Sine) -> None:
    for field in fields(profile):
        arguments.number(field.name, getattr(profile, field.name))
