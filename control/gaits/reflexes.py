"""Reflexes, which change the commands of a gait depending on the load and strain of the segments.

A reflex changes the contraction of each segment that the gait, or the previous reflex, commands. It changes both sides
of a segment by the same amount, so that it neither steers nor removes steering. `Reflexive` (`control.gaits.reflexive`)
adds reflexes to any gait.

In the formulas, w is the contraction before the reflex (the mean of a segment's sides), c the contraction after it, and
F the load on the segment (the sum over its apexes), all as functions of time.

`WallLoad`, with the threshold F* and the least contraction of the worm's stroke c_min:

    c = w - e;   e' = rate min(F/F* - 1, 1)  where F >= F*,  -recovery (1 - F/F*)  else;   0 <= e <= w - c_min    (GR1)

A segment that presses hard enough therefore does not widen further, and it gives way to a greater load. It gives way no
faster than `rate`. Otherwise a worm that starts wedged, with many times the load, would lose the wall. The segment
begins to release as soon as the contraction of the wave decreases, and not only when w has decreased to c. Therefore
anchors hold as long in a narrow pipe as in a wide pipe, the steps of the worm are as long, and groups of anchors do not
pull against each other. When w has decreased to c_min, e is 0 again, and the segment then widens with the wave.

`Reach`, with the load F0 that counts as contact:

    c = w (1 + e);   e' = 1/time  where w > 0 and F < F0,   -1/time where w <= 0,   else 0;   0 <= e <= most  (GR2)

`Wait`, with the strain s_j of the neighbour j that contracts next. If w decreases and the neighbour should be more
contracted than this segment, but is not yet, -s_j < share w_j, the segment does not let go, c' = 0, for at most
`patience`. After that the segment catches up with w in the same time. (GR3)

To add a reflex, derive a dataclass from `Reflex` with the name for scenes, `class Mine(Reflex, name="mine")`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from control.gaits.feedback import Felt
from control.gaits.gait import Direction
from worm3d import Worm
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.spelling import Spelled

REFLEXES: dict[str, type[Reflex]] = {}
"""Class of each reflex, by the name used in scenes."""

GRAVITY = 9.81
"""Acceleration of gravity. Default thresholds are multiples of the worm's weight or of a segment's weight [m/s^2]."""

TOUCH = 0.25
"""Default load above which a segment is in contact, in weights of a segment."""


class ReflexMemory(Protocol):
    """State of a reflex during one run."""

    def step(self, t: float, wanted: FloatArray, felt: Felt) -> FloatArray:
        """Advance to time t [s] and return the contraction of the chambers [left, right], shape (N, 2).

        `wanted` is the contraction before the reflex, of the same shape. The first call sets the start time of the
        memory.
        """


@dataclass(frozen=True)
class Reflex(Spelled, ABC):
    """A change of the commanded contraction that depends on sensors. Subclasses are registered under their `name`."""

    senses: ClassVar[tuple[str, ...]]
    """Names of the channels of `control.sensing.QUANTITIES` that the reflex uses."""
    name: ClassVar[str] = ""

    def __init_subclass__(cls, name: str = "") -> None:
        known = REFLEXES.get(name)
        if known is not None and (known.__module__, known.__qualname__) != (cls.__module__, cls.__qualname__):
            raise ValueError(f"name: got {name!r}, must be another than those of the reflexes that there are")
        if name:
            cls.name, REFLEXES[name] = name, cls

    def __post_init__(self) -> None:
        check(self)

    @abstractmethod
    def start(self, worm: Worm) -> ReflexMemory:
        """Return the initial memory for one run of a worm."""


class _Segmentwise:
    """Memory that changes the mean contraction of each segment.

    `advanced(dt, wanted, felt)` returns the contraction of the segments, shape (N,), `dt` [s] after the previous call.
    `wanted` is the contraction before the reflex, shape (N,).
    """

    def __init__(self, advanced: Callable[[float, FloatArray, Felt], FloatArray]) -> None:
        self._advanced, self._time = advanced, np.nan

    def step(self, t: float, wanted: FloatArray, felt: Felt) -> FloatArray:
        """Advance to time t [s] and return the contraction of the chambers, shape (N, 2)."""
        mean = wanted.mean(axis=1)
        dt = 0.0 if np.isnan(self._time) else t - self._time
        self._time = t
        return np.asarray(wanted + (self._advanced(dt, mean, felt) - mean)[:, None])


def load_of(felt: Felt) -> FloatArray:
    """Return the load on each segment, the sum over the segment's apexes, shape (N,) [N]."""
    return np.asarray(felt["contact_load"].sum(axis=1))


