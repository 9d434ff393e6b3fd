"""References: how fast to go, and where to: along a path, or at a heading."""

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
"""Time [s], a number or an array -> a speed [m/s] or a heading [rad], likewise."""
SpeedProfile = Profile
HeadingProfile = Profile


@dataclass(frozen=True)
class Constant:
    """The same at all times."""

    value: float

    def __post_init__(self) -> None:
        _require_finite(self)

    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the value at times of any shape [s]."""
        return np.full(np.shape(t), float(self.value))


@dataclass(frozen=True)
class Steps:
    """Values that change in steps.

    Attributes
    ----------
    first : float
        Value before the first step.
    times : tuple of float
        Of the steps, growing [s].
    values : tuple of float
        From each of them on.
    """

    first: float
    times: tuple[float, ...]
    values: tuple[float, ...]

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
        # A time that is a step's but for rounding is after it.
        since = np.searchsorted(np.array(self.times) - 1e-9, np.asarray(t, dtype=float), side="right")
        return np.array([self.first, *self.values])[since]


@dataclass(frozen=True)
class Sine:
    """mean + amplitude sin(2 pi t / period)."""

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
    """What the worm is to do.

    Attributes
    ----------
    speed : callable
        Time [s] -> speed forward, along the path if there is one [m/s]; takes arrays.
    heading : callable, optional
        Time [s] -> heading [rad]; takes arrays.
    path : Path, optional

    Raises
    ------
    ValueError
        Both a heading and a path, or something that is neither.
    """

    speed: SpeedProfile
    heading: HeadingProfile | None = None
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


def _require_finite(profile: Constant | Sine) -> None:
    for field in fields(profile):
        arguments.number(field.name, getattr(profile, field.name))
