"""Gate for measurements, which refuses and counts impossible samples.

A sample is used if it has the correct shape, is finite and lies within the limits of the quantity. The instant of the
sample must be known, not in the future, not too old, and different from the instants of earlier samples. If a number
stays the same to the last bit for longer than is possible in a moving worm, the sensor is assumed to be frozen.

If only some numbers of a sample are valid, the others become NaN, provided that the quantity allows this. Strains need
valid numbers in most segments. A centre of mass needs x and y, but not the height.

Errors within the limits are handled statistically (`control.estimation.kalman`, `control.estimation.ground`).
"""

from __future__ import annotations

from collections import Counter
from enum import Enum
from typing import Any

import numpy as np

from control.sensing.sensors import QUANTITIES, Measurement, Sample
from worm3d import Observation, Worm
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray

SPAN = 2.0
"""Age beyond which a sample is not used [s]. If a sensor has a stated delay, the delay is added."""
CLOCK_TOLERANCE = 1e-6
"""A time stamp may be later than the clock by up to this time, because of rounding [s]."""


class Refusal(Enum):
    """Reason why a sample is not used. The value completes the sentence "the sample came ..."."""

    SHAPE = "of another shape, or no numbers"
    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "out of range"
    NO_TIME = "of no known instant"
    FUTURE = "of an instant to come"
    TOO_OLD = "too old"
    AGAIN = "a second time"
    OUT_OF_ORDER = "after later ones"
    FROZEN = "unchanged for too long, while the worm was to move"


class Gate:
    """Gate for the measurements of one worm. It refuses samples that are older than `span` [s].

    `refused[channel, reason]` counts the samples of a channel that were refused, wholly or in part, for a reason.
    `first[channel, reason]` is the time of the first such refusal [s].
    """

    def __init__(self, worm: Worm, span: float = SPAN) -> None:
        self._span = span
        existing = {name: each for name, each in QUANTITIES.items() if each.exists(worm)}
        self._limits = {name: each.limits(worm) for name, each in existing.items()}
        self._shapes = {name: each.shape(worm) for name, each in existing.items()}
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self.refused: Counter[tuple[str, Refusal]] = Counter()
        self.first: dict[tuple[str, Refusal], float] = {}
        self._instants: dict[str, set[float]] = {name: set() for name in QUANTITIES}
        self._latest = dict.fromkeys(QUANTITIES, -np.inf)
        self._same: dict[str, tuple[FloatArray | float, FloatArray | float]] = {}

    def __call__(self, t: float, measurement: Measurement | Observation, moving: bool = False) -> Measurement:
        """Return the usable part of a measurement or an observation at time t [s]. TypeError for other types.

        `moving` is whether the worm is commanded to move. Constant values count as frozen only in a moving worm.
        """
        if not moving:
            self._same.clear()
        if isinstance(measurement, Observation):
            measurement = Measurement.exact(measurement, self._shapes)
        if not isinstance(measurement, Measurement):
            raise TypeError(
                f"measurement: got {type(measurement).__name__}, must be a control.sensing.sensors.Measurement; "
                "let sensors make it, as in worm3d.simulate(..., sensor=control.sensing.sensors.Sensors())"
            )
        passed = {name: self._passed(name, t, sample) for name, sample in measurement.items()}
        changed = {name: sample for name, sample in passed.items() if sample is not measurement[name]}
        return measurement.changed(**changed) if changed else measurement

    def _passed(self, name: str, t: float, sample: Sample) -> Sample:
        if sample.value is None:
            return sample
        value, refusal = None, self._mistimed(name, t, sample.time)
        if refusal is None:
            value, refusal = self._checked(name, sample.value)
            if value is not None:
                value, refusal = self._changing(name, value, float(sample.time), refusal)
        if refusal is not None:
            self.refused[name, refusal] += 1
            self.first.setdefault((name, refusal), t)
        if value is not None:
            self._remember(name, t, float(sample.time))
        return sample if value is sample.value else Sample(value, sample.time)

    def _mistimed(self, name: str, t: float, instant: Any) -> Refusal | None:
        if not (isinstance(instant, int | float | np.integer | np.floating) and -np.inf < instant < np.inf):
            return Refusal.NO_TIME
        if instant > t + CLOCK_TOLERANCE:
            return Refusal.FUTURE
        if instant < t - self._span:
            return Refusal.TOO_OLD
        if instant in self._instants[name]:
            return Refusal.AGAIN
        return Refusal.OUT_OF_ORDER if QUANTITIES[name].ordered and instant < self._latest[name] else None

    def _remember(self, name: str, t: float, instant: float) -> None:
        self._latest[name] = instant
        if len(self._instants[name]) >= 1000:
            self._instants[name] = {each for each in self._instants[name] if each >= t - self._span}
        self._instants[name].add(instant)

    def _changing(self, name: str, value: Any, instant: float, refusal: Refusal | None) -> tuple[Any, Refusal | None]:
        """Return the part of a sample that is not frozen, and the refusal.

        The part is None if too few numbers are left.
        """
        numbers = np.asarray(value)
        last, since = self._same.get(name, (np.nan, instant))
        since = np.where(numbers == last, since, instant)
        self._same[name] = numbers, since
        frozen = instant - since > QUANTITIES[name].may_stay
        if numbers.ndim < 2:  # one instrument: a worm may crawl along an axis
            frozen = np.full(numbers.shape, frozen.all())
        if not frozen.any():
            return value, refusal
        right = np.isfinite(numbers) & ~frozen
        return np.where(right, numbers, np.nan) if QUANTITIES[name].is_enough(right) else None, Refusal.FROZEN

    def _checked(self, name: str, value: Any) -> tuple[Any, Refusal | None]:
        """Return the valid part of a sample, and the refusal.

        The part is None if too few numbers are left.
        """
        try:
            numbers = arguments.floats(name, value)
        except ValueError:
            return None, Refusal.SHAPE
        if numbers.shape != self._shapes.get(name):
            return None, Refusal.SHAPE
        low, high = self._limits[name]
        flat = numbers.ravel()
        if np.vdot(flat, flat) <= min(low**2, high**2):  # quick; false where any is NaN
            return value if isinstance(value, np.ndarray | float) else numbers, None
        right = (numbers >= low) & (numbers <= high) & np.isfinite(numbers)
        if right.all():
            return numbers, None
        refusal = Refusal.OUT_OF_RANGE if np.isfinite(numbers).all() else Refusal.NOT_FINITE
        return np.where(right, numbers, np.nan) if QUANTITIES[name].is_enough(right) else None, refusal
