"""Noise of samples of the centre of mass, estimated from the innovations.

The innovations e_k of a filter with a correct model are uncorrelated. With the predicted variance H P H^T
(`control.estimation.kalman`) and the noise R of a sample,

    E (e_k - e_{k-1}) (e_k - e_{k-1})^T = 2 (H P H^T + R).                                                    (KF8)

Model errors change little from one sample to the next and cancel. For two coordinates with equal variances S,
|e_k - e_{k-1}|^2 / 2 is S times a chi-squared number of 2 degrees of freedom, whose median is 2 ln 2. Unlike the mean,
the median is robust against a few wrong samples.
"""

from __future__ import annotations

from collections import deque
from itertools import islice
from math import log, sqrt

from worm3d.values.arrays import FloatArray

NOISE_WINDOW, NOISE_LATEST = 400, 50
"""Number of samples for the estimate of the noise, twenty seconds of the default sensors, and number of latest samples
for the detection of a change. 400 samples give the noise to 4 %, 50 samples to 11 %."""
NOISE_LEAST = 8
"""Number of samples below which the noise is not estimated."""
NOISE_CHANCE = 8.0
"""Error of the variance that is attributed to chance, times the square root of the number of samples, over the
variance: five standard errors of (KF8), each 1.6."""


class Noise:
    """Noise of samples of the centre of mass, by (KF8); `deviation` is the present estimate of the standard deviation.

    The noise equals `told` unless the samples show more or less noise, limited by `least` and `most` [m]. The estimate
    uses the latest samples of equal noise, up to `NOISE_WINDOW`.
    """

    def __init__(self, told: float, most: float, least: float = 0.0) -> None:
        self.told, self._most, self._least = told, max(told, most), min(told, least)
        self.deviation = told
        self._last: FloatArray | None = None
        self._found: deque[tuple[float, float]] = deque(maxlen=NOISE_WINDOW)

    def learn(self, innovation: FloatArray, spread: float) -> None:
        """Add the innovation (2,) of the next sample [m], and the variance of the expected value [m^2]."""
        if self._last is not None:
            change = innovation - self._last
            self._found.append((0.5 * float(change @ change), spread))
        self._last = innovation
        if len(self._found) >= NOISE_LEAST:
            self._forget()
            variance, spread, chance = self._variance(len(self._found))
            by_chance = abs(variance - self.told**2) <= chance * (self.told**2 + spread)
            found = sqrt(max(variance, self._least**2))
            self.deviation = self.told if by_chance else min(found, self._most)

    def _forget(self) -> None:
        """Drop old samples if the latest samples have a different noise."""
        if len(self._found) > NOISE_LATEST:
            before, spread, _ = self._variance(len(self._found))
            latest, _, chance = self._variance(NOISE_LATEST)
            if abs(latest - before) > chance * (max(min(latest, before), 0.0) + spread):
                while len(self._found) > NOISE_LATEST:
                    self._found.popleft()

    def _variance(self, count: int) -> tuple[float, float, float]:
        """Return the variance by the latest samples, the predicted variance [m^2], and the share due to chance."""
        latest = islice(reversed(self._found), count)
        half, spread = (sorted(each)[count // 2] for each in zip(*latest, strict=True))
        return half / (2.0 * log(2.0)) - spread, spread, NOISE_CHANCE / sqrt(count)
