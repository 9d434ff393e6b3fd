"""Noise of samples of the centre of mass, as their innovations show it.

The innovations e_k of a filter that knows its model are uncorrelated, so that, with what it is unsure of, H P H^T
(`control.estimation.kalman`), and the noise R of a sample,

    E (e_k - e_{k-1}) (e_k - e_{k-1})^T = 2 (H P H^T + R).                                                    (KF8)

Model errors change little from one sample to the next and cancel. Of two coordinates with equal variances S,
|e_k - e_{k-1}|^2 / 2 is S times a chi-squared number of 2 degrees of freedom, the median of which is 2 ln 2; unlike
the mean it does not mind a few wrong samples.
"""

from __future__ import annotations

from collections import deque
from itertools import islice
from math import log, sqrt

from worm3d.values.arrays import FloatArray

NOISE_WINDOW, NOISE_LATEST = 400, 50
"""Number of samples from which their noise is estimated, twenty seconds of the default sensors, and of those that may
show that it has changed. From 400 it is known to 4 %, from 50 to 11 %."""
NOISE_LEAST = 8
"""Number of samples below which their noise is not estimated."""
NOISE_CHANCE = 8.0
"""Error of the variance that is put down to chance, times the square root of the number of samples, over the variance:
five standard errors of (KF8), each 1.6."""


class Noise:
    """Noise of samples of the centre of mass, by (KF8); `deviation` is the present estimate of its standard deviation.

    It is what is `told` unless the samples show that it is more or less, between the `least` and the `most` that is
    believed [m]. It follows from as many samples as are alike, up to `NOISE_WINDOW`.
    """

    def __init__(self, told: float, most: float, least: float = 0.0) -> None:
        self.told, self._most, self._least = told, max(told, most), min(told, least)
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self.deviation = self.told
        self._last: FloatArray | None = None
        self._found: deque[tuple[float, float]] = deque(maxlen=NOISE_WINDOW)

    def learn(self, innovation: FloatArray, spread: float) -> None:
        """Take in the innovation (2,) of the next sample [m], and the variance of its expected value [m^2]."""
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
        """Drop old samples if the latest are of another noise."""
        if len(self._found) > NOISE_LATEST:
            before, spread, _ = self._variance(len(self._found))
            latest, _, chance = self._variance(NOISE_LATEST)
            if abs(latest - before) > chance * (max(min(latest, before), 0.0) + spread):
                while len(self._found) > NOISE_LATEST:
                    self._found.popleft()

    def _variance(self, count: int) -> tuple[float, float, float]:
        """Return the variance by the latest samples, that of what they expected [m^2], and the share that is chance."""
        latest = islice(reversed(self._found), count)
        half, spread = (sorted(each)[count // 2] for each in zip(*latest, strict=True))
        return half / (2.0 * log(2.0)) - spread, spread, NOISE_CHANCE / sqrt(count)
