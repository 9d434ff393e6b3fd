"""References: speed, path or heading, bounds beside the path, and the end of the path."""

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
"""Function of the time [s], a number or an array, that gives as many speeds [m/s] or headings [rad]."""


@dataclass(frozen=True)
class Constant(Spelled):
    """A profile that is the same at all times."""

    value: float

    def __post_init__(self) -> None:
        _require_finite(self)

    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the value at times of any shape [s]."""
        return np.full(np.shape(t), float(self.value))


@dataclass(frozen=True)
class Steps(Spelled):
    """A profile that changes in steps."""

    first: float
    """Value before the first step."""
    times: tuple[float, ...]
    """Times of the steps, growing [s]."""
    values: tuple[float, ...]
    """Value from each step on."""

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
    """Demands on the worm: a speed, and at most one of heading and path; they apply to the centre of mass.

    Raises
    ------
    ValueError
        Both heading and path; an end, a corridor or obstacles without a path that can have them.
    """

    speed: Profile
    """Time [s] -> speed forward, along the path if there is one, below 0 backwards [m/s]; takes arrays."""
    heading: Profile | None = None
    """Time [s] -> heading [rad]; takes arrays."""
    path: Path | None = None
    ends: bool = False
    """Whether the worm stops at the end of the path and stays there; backwards, at the start of the path."""
    corridor: float = math.inf
    """Greatest distance to either side of the path [m]."""
    obstacles: tuple[Obstacle, ...] = ()
    """Obstacles for the way around, from the start of the path on; `control.tracking.search` finds the way."""
    walled: bool = False
    """Whether walls keep the worm to its path, so that steering against them only costs speed."""

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
        """Return the depths of places (..., 2), `beyond` (...) the corridor, in the forbidden region, (...) [m].

        The forbidden region is the inside of obstacles and the outside of the corridor. A negative depth is the
        distance from this region, infinite without obstacles and corridor.
        """
        return np.asarray(np.max([beyond, *(-each.distances(places) for each in self.obstacles)], axis=0))


def _require_finite(profile: Constant | Sine) -> None:
    for field in fields(profile):
        arguments.number(field.name, getattr(profile, field.name))
