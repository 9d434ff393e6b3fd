"""Lack of fit: whether the residuals are noise, or an effect that the scene does not model.

The noise is assumed to be autoregressive of first order, e_t = a e_{t-1} + u_t, and is estimated in two ways. A slow
error of the model hardly changes from sample to sample, so the differences of neighbours depend on the noise alone,

    a = 1 + 2 r,  var(u) = (1 + a) var(d)/2,  with d_t = e_t - e_{t-1} of variance var(d) and correlation r       (FL1)

but this estimate is rough. The maximum-likelihood a, with a share q of additional white noise (P. Whittle, Bulletin of
the International Statistical Institute 39, 1962), is more exact, but attributes a part of the error to noise:

    least over a, q of  ln mean_k(P_k/S_k) + mean_k ln S_k,  P_k the power of the residuals at frequency w_k,     (FL2)
    S_k = (1 - q) (1 - a^2)/(1 - 2 a cos w_k + a^2) + q

For each estimate, the ratio is the power at low frequencies divided by the power of the noise. Right scenes seldom have
a large ratio, or residuals that resemble the effect of a key (`scenes.studies.fit.suspects`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import fft, signal, special

from scenes.studies.fit.suspects import NO_SUSPECTS, Suspects
from worm3d.values.arrays import FloatArray

LEAST_SAMPLES = 30
"""Least number of samples of a channel in the test."""
MAX_NOISE_CORRELATION = 0.9
"""Largest correlation of neighbouring samples that is accepted as noise: a memory of ten samples."""
TRIED = np.array([(a, q) for a in np.linspace(0.0, MAX_NOISE_CORRELATION, 19) for q in (0.0, 0.1, 0.3, 0.5, 0.7)])
"""Values of a and q that are tried for (FL2)."""
BAND_FREQUENCIES = 6
"""Number of frequencies of a band."""
SLOW = 8
"""Number of all frequencies divided by the number of frequencies that count as slow."""
CERTAIN = 20.0
"""Least ratio to the noise (FL1) that alone proves a lack of fit. About one in a hundred series of autoregressive noise
with a correlation of 0.8 and as much white noise exceeds it, fewer without white noise, and no set of four series."""
LIMIT = 3.0
"""Least ratio to the noise (FL2) that indicates a lack of fit, if the chance of noise is at most `CHANCE`. At 1.5 the
chance alone decides; at 6 the test misses a wrong mass that is sampled 25 times a second."""
CHANCE = 1e-4
"""Largest chance of noise that indicates a lack of fit: the normal tail of drawn logarithms. The true tail is longer:
at most two or three of 2000 sets of four noisy series have it. A tenth of it would miss a wrong mass more often."""
NOISE_DRAWS = 100
"""Number of drawn series of each channel, for mean and scatter of the logarithm of the ratio to 10 %."""


@dataclass(frozen=True)
class Lack:
    """Slowness of the residuals relative to noise."""

    ratio: float
    """Power of the slow residuals over the power of the noise (FL1): the worst band of frequencies of each channel,
    then the geometric mean over the channels; 0 if there are too few data."""
    likely: float = 0.0
    """The same ratio to the noise (FL2)."""
    chance: float = 1.0
    """Probability that noise has a ratio (FL2) at least as large; 1 below `LIMIT`."""
    suspects: Suspects = NO_SUSPECTS
    """Fixed keys that would take most of the residuals away."""

    @property
    def found(self) -> bool:
        """Whether the scene does not follow the data."""
        return self.ratio > CERTAIN or self.chance <= CHANCE or self.suspects.found

    @property
    def widening(self) -> float:
        """Factor of the errors: slow residuals of r times the power of noise move the values sqrt(r) times as far."""
        return float(np.sqrt(max(1.0, self.likely))) if self.found else 1.0


def ratio_of(residuals: FloatArray) -> float:
    """Return the ratio (FL1) of residuals, shape (C, T), NaN where nothing was measured."""
    ratios = [_by_differences(series) for series in _series(residuals)]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 0.0


def lack_of(residuals: FloatArray) -> Lack:
    """Return the lack of fit of residuals, shape (C, T), NaN where nothing was measured.

    The errors of a wrong scene vary with the strides and with the whole crawl, far slower than noise. Their power is
    many times the power of noise, even in a single channel.
    """
    channels = list(_series(residuals))
    if not channels:
        return Lack(0.0)
    found = [_by_likelihood(series) for series in channels]
    likely = float(np.mean([np.log(ratio) for _, ratio in found]))
    chance = 1.0
    if likely >= np.log(LIMIT):
        random = np.random.default_rng(0)
        drawn = [_drawn(noise, len(series), random) for (noise, _), series in zip(found, channels, strict=True)]
        means = np.mean([np.log(_by_likelihood(each)[1]) for each in drawn], axis=0)
        chance = float(special.ndtr((means.mean() - likely) / means.std()))
    return Lack(ratio_of(residuals), float(np.exp(likely)), chance)


def _series(residuals: FloatArray) -> Iterator[FloatArray]:
    """Yield the known values of each channel that has enough values and a nonzero range."""
    for series in residuals:
        known = series[np.isfinite(series)]
        if len(known) >= LEAST_SAMPLES and np.ptp(known) > 0.0:
            yield known


def _by_differences(series: FloatArray) -> float:
    """Return the ratio of a series, shape (T,), by (FL1)."""
    steps = np.diff(series)
    power = float(steps @ steps)
    a = np.clip(1.0 + 2.0 * (steps[1:] @ steps[:-1]) / power, 0.0, MAX_NOISE_CORRELATION)
    innovations = 0.5 * (1.0 + a) * power / len(steps)
    return float(_worst(_power(series) * (1.0 - a**2) / (innovations * _shape(a, 0.0, len(series)))))


def _by_likelihood(series: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a and q, shape (..., 2), and the ratio of series, shape (..., T), by (FL2)."""
    power, (shapes, inverse, level) = _power(series), _tried(series.shape[-1])
    sizes = power @ inverse / series.shape[-1]
    best = np.argmin(np.log(sizes) + level, axis=-1)
    own = np.take_along_axis(sizes, best[..., None], axis=-1)
    return TRIED[best], _worst(power / (own * shapes[best]))


