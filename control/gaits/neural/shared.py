"""What recordings of waves share: delays by few numbers, and how well they tell those of a recording that is left out.

The delay of band b behind the middle one, at the period T, is taken for

    T^p (s x_b + h_b),   x_b = places from the middle band                                                        (SP1)

with a size s, an exponent of pace p and a profile h, all of them shared by the recordings. p makes the squares of the
misses, over `FRAME` squared, and of (p - 1)/PACE_SPREAD least. The profile is what uniform delays miss on average, over
1 + strength: a strength of 0 believes the recordings, an infinite one is the uniform wave. Leaving out each recording
in turn chooses the strength, and waves drawn with replacement tell the error of that by sampling.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from control.gaits.neural.recording import CONFIDENCE, Waves, median_of
from control.gaits.neural.training import FRAME, Target
from worm3d.values.arrays import FloatArray

PACE_SPREAD = 0.24
"""Standard deviation of the exponent of pace about the 1 that is expected: larvae that crawl slower have slower waves
(first-instar larvae at 5 s a wave, `L1`, take five times as long from segment to segment as third-instar ones at 1 s).
It matters where paces are alike: with half of it the four recordings give 0.77, as it is 0.68, with twice 0.65 and with
no expectation 0.64, but 3a and 3c alone 0.88, 0.65, 0.35 and 0.13. It was chosen in view of all four recordings."""
STRENGTHS = (0.1, 0.3, 1.0, 3.0, 10.0, np.inf)
"""Strengths of the shrinkage that are tried."""
ALONE = 1.0
"""Strength for a single recording, of which none can be left out: half of its profile is believed."""
EXPONENTS = np.linspace(0.0, 2.0, 201)
"""Exponents of pace that are tried."""
RESAMPLED, SEED = 200, 20261123
"""Number of draws of waves with replacement, and their seed: the interval of 90 % to a tenth of its width."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Delays at any pace, (SP1)."""

    exponent: float
    """p."""
    size: float
    """s, delay from band to band at a period of 1 s [s]."""
    shape: FloatArray
    """h, at a period of 1 s, shape (bands,) [s]."""

    def delays(self, period: float) -> FloatArray:
        """Return the delay of each band at a period [s], shape (bands,) [s]."""
        n = len(self.shape)
        delays: FloatArray = period**self.exponent * (self.size * (np.arange(n) - n // 2) + self.shape)
        return delays


@dataclass(frozen=True)
class LeftOut:
    """How well recordings are told by the others."""

    strength: float
    """Strength of the shrinkage with the least miss."""
    shared_s: float
    """Root mean square miss of the recordings that are left out [s]."""
    uniform_s: float
    """That of uniform delays, size and exponent found alike [s]."""
    gain_s: tuple[float, float]
    """Interval of 90 % by sampling of how much less the shared profile misses than uniform delays [s]."""
    exponents: tuple[float, float]
    """Interval of 90 % by sampling of the exponent of pace of all recordings."""

    @property
    def learnt(self) -> bool:
        """Whether the profile tells more than uniform delays, beyond the error of sampling."""
        return self.gain_s[0] > 0.0


def shared(targets: Sequence[Target], strength: float) -> Profile:
    """Return what targets share, with a strength of the shrinkage."""
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
    """Return the root mean square miss of each recording by what the others share [s], shape (recordings,)."""
    found = []
    for k, target in enumerate(targets):
        others = shared([*targets[:k], *targets[k + 1 :]], strength)
        off = np.delete(others.delays(target.period) - target.delays, len(target.delays) // 2)
        found.append(np.sqrt(np.nanmean(off**2)))
    return np.array(found)


def left_out(waves: Sequence[Waves]) -> LeftOut:
    """Return how well each of at least two recordings is told by the others."""
    targets = [Target(each.period, each.median()) for each in waves]
    strength = min(STRENGTHS, key=lambda each: _rms(misses(targets, each)))
    random = np.random.default_rng(SEED)
    gains, exponents = [], []
    for _ in range(RESAMPLED):
        drawn = [_drawn(each, random) for each in waves]
        gains.append(_rms(misses(drawn, np.inf)) - _rms(misses(drawn, strength)))
        exponents.append(shared(drawn, strength).exponent)
    ends = 50.0 * (1.0 - CONFIDENCE), 50.0 * (1.0 + CONFIDENCE)
    low, high = np.percentile(gains, ends)
    least, most = np.percentile(exponents, ends)
    rms = [_rms(misses(targets, each)) for each in (strength, np.inf)]
    return LeftOut(strength, rms[0], rms[1], (float(low), float(high)), (float(least), float(most)))


def _drawn(waves: Waves, random: np.random.Generator) -> Target:
    """Return the target of waves drawn with replacement."""
    draw = random.integers(0, len(waves.times), len(waves.times))
    periods = waves.periods[random.integers(0, len(waves.periods), len(waves.periods))]
    return Target(float(np.median(periods)), median_of(waves.delays[draw]))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
