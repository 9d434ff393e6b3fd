"""Estimation of the noise of the centre of mass samples from the innovations.

The innovations e_k of a filter are the differences between samples and predictions. If the model is correct, they are
uncorrelated. With the predicted variance H P H^T (`control.estimation.kalman`) and the noise R of a sample,

    E (e_k - e_{k-1}) (e_k - e_{k-1})^T = 2 (H P H^T + R).                                                    (KF8)

Errors of the model change little from one sample to the next, so that they cancel in the difference. If both
coordinates have the variance S, |e_k - e_{k-1}|^2 / 2 is S times a chi-squared number with 2 degrees of freedom, whose
median is 2 ln 2. Here S is estimated from the median, because the median, unlike the mean, is robust against a few
wrong samples.
"""

from __future__ import annotations

from collections import deque
from itertools import islice
from math import log, sqrt

from worm3d.values.arrays import FloatArray

NOISE_WINDOW, NOISE_LATEST = 400, 50
"""Maximum number of samples for the estimate of the noise (20 s of the default sensors), and number of latest samples
that are checked for a change. 400 samples give the noise to 4 %, 50 samples to 11 %."""
NOISE_LEAST = 8
"""Number of samples below which the noise is not estimated."""
NOISE_CHANCE = 8.0
"""Relative error of the variance that is attributed to chance, multiplied by the square root of the number of samples.
It is five standard errors of (KF8). One standard error is 1.6 on this scale."""


class Noise:
    """Noise of the samples of the centre of mass, by (KF8).

    `deviation` is the present estimate of its standard deviation [m].

    The estimate equals `told`, the stated noise, unless the samples show significantly more or less noise. It is
    limited by `least` and `most` [m]. It uses up to `NOISE_WINDOW` of the latest samples, as far back as their noise
    was the same.
    """

    def __init__(self, told: float, most: float, least: float = 0.0) -> None:
        self.told, self._most, self._least = told, max(told, most), min(told, least)
        self.deviation = told
        self._last: FloatArray | None = None
        self._found: deque[tuple[float, float]] = deque(maxlen=NOISE_WINDOW)

    def learn(self, innovation: FloatArray, spread: float) -> None:
        """Add the innovation of the next sample, shape (2,) [m], and the predicted variance of the sample [m^2]."""
        if self._last is not None:
            change = innovation - self._last
            self._found.append((0.5 * float(change @ change), spread))
        self._last = innovation
        if len(self._found) >= NOISE_LEAST:
            variance, spread, chance = self._recent()
            by_chance = abs(variance - self.told**2) <= chance * (self.told**2 + spread)
            found = sqrt(max(variance, self._least**2))
            self.deviation = self.told if by_chance else min(found, self._most)

    def _recent(self) -> tuple[float, float, float]:
        """Return `_variance` of all samples. If the noise of the latest samples differs, drop the older samples."""
        found = before, spread, _ = self._variance(len(self._found))
        if len(self._found) > NOISE_LATEST:
            now = latest, _, chance = self._variance(NOISE_LATEST)
            if abs(latest - before) > chance * (max(min(latest, before), 0.0) + spread):
                while len(self._found) > NOISE_LATEST:
                    self._found.popleft()
                return now
        return found

    def _variance(self, count: int) -> tuple[float, float, float]:
        """Return the measured and the predicted variance of the latest samples [m^2].

        The third result is the relative error of the measured variance due to chance.
        """
        latest = islice(reversed(self._found), count)
        half, spread = (sorted(each)[count // 2] for each in zip(*latest, strict=True))
        return half / (2.0 * log(2.0)) - spread, spread, NOISE_CHANCE / sqrt(count)