@lru_cache(maxsize=8)
def _tried(length: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return S_k for `TRIED`, shape (K, T), its reciprocal, shape (T, K), and its mean logarithm, shape (K,)."""
    shapes = _shape(TRIED[:, 0], TRIED[:, 1], length)
    return shapes, (1.0 / shapes).T, np.log(shapes).mean(axis=-1)


def _power(series: FloatArray) -> FloatArray:
    """Return the power at each frequency, shape (..., T)."""
    return np.asarray(fft.dct(series, norm="ortho", axis=-1) ** 2)


def _shape(a: FloatArray | float, q: FloatArray | float, length: int) -> FloatArray:
    """Return the power of noise of variance 1 at each frequency, S_k of (FL2), shape (..., T)."""
    cosine = np.cos(np.pi * np.arange(length) / length)
    a, q = np.asarray(a)[..., None], np.asarray(q)[..., None]
    return np.asarray((1.0 - q) * (1.0 - a**2) / (1.0 - 2.0 * a * cosine + a**2) + q)


def _worst(relative: FloatArray) -> FloatArray:
    """Return the largest mean over a band of low frequencies of relative power, shape (..., T)."""
    bands = max(1, relative.shape[-1] // (SLOW * BAND_FREQUENCIES))
    split = relative[..., : bands * BAND_FREQUENCIES].reshape(*relative.shape[:-1], bands, BAND_FREQUENCIES)
    return np.asarray(split.mean(axis=-1).max(axis=-1))


def _drawn(noise: FloatArray, length: int, random: np.random.Generator) -> FloatArray:
    """Return noise of variance 1, shape (NOISE_DRAWS, length), for the values of a and q in `noise`, shape (2,)."""
    a, q = map(float, noise)
    burn_in = 100  # samples, after which the series has forgotten its start
    innovations = np.sqrt((1.0 - q) * (1.0 - a**2)) * random.standard_normal((NOISE_DRAWS, length + burn_in))
    coloured: FloatArray = signal.lfilter([1.0], [1.0, -a], innovations, axis=-1)[:, burn_in:]
    coloured += np.sqrt(q) * random.standard_normal(coloured.shape)
    return coloured
