"""The noise of samples, as the innovations of a filter show it.

With the innovations e_k of a filter that knows its model, H P H^T what it is unsure of and R the noise of a sample,

    E (e_k - e_{k-1}) (e_k - e_{k-1})^T = 2 (H P H^T + R),                                                    (K8)

since innovations are uncorrelated. What the model misses changes little from one sample to the next and cancels out. Of
two coordinates with equal variances S, |e_k - e_{k-1}|^2 / 2 is S times a chi-squared number of 2 degrees of freedom,
the median of which is 2 ln 2; unlike the mean it does not mind a few wrong samples.
"""

from __future__ import annotations

from collections import deque
from math import log, sqrt

from worm3d.values.arrays import FloatArray

WINDOW = 100
"""Samples of which the noise is that of now: five seconds of the default sensors. With half of them the estimate is off
by 20 % of the noise, with twice as many it takes twice as long to follow."""

LEAST = 8
"""Samples without which nothing is said."""

BY_CHANCE = 4.0
"""Standard errors of the variance that are put down to chance: what was told is believed that far."""

ERROR = 1.6
"""Standard error of the variance by (K8), times the square root of the samples, over the variance."""


class Noise:
    """The standard deviation of the noise of a sample: what was told, or more if the innovations show more.

    Parameters
    ----------
    told : float
        [m]
    most : float
        Greatest estimate [m].

    Attributes
    ----------
    deviation : float
        Now [m].
    """

    def __init__(self, told: float, most: float) -> None:
        self.told, self._most = told, max(told, most)
        self.reset()

    def reset(self) -> None:
        """Begin anew, with what was told."""
        self.deviation = self.told
        self._last: FloatArray | None = None
        self._found: deque[tuple[float, float]] = deque(maxlen=WINDOW)

    def learn(self, innovation: FloatArray, spread: float) -> None:
        """Take in the innovation (2,) of the next sample [m] and the variance of what was expected of it [m^2]."""
        if self._last is not None:
            change = innovation - self._last
            self._found.append((0.5 * float(change @ change), spread))
        self._last = innovation
        if len(self._found) >= LEAST:
            self.deviation = self._estimate()

    def _estimate(self) -> float:
        count, middle = len(self._found), len(self._found) // 2
        half, spread = (sorted(each)[middle] for each in zip(*self._found, strict=True))
        variance = half / (2.0 * log(2.0)) - spread
        credible = self.told**2 * (1.0 + BY_CHANCE * ERROR / sqrt(count))
        return min(sqrt(variance), self._most) if variance > credible else self.told
