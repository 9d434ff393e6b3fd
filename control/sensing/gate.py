"""The gate for measurements: what cannot be a sample of this worm, now, is refused and counted.

A sample is used if it has the right shape, is finite and within the range of its quantity, and is of an instant that is
known, not ahead of the clock, not further back than anything remembers, and not that of a sample that came before. What
is right in part is used in part: strains that cannot be become NaN as long as most segments have one, and a centre of
mass of which only the height cannot be keeps its place, with NaN as its height.

Errors that lie within the range are a matter of statistics (`control.estimation.kalman`, `control.estimation.ground`).
"""

from __future__ import annotations

from collections import Counter
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.sensing.measurement import Measurement
from worm3d import Worm
from worm3d.values.arrays import FloatArray

SPAN = 2.0
"""Age beyond which a sample is not used, unless the sensors are known to be slower [s]."""

AHEAD = 1e-6
"""Time by which a stamp may be ahead of the clock for rounding [s]."""

FARTHEST = 1e7
"""Greatest magnitude of a coordinate [m]: more than any grid on earth has."""

TURNS = 1e4
"""Greatest magnitude of a heading [rad]; sensors may count whole turns."""

KEPT = 1000
"""Instants that are kept of a channel before old ones are dropped."""


class Refusal(Enum):
    """Why a sample is not used; the value goes on after its name."""

    SHAPE = "of another shape, or no numbers"
    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "out of range"
    NO_TIME = "of no known instant"
    FUTURE = "of an instant to come"
    TOO_OLD = "too old"
    AGAIN = "a second time"
    OUT_OF_ORDER = "after later ones"


class Gate:
    """The gate for the measurements of one worm.

    Parameters
    ----------
    worm : Worm
    span : float
        Age beyond which a sample is not used [s].

    Attributes
    ----------
    refused : Counter of (str, Refusal)
        Samples that were refused, in whole or in part, by channel and reason.
    first : dict of (str, Refusal) to float
        When that was for the first time [s].
    """

    def __init__(self, worm: Worm, span: float = SPAN) -> None:
        self._segments, self._span = worm.segments, span
        longest = 2.0 * float(np.max(worm.link_length / worm.l0))  # of a chamber that is pressed flat
        self._ranges = {"strain": (-1.0, longest), "com": (-FARTHEST, FARTHEST), "heading": (-TURNS, TURNS)}
        self._shapes: dict[str, tuple[int, ...]] = {"strain": (worm.segments, 2), "com": (3,), "heading": ()}
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self.refused: Counter[tuple[str, Refusal]] = Counter()
        self.first: dict[tuple[str, Refusal], float] = {}
        self._seen: dict[str, set[float]] = {name: set() for name in self._shapes}
        self._last_strain = -np.inf

    def __call__(self, t: float, measurement: Measurement) -> Measurement:
        """Return what can be used at time t [s] of a measurement.

        Raises
        ------
        TypeError
            It is no `Measurement`.
        """
        if not isinstance(measurement, Measurement):
            raise TypeError(
                f"measurement: got {type(measurement).__name__}, must be a control.sensing.measurement.Measurement; "
                "let sensors make it, as in worm3d.simulate(..., sensor=control.sensing.sensors.Sensors())"
            )
        strain = self._used("strain", t, measurement.strain, measurement.strain_time)
        com = self._used("com", t, measurement.com, measurement.com_time)
        heading = self._used("heading", t, measurement.heading, measurement.heading_time)
        if strain is measurement.strain and com is measurement.com and heading is measurement.heading:
            return measurement
        return Measurement(
            measurement.time,
            strain,
            measurement.strain_time,
            com,
            measurement.com_time,
            None if heading is None else float(heading),
            measurement.heading_time,
        )

    def _used(self, name: str, t: float, sample: Any, instant: Any) -> Any:
        """Return a sample, or what is right of it, or None."""
        if sample is None:
            return None
        complaint = self._mistimed(name, t, instant)
        if complaint is None:
            sample, complaint = self._checked(name, sample)
        else:
            sample = None
        if complaint is not None:
            self.refused[name, complaint] += 1
            self.first.setdefault((name, complaint), t)
        if sample is not None:
            self._remember(name, t, float(instant))
        return sample

    def _mistimed(self, name: str, t: float, instant: Any) -> Refusal | None:
        """Return what is wrong with the instant of a sample."""
        if not _is_number(instant):
            return Refusal.NO_TIME
        if instant > t + AHEAD:
            return Refusal.FUTURE
        if instant < t - self._span:
            return Refusal.TOO_OLD
        if instant in self._seen[name]:
            return Refusal.AGAIN
        # The wave in the strains is smoothed as they come: a late one says nothing that is not known better.
        return Refusal.OUT_OF_ORDER if name == "strain" and instant < self._last_strain else None

    def _remember(self, name: str, t: float, instant: float) -> None:
        if name == "strain":
            self._last_strain = instant
        seen = self._seen[name]
        if len(seen) >= KEPT:
            self._seen[name] = seen = {each for each in seen if each >= t - self._span}
        seen.add(instant)

    def _checked(self, name: str, sample: Any) -> tuple[Any, Refusal | None]:
        """Return what is right of a sample, None if that is too little, and what is wrong with it."""
        low, high = self._ranges[name]
        values = _numbers(sample)
        if values is None or values.shape != self._shapes[name]:
            return None, Refusal.SHAPE
        flat = values.ravel()
        if np.vdot(flat, flat) <= min(low**2, high**2):  # quick; false where any is NaN
            return sample if isinstance(sample, np.ndarray | float) else values, None
        finite = np.isfinite(values)
        right = finite & (np.where(finite, values, 0.0) >= low) & (np.where(finite, values, 0.0) <= high)
        if right.all():
            return values, None
        complaint = Refusal.OUT_OF_RANGE if finite.all() else Refusal.NOT_FINITE
        return np.where(right, values, np.nan) if self._is_enough(name, right) else None, complaint

    def _is_enough(self, name: str, right: NDArray[np.bool_]) -> bool:
        """Return whether a sample can be used in part."""
        if name == "strain":
            return 2 * int(right.any(axis=1).sum()) > self._segments
        return name == "com" and bool(right[:2].all())


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and bool(-np.inf < value < np.inf)


def _numbers(sample: Any) -> FloatArray | None:
    """Return a sample as an array of floats, if that is what it is."""
    if isinstance(sample, np.ndarray) and sample.dtype == np.float64:
        return sample
    try:
        array = np.asarray(sample)
        return array.astype(float) if array.dtype.kind in "iuf" else None
    except (TypeError, ValueError, OverflowError):
        return None
