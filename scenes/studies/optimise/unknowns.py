"""Unknowns of a gait as coordinates of about the same scale, for a search.

A segment has the coordinates phase, duty, root of the sharpness, and weight (PG2) of `control.gaits.periodic`. If the
worm is to turn, phase and weight of a segment differ between left and right. A simple gait has the same shape in all
segments. Its coordinates are the number of waves on the body, negative for direct waves, the duty, the root of the
sharpness, and, if the worm is to turn, the weight of the right side, negative if the right side moves half a period
after the left side. Keys of the scene, such as worm.spring_N, can be further coordinates. All coordinates but phases
are between 0 and 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from control.gaits.periodic import Periodic
from scenes.language.errors import SceneError
from scenes.language.toml import value as toml_value
from worm3d.values.arrays import FloatArray

WAVES, DUTY, GREATEST_SHARPNESS = (-2.0, 3.0), (0.1, 0.9), 12.0
"""Ranges of the number of waves on the body and of the duty, and greatest sharpness. Larger numbers of waves are
aliases of smaller ones in a worm with six segments; sharper waves are nearly square."""


PHASE_UNIT = 0.3
"""Phase of a coordinate of 1 [periods]. In 888 runs, the default worm reaches 0.141 and 0.147 BL/s (two seeds), 0.135
with a unit of 1, and 0.143 and 0.140 with 0.5."""


@dataclass(frozen=True)
class Free:
    """A key of the scene that is searched between two values."""

    key: str
    low: float
    high: float

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate between 0 and 1. A positive range of a decade or more is logarithmic."""
        if self.low > 0.0 and self.high >= 10.0 * self.low:
            return float(self.low * (self.high / self.low) ** coordinate)
        return float(self.low + coordinate * (self.high - self.low))


def free_of(text: str) -> Free:
    """Return the free key of a text such as `worm.spring_N=5:50`; SceneError for a text of another form."""
    key, _, values = text.partition("=")
    low, _, high = values.partition(":")
    try:
        found = Free(key.strip(), float(low), float(high))
    except ValueError:
        found = Free("", math.nan, math.nan)
    if not (found.key and found.low < found.high and math.isfinite(found.high - found.low)):
        raise SceneError(f"--over: got '{text}', must be a key and its range, such as worm.spring_N=5:50")
    return found


@dataclass(frozen=True)
class Choice:
    """A candidate: a gait, and changes of the scene as overrides."""

    gait: Periodic
    changes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Space:
    """Coordinates of the gaits of a worm."""

    segments: int
    amplitude: float
    period: float
    turns: bool = False
    free: tuple[Free, ...] = ()

    @property
    def simple_size(self) -> int:
        """Number of coordinates of a simple gait."""
        return 3 + self.turns + len(self.free)

    @property
    def bounds(self) -> tuple[list[float | None], list[float | None]]:
        """Least and greatest value of each coordinate of a gait; None for a phase."""
        phases = self.segments * (1 + self.turns)
        rest = self.segments * (3 + self.turns) + len(self.free)
        return [None] * phases + [0.0] * rest, [None] * phases + [1.0] * rest

    def spread(self, simple: FloatArray) -> FloatArray:
        """Return the coordinates of a simple gait in the space of all gaits, shape (size,).

        The argument has the shape (simple_size,).
        """
        waves, right = WAVES[0] + simple[0] * (WAVES[1] - WAVES[0]), 1.0
        phase = waves * (np.arange(self.segments) + 0.5)[:, None] / self.segments
        if self.turns:
            right = 2.0 * simple[3] - 1.0
            phase = phase + np.array([0.0, 0.5 if right < 0.0 else 0.0])
        weight = np.array([1.0, abs(right)])[: 1 + self.turns]
        alike = [np.full(self.segments, simple[1]), np.full(self.segments, simple[2]), np.tile(weight, self.segments)]
        return np.concatenate([phase.ravel() / PHASE_UNIT, *alike, simple[3 + self.turns :]])

    def choice(self, at: FloatArray) -> Choice:
        """Return the candidate at coordinates, shape (size,)."""
        sides, n = 1 + self.turns, self.segments
        shape = (n, sides) if self.turns else (n,)
        phase, duty, root, weight, rest = np.split(at, np.cumsum([n * sides, n, n, n * sides]))
        gait = Periodic(
            amplitude=self.amplitude,
            period=self.period,
            waves=0.0,
            phase=np.mod(PHASE_UNIT * phase, 1.0).reshape(shape),
            duty=DUTY[0] + (DUTY[1] - DUTY[0]) * duty,
            sharpness=GREATEST_SHARPNESS * root**2,
            weight=weight.reshape(shape),
        )
        return Choice(gait, self.changes(rest))

    def changes(self, at: FloatArray) -> tuple[str, ...]:
        """Return the overrides of the free keys at their coordinates, shape (len(free),)."""
        return tuple(f"{each.key}={toml_value(each.value(x))}" for each, x in zip(self.free, at, strict=True))