@documented
@dataclass(frozen=True, kw_only=True)
class WallLoad(Reflex, name="wall_load"):
    """A segment that presses hard against the wall stops widening, (GR1).

    The default threshold suits worms that must hold their own weight, as in steep pipes. If the weight rests on the
    ground, a lower threshold causes less slip.
    """

    load: float | None = parameter(
        None,
        meaning="load at which a segment stops widening",
        unit="N",
        gt=0,
        left_out="12 times the worm's weight",
    )
    rate: float = parameter(10.0, meaning="speed of release of a segment with at least twice the load", gt=0)
    recovery: float = parameter(
        1.0, meaning="speed of the return of an unloaded segment to the wanted contraction", ge=0
    )
    senses = ("contact_load",)

    def start(self, worm: Worm) -> ReflexMemory:
        """Return a fresh memory for one run of a worm."""
        most = 12.0 * worm.mass * GRAVITY if self.load is None else self.load
        less = np.zeros(worm.segments)

        def advanced(dt: float, wanted: FloatArray, felt: Felt) -> FloatArray:
            over = np.minimum(load_of(felt) / most - 1.0, 1.0)
            grown = less + np.where(over >= 0.0, self.rate, self.recovery) * over * dt
            less[:] = np.clip(grown, 0.0, np.maximum(0.0, wanted - worm.stroke[0]))
            return wanted - less

        return _Segmentwise(advanced)


@documented
@dataclass(frozen=True, kw_only=True)
class Reach(Reflex, name="reach"):
    """A segment that should be wide but touches nothing contracts further, (GR2)."""

    contact: float | None = parameter(
        None,
        meaning="load on a segment that counts as contact",
        unit="N",
        gt=0,
        left_out="a quarter of a segment's weight",
    )
    most: float = parameter(1.0, meaning="greatest further contraction, as a share of the wanted contraction", gt=0)
    time: float = parameter(0.3, meaning="time until the wanted contraction is doubled", unit="s", gt=0)
    senses = ("contact_load",)

    def start(self, worm: Worm) -> ReflexMemory:
        """Return a fresh memory for one run of a worm."""
        contact = TOUCH * worm.mass * GRAVITY / worm.segments if self.contact is None else self.contact
        further = np.zeros(worm.segments)

        def advanced(dt: float, wanted: FloatArray, felt: Felt) -> FloatArray:
            to_be_wide, touches = wanted > 0.0, load_of(felt) >= contact
            way = np.where(to_be_wide, np.where(touches, 0.0, 1.0), -1.0)
            further[:] = np.clip(further + way * dt / self.time, 0.0, self.most)
            return np.where(to_be_wide, wanted * (1.0 + further), wanted)

        return _Segmentwise(advanced)


@documented
@dataclass(frozen=True, kw_only=True)
class Wait(Reflex, name="wait"):
    """A segment does not let go before the segment that contracts next has contracted, (GR3)."""

    share: float = parameter(0.5, meaning="sufficient share of the wanted contraction of the neighbour", gt=0, le=1)
    patience: float = parameter(0.5, meaning="longest wait of a segment", unit="s", gt=0)
    towards: Direction = parameter(
        "retrograde",
        meaning="direction of the gait's waves: retrograde, the next segment is behind; direct, it is ahead",
    )
    senses = ("strain",)

    def start(self, worm: Worm) -> ReflexMemory:
        """Return a fresh memory for one run of a worm."""
        return _Segmentwise(_Waiting(self, worm.segments))


class _Waiting:
    def __init__(self, asked: Wait, segments: int) -> None:
        self._share, self._patience = asked.share, asked.patience
        self._next = np.arange(segments) + (-1 if asked.towards == "retrograde" else 1)
        self._has_next = (self._next >= 0) & (self._next < segments)
        self._next = np.clip(self._next, 0, segments - 1)
        self._given, self._wanted = np.full(segments, -np.inf), np.full(segments, np.inf)
        self._waited, self._excess = np.zeros(segments), np.zeros(segments)

    def __call__(self, dt: float, wanted: FloatArray, felt: Felt) -> FloatArray:
        reached = -felt["strain"].mean(axis=1)
        next_wanted = wanted[self._next]
        is_late = self._has_next & (next_wanted > wanted) & (reached[self._next] < self._share * next_wanted)
        lets_go = wanted < self._given
        waits = lets_go & is_late & (self._waited < self._patience)
        self._waited = np.where(waits, self._waited + dt, np.where(lets_go & is_late, self._waited, 0.0))
        left = np.maximum(0.0, self._given - wanted) if np.isfinite(self._given).all() else np.zeros_like(wanted)
        falling = left * max(0.0, 1.0 - 3.0 * dt / self._patience)  # no jump when the wait ends
        catching = (self._excess > 0.0) & ~waits
        self._excess = np.where(waits, left, np.where(catching, np.minimum(self._excess, falling), 0.0))
        self._excess[self._excess < 1e-6] = 0.0
        self._given = wanted + self._excess
        return self._given
