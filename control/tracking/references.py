"""References: the requested speed, path or heading, the bounds beside the path, and the end of the path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from control.tracking.obstacles import Disc as Disc
from control.tracking.obstacles import Obstacle
from control.tracking.paths import Path
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import Spelled

Profile = Callable[[Any], Any]
"""Function of time [s] that returns speeds [m/s] or headings [rad], for a number or an array of times."""


@dataclass(frozen=True)
class Constant(Spelled):
    """A profile with a constant value."""

    value: float

    def __post_init__(self) -> None:
        _require_finite(self)

    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the value at times of any shape [s]."""
        return np.full(np.shape(t), float(self.value))


@dataclass(frozen=True)
class Steps(Spelled):
    """A profile that is constant between steps."""

    first: float
    """Value before the first step."""
    times: tuple[float, ...]
    """Times of the steps, in increasing order [s]."""
    values: tuple[float, ...]
    """Values after the steps."""

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
        # A time that equals the time of a step, within rounding, is after the step.
        since = np.searchsorted(np.array(self.times) - 1e-9, np.asarray(t, dtype=float), side="right")
        return np.array([self.first, *self.values])[since]


@dataclass(frozen=True)
class Sine(Spelled):
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
class Reference(Spelled):
    """Requested motion of the centre of mass: a speed, and either a path, a heading, or neither.

    Raises
    ------
    ValueError
        Both a heading and a path are given. Or an end, a corridor or obstacles are given without a path that can have
        them.
    """

    speed: Profile
    """Function of time [s] that returns the forward speed, along the path if there is one [m/s]. It is negative for
    backward motion. Times may be arrays."""
    heading: Profile | None = None
    """Function of time [s] that returns the heading [rad]. Times may be arrays."""
    path: Path | None = None
    ends: bool = False
    """Whether the worm stops at the end of the path and stays there. When it goes backwards, it stops at the start of
    the path."""
    corridor: float = math.inf
    """Greatest allowed distance from the path, on either side [m]."""
    obstacles: tuple[Obstacle, ...] = ()
    """Obstacles that the worm must avoid. `control.tracking.search` finds a way around them."""
    walled: bool = False
    """Whether walls keep the worm on its path. Steering against the walls would only reduce the speed."""

    def __post_init__(self) -> None:
        if self.heading is not None and self.path is not None:
            raise ValueError("heading, path: got both, must be at most one: a path has headings of its own")
        profile = "a function of time: control.tracking.references.Constant(0.08)"
        arguments.function("speed", self.speed, profile)
        if self.heading is not None:
            arguments.function("heading", self.heading, profile)
        arguments.instance("path", self.path, Path | None, "a path, as control.tracking.paths.Line()")
        self._check_bounds()

    def _check_bounds(self) -> None:
        arguments.flag("ends", self.ends)
        arguments.number("corridor", self.corridor, "m", gt=0.0, infinite=True)
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        for k, obstacle in enumerate(self.obstacles):
            what = "an obstacle, as control.tracking.obstacles.Disc(1.0, 0.0, 0.2)"
            arguments.instance(f"obstacles[{k}]", obstacle, Obstacle, what)
        asked = [name for name in ("ends", "obstacles") if getattr(self, name)]
        asked += ["corridor"] if math.isfinite(self.corridor) else []
        if self.path is None and asked:
            raise ValueError(f"{asked[0]}: got one without a path, must be left out")
        if self.ends and self.path is not None and (self.path.closed or not math.isfinite(self.path.length)):
            raise ValueError(
                "ends: got true for a path without end; give it a length (reference.length_m of a line), "
                "or one that is not closed"
            )

    def trespass(self, places: FloatArray, beyond: FloatArray) -> FloatArray:
        """Return how deep places lie in the forbidden region, shape (...) [m].

        The forbidden region is the inside of obstacles and the outside of the corridor. `places` has the shape (..., 2)
        [m], and `beyond` is the distance of the places outside the corridor, shape (...) [m]. A negative result is the
        distance from the region. It is minus infinity if there are neither obstacles nor a corridor.
        """
        return np.asarray(np.max([beyond, *(-each.distances(places) for each in self.obstacles)], axis=0))


def _require_finite(profile: Constant | Sine) -> None:
    for field in fields(profile):
        arguments.number(field.name, getattr(profile, field.name))
