"""Whether an estimator knows how good it is: its innovations against what it expects of them.

If model and noise are right, the normalised innovation squared of a sample of d numbers is chi-squared distributed
with d degrees of freedom, independently of those before. The sum over n samples then is so with n d, and the mean

    nis = sum nis_k / n   lies in   [chi2^-1(0.025; n d), chi2^-1(0.975; n d)] / n                              (K7)

19 times out of 20. Above it the estimator trusts its model or sensors too much, below it too little. (Bar-Shalom, Li,
Kirubarajan: Estimation with Applications to Tracking and Navigation, 5.4.2.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

PROBABILITY = 0.95


@dataclass(frozen=True)
class Consistency:
    """The mean of normalised innovations squared, and where it should lie, (K7).

    Attributes
    ----------
    mean, low, high : float
    samples : int
    """

    mean: float
    low: float
    high: float
    samples: int

    @property
    def holds(self) -> bool:
        """Whether the mean lies within the interval."""
        return self.low <= self.mean <= self.high


def consistency(nis: Sequence[float], degrees: int = 2) -> Consistency:
    """Return (K7) of normalised innovations squared, each of so many degrees of freedom.

    Raises
    ------
    ValueError
        There are none.
    """
    if not len(nis):
        raise ValueError("consistency: got no innovations, must be at least one; did samples of the sensors arrive?")
    tail, n = (1.0 - PROBABILITY) / 2.0, len(nis)
    low, high = (float(scipy.stats.chi2.ppf(share, n * degrees)) / n for share in (tail, 1.0 - tail))
    return Consistency(float(np.mean(nis)), low, high, n)
