"""Model of the delays that recordings of waves share, and its prediction error for a recording that is left out.

The delay of band b behind the middle band, at the period T, is modelled as

    T^p (s x_b + h_b),   x_b = places from the middle band                                                        (SP1)

with a size s, an exponent of pace p and a profile h, all shared by the recordings. A miss is a measured delay minus the
modelled delay. p minimises the sum of the squares of (miss/FRAME), plus the square of (p - 1)/PACE_SPREAD. The profile
is the mean miss of uniform delays, divided by 1 + strength: a strength of 0 trusts the recordings, an infinite strength
gives the uniform wave. Leave-one-out validation over the recordings chooses the strength. Waves drawn with replacement
give sampling intervals for this strength.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from control.gaits.neural.recording import INTERVAL, Waves, median_of
from control.gaits.neural.training import FRAME, Target
from worm3d.values.arrays import FloatArray

PACE_SPREAD = 0.24
"""Standard deviation of the exponent of pace about the expected 1: larvae that crawl slower have slower waves
(first-instar larvae, `L1`, at 5 s a wave take five times as long from segment to segment as third-instar larvae at one
second a wave). The value matters for recordings of similar pace: with half the value, this value, twice the value and
no expectation, the exponents from the four recordings are 0.77, 0.68, 0.65 and 0.64, but the exponents from 3a and 3c
alone are 0.88, 0.65, 0.35 and 0.13. The value was chosen in view of all four recordings."""
STRENGTHS = (0.1, 0.3, 1.0, 3.0, 10.0, np.inf)
"""Strengths of the shrinkage that are compared."""
ALONE = 1.0
"""Strength for a single recording, which does not allow leave-one-out validation. Half of the profile is used."""
EXPONENTS = np.linspace(0.0, 2.0, 201)
"""Exponents of pace that are compared."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Delays at any pace, (SP1)."""

    exponent: float
    """Exponent of pace p."""
    size: float
    """Size s, the delay between neighbouring bands at a period of 1 s [s]."""
    shape: FloatArray
    """Profile h at a period of 1 s, shape (bands,) [s]."""

    def delays(self, period: float) -> FloatArray:
        """Return the delay of each band at a period [s], shape (bands,) [s]."""
        n = len(self.shape)
        return np.asarray(period**self.exponent * (self.size * (np.arange(n) - n // 2) + self.shape))


@dataclass(frozen=True)
class LeftOut:
    """Errors of the prediction of each recording from the others."""

    strength: float
    """Strength of the shrinkage with the smallest error."""
    shared_s: float
    """Root mean square error for the recordings that are left out [s]."""
    uniform_s: float
    """The same error for uniform delays, with size and exponent fitted in the same way [s]."""
    gain_s: tuple[float, float]
    """Sampling interval (90 %) of the reduction of the error by the shared profile, compared with uniform delays
    [s]."""
    exponents: tuple[float, float]
    """Sampling interval (90 %) of the exponent of pace of all recordings."""

    @property
    def learnt(self) -> bool:
        """Whether the profile predicts better than uniform delays, beyond the sampling error."""
        return self.gain_s[0] > 0.0


def shared(targets: Sequence[Target], strength: float) -> Profile:
    """Return the profile that targets share, for a strength of the shrinkage."""
    period = np.array([target.period for target in targets])
    delays = np.array([target.delays for target in targets])
    known = np.isfinite(delays)
    places = np.arange(delays.shape[1]) - delays.shape[1] // 2
    pace = np.where(known, period[:, None] ** EXPONENTS[:, None, None], 0.0)  # (exponents, recordings, bands)
    given = np.where(known, delays, 0.0)
    size = (pace * places * given).sum(axis=(1, 2)) / ((pace * places) ** 2).sum(axis=(1, 2))
    missed = given - pace * places * size[:, None, None]
    power = (pace**2).sum(axis=1)
    shape = (pace * missed).sum(axis=1) / np.where(power > 0.0, power, 1.0) / (1.0 + strength)
    squares = ((missed - pace * shape[:, None]) ** 2).sum(axis=(1, 2)) / FRAME**2
    best = int(np.argmin(squares + ((EXPONENTS - 1.0) / PACE_SPREAD) ** 2))
    return Profile(float(EXPONENTS[best]), float(size[best]), shape[best])


def misses(targets: Sequence[Target], strength: float) -> FloatArray:
    """Return the root mean square miss of each recording, predicted from the others [s], shape (recordings,)."""
    found = []
    for k, target in enumerate(targets):
        others = shared([*targets[:k], *targets[k + 1 :]], strength)
        off = np.delete(others.delays(target.period) - target.delays, len(target.delays) // 2)
        found.append(np.sqrt(np.nanmean(off**2)))
    return np.array(found)


def left_out(waves: Sequence[Waves]) -> LeftOut:
    """Return the errors of the prediction of each of at least two recordings from the others."""
    targets = [Target(each.period, each.median()) for each in waves]
    strength = min(STRENGTHS, key=lambda each: _rms(misses(targets, each)))
    random = np.random.default_rng(20261123)
    gains, exponents = [], []
    for _ in range(200):  # gives the intervals to a tenth of their width
        drawn = [_drawn(each, random) for each in waves]
        gains.append(_rms(misses(drawn, np.inf)) - _rms(misses(drawn, strength)))
        exponents.append(shared(drawn, strength).exponent)
    low, high = np.percentile(gains, INTERVAL)
    least, most = np.percentile(exponents, INTERVAL)
    rms = [_rms(misses(targets, each)) for each in (strength, np.inf)]
    return LeftOut(strength, rms[0], rms[1], (float(low), float(high)), (float(least), float(most)))


def _drawn(waves: Waves, random: np.random.Generator) -> Target:
    """Return the target of waves drawn with replacement."""
    draw = random.integers(0, len(waves.times), len(waves.times))
    periods = waves.periods[random.integers(0, len(waves.periods), len(waves.periods))]
    return Target(float(np.median(periods)), median_of(waves.delays[draw]))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
