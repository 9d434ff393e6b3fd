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
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from control.gaits.periodic import Periodic
from scenes.language.errors import SceneError
from scenes.language.toml import value as toml_value
from worm3d.values.arrays import FloatArray

WAVES, DUTY, GREATEST_SHARPNESS = (-2.0, 3.0), (0.1, 0.9), 12.0
"""Ranges of the number of waves on the body and of the duty, and greatest sharpness. Larger numbers of waves are
aliases of smaller ones in a worm with six segments; sharper waves are nearly square."""


CORRELATED = 1.0 / 3.0
"""Length along the body over which the correlation of the first steps of a search falls to 1/e [body lengths]. With
independent steps, the gain over simple gaits on a slope of 15 degrees is 1.14 and 1.02 (two seeds) in place of 1.21 and
1.17."""
SEGMENTS, EACH = "worm.segments", "each"
"""Key of the number of segments, and word for a key with a value of each segment."""
PHASE_UNIT = 0.3
"""Phase of a coordinate of 1 [periods]. In 888 runs, the default worm reaches 0.141 and 0.147 BL/s (two seeds), 0.135
with a unit of 1, and 0.143 and 0.140 with 0.5."""


@dataclass(frozen=True)
class Free:
    """A key of the scene that is searched between two values."""

    key: str
    low: float
    high: float
    each: bool = False
    """Whether each segment has its own value."""
    whole: bool = False
    """Whether the value is a whole number."""

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate between 0 and 1, with four digits.

        A positive range of a decade or more is logarithmic.
        """
        if self.whole:
            return min(math.floor(self.low + coordinate * (self.high - self.low + 1.0)), int(self.high))
        if self.low > 0.0 and self.high >= 10.0 * self.low:
            return float(f"{self.low * (self.high / self.low) ** coordinate:.4g}")
        return float(f"{self.low + coordinate * (self.high - self.low):.4g}")


def free_of(text: str) -> Free:
    """Return the free key of a text such as `worm.spring_N=5:50`; SceneError for a text of another form."""
    key, _, values = text.partition("=")
    low, high, *each = values.split(":") if values.count(":") in (1, 2) else ("", "")
    try:
        found = Free(key.strip(), float(low), float(high), each=bool(each))
    except ValueError:
        found = Free("", math.nan, math.nan)
    if not (found.key and found.low < found.high and math.isfinite(found.high - found.low)) or each not in ([], [EACH]):
        raise SceneError(
            f"--over: got '{text}', must be a key and its range, such as worm.spring_N=5:50, or "
            f"worm.spring_N=5:50:{EACH} for a value of each segment"
        )
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

    def inside(self, at: FloatArray) -> FloatArray:
        """Return coordinates, shape (size,), with all but the phases reflected into the range from 0 to 1."""
        phases = self.segments * (1 + self.turns)
        return np.concatenate([at[:phases], np.abs((at[phases:] + 1.0) % 2.0 - 1.0)])

    @cached_property
    def neighbourly(self) -> FloatArray:
        """Matrix, shape (size, size), that correlates independent numbers of variance 1 along the body."""
        place = np.arange(self.segments) / self.segments
        along = np.linalg.cholesky(np.exp(-np.abs(place[:, None] - place) / CORRELATED))
        both = np.kron(along, np.eye(1 + self.turns))
        rest = [along if each.each else np.eye(1) for each in self.free]
        return np.asarray(block_diag(both, along, along, both, *rest))

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
        free = np.repeat(simple[3 + self.turns :], self._sizes)
        return np.concatenate([phase.ravel() / PHASE_UNIT, *alike, free])

    def choice(self, at: FloatArray) -> Choice:
        """Return the candidate at coordinates, shape (size,).

        If the number of segments is free, the values of a segment are interpolated along the body.
        """
        sides, n = 1 + self.turns, self.segments
        shape = (n, sides) if self.turns else (n,)
        phase, duty, root, weight, rest = np.split(at, np.cumsum([n * sides, n, n, n * sides]))
        count, values = n, np.split(rest, np.cumsum(self._sizes))[:-1]
        for free, value in zip(self.free, values, strict=True):
            count = int(free.value(value[0])) if free.key == SEGMENTS else count
        gait = Periodic(
            amplitude=self.amplitude,
            period=self.period,
            waves=0.0,
            phase=np.mod(PHASE_UNIT * _along(phase.reshape(shape), count), 1.0),
            duty=DUTY[0] + (DUTY[1] - DUTY[0]) * _along(duty, count),
            sharpness=GREATEST_SHARPNESS * _along(root, count) ** 2,
            weight=_along(weight.reshape(shape), count),
        )
        changes = {
            free.key: [free.value(each) for each in _along(value, count)] if free.each else free.value(value[0])
            for free, value in zip(self.free, values, strict=True)
        }
        return Choice(gait, tuple(f"{key}={toml_value(value)}" for key, value in changes.items()))

    @property
    def _sizes(self) -> list[int]:
        """Number of coordinates of each free key."""
        return [self.segments if each.each else 1 for each in self.free]


def _along(values: FloatArray, count: int) -> FloatArray:
    """Return values along the body, shape (N, ...), interpolated for `count` segments, shape (count, ...)."""
    if len(values) == count:
        return values
    here = (np.arange(len(values)) + 0.5) / len(values)
    there = (np.arange(count) + 0.5) / count
    columns = [np.interp(there, here, column) for column in values.reshape(len(values), -1).T]
    return np.stack(columns, axis=1).reshape(count, *values.shape[1:])
