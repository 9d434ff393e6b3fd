"""Test for lack of fit: whether the residuals are noise, or an effect that the scene does not model.

The noise is assumed to be autoregressive of first order, e_t = a e_{t-1} + u_t with white u_t. Its parameters are
estimated in two ways. The first estimate uses differences of neighbouring samples, because a slow error of the model
hardly changes from sample to sample. The differences then depend only on the noise:

    a = 1 + 2 r,  var(u) = (1 + a) var(d)/2,  with d_t = e_t - e_{t-1} of variance var(d) and correlation r       (FL1)

This estimate is not precise. The second estimate is the maximum-likelihood estimate of a and of the fraction q of the
variance that is additional white noise (P. Whittle, Bulletin of the International Statistical Institute 39, 1962). It
is more precise, but attributes a part of the model's error to noise. With the power P_k of the residuals at the
frequency w_k, it minimises over a and q

    ln mean_k(P_k/S_k) + mean_k ln S_k,   S_k = (1 - q) (1 - a^2)/(1 - 2 a cos w_k + a^2) + q                     (FL2)

Each estimate gives a ratio: the power of the residuals at low frequencies, divided by the power of the noise there. If
the scene is correct, the ratio is rarely large, and the residuals rarely resemble the effect of a fixed key
(`scenes.studies.fit.suspects`).
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
"""Smallest number of samples of a channel that the test uses."""
MAX_NOISE_CORRELATION = 0.9
"""Largest correlation of neighbouring samples that is accepted as noise. It corresponds to a memory of ten samples."""
TRIED = np.array([(a, q) for a in np.linspace(0.0, MAX_NOISE_CORRELATION, 19) for q in (0.0, 0.1, 0.3, 0.5, 0.7)])
"""Values of (a, q) among which (FL2) is minimised."""
BAND_FREQUENCIES = 6
"""Number of frequencies over which the power is averaged; such a group is called a band."""
SLOW = 8
"""The lowest 1/SLOW of all frequencies are called slow."""
CERTAIN = 20.0
"""Ratio by (FL1) above which a lack of fit is reported without further tests. Autoregressive noise with a correlation
of 0.8 and with as much additional white noise exceeds this limit in about 1 % of single series, and in no tested set of
four series. Without the white noise it is exceeded less often."""
LIMIT = 3.0
"""Ratio by (FL2) from which `CHANCE` is tested. With 1.5 instead of 3, this limit has no effect. With 6, the test
misses a wrong mass in data sampled at 25 Hz."""
CHANCE = 1e-4
"""Lack of fit is reported if the probability of so large a ratio (FL2) under noise is at most this value. The
probability is computed from a normal distribution of the logarithm of the ratio. The true distribution has a longer
tail: two or three of 2000 tested sets of four series of noise were below this value. A limit of 1e-5 misses a wrong
mass more often."""
NOISE_DRAWS = 100
"""Number of random series per channel. It suffices to estimate the mean and the standard deviation of the log-ratio to
within 10 %."""


@dataclass(frozen=True)
class Lack:
    """Result of the test for lack of fit."""

    ratio: float
    """Power of the slow residuals divided by the power of the noise, with the noise estimated by (FL1). In each channel
    the slow band with the largest ratio counts. The value is the geometric mean over the channels, or 0 if there are
    too few data."""
    likely: float = 0.0
    """The same ratio, with the noise estimated by (FL2)."""
    chance: float = 1.0
    """Probability that noise has a ratio at least as large as `likely`; 1 if `likely` is below `LIMIT`."""
    suspects: Suspects = NO_SUSPECTS
    """Fixed keys of the scene that would remove most of the residuals if they were varied."""

    @property
    def found(self) -> bool:
        """Whether the test found a lack of fit."""
        return self.ratio > CERTAIN or self.chance <= CHANCE or self.suspects.found

    @property
    def widening(self) -> float:
        """Factor by which the standard errors are enlarged; 1 without a lack of fit.

        If the slow residuals have r times the power of the noise, the errors of the fitted values are sqrt(r) times as
        large.
        """
        return float(np.sqrt(max(1.0, self.likely))) if self.found else 1.0


def ratio_of(residuals: FloatArray) -> float:
    """Return the ratio by (FL1) of residuals of shape (C, T), which are NaN where nothing was measured."""
    ratios = [_by_differences(series) for series in _series(residuals)]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 0.0


def lack_of(residuals: FloatArray) -> Lack:
    """Return the result of the test for residuals of shape (C, T), which are NaN where nothing was measured.

    `suspects` of the result is empty. If a scene is wrong, its errors change over a stride or over the whole run, much
    more slowly than noise. At low frequencies their power is then many times the power of the noise, even in a single
    channel.
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
    """Yield the known values of each channel that has enough known values and is not constant."""
    for series in residuals:
        known = series[np.isfinite(series)]
        if len(known) >= LEAST_SAMPLES and np.ptp(known) > 0.0:
            yield known


def _by_differences(series: FloatArray) -> float:
    """Return the ratio of a series of shape (T,), with the noise estimated by (FL1)."""
    steps = np.diff(series)
    power = float(steps @ steps)
    a = np.clip(1.0 + 2.0 * (steps[1:] @ steps[:-1]) / power, 0.0, MAX_NOISE_CORRELATION)
    innovations = 0.5 * (1.0 + a) * power / len(steps)
    return float(_worst(_power(series) * (1.0 - a**2) / (innovations * _shape(a, 0.0, len(series)))))


def _by_likelihood(series: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Estimate the noise of series by (FL2), and return the estimates and the ratios.

    Parameters
    ----------
    series : ndarray, shape (..., T)

    Returns
    -------
    estimates : ndarray, shape (..., 2)
        a and q of each series.
    ratios : ndarray, shape (...)
    """
    power, (shapes, inverse, level) = _power(series), _tried(series.shape[-1])
    sizes = power @ inverse / series.shape[-1]
    best = np.argmin(np.log(sizes) + level, axis=-1)
    own = np.take_along_axis(sizes, best[..., None], axis=-1)
    return TRIED[best], _worst(power / (own * shapes[best]))


@lru_cache(maxsize=8)
def _tried(length: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return S_k of (FL2) for the K pairs in `TRIED`, the transposed reciprocal of S_k, and the mean of ln S_k.

    The shapes are (K, T), (T, K) and (K,), where T is the length of the series.
    """
    shapes = _shape(TRIED[:, 0], TRIED[:, 1], length)
    return shapes, (1.0 / shapes).T, np.log(shapes).mean(axis=-1)


def _power(series: FloatArray) -> FloatArray:
    """Return the power of series of shape (..., T) at each of T frequencies, by a cosine transform."""
    return np.asarray(fft.dct(series, norm="ortho", axis=-1) ** 2)


def _shape(a: FloatArray | float, q: FloatArray | float, length: int) -> FloatArray:
    """Return S_k of (FL2), the power of noise of variance 1 at each frequency.

    The shape is (..., length), where ... is the shape of `a` and `q`.
    """
    cosine = np.cos(np.pi * np.arange(length) / length)
    a, q = np.asarray(a)[..., None], np.asarray(q)[..., None]
    return np.asarray((1.0 - q) * (1.0 - a**2) / (1.0 - 2.0 * a * cosine + a**2) + q)


def _worst(relative: FloatArray) -> FloatArray:
    """Return the largest mean of the relative power, shape (..., T), over any band of slow frequencies."""
    bands = max(1, relative.shape[-1] // (SLOW * BAND_FREQUENCIES))
    split = relative[..., : bands * BAND_FREQUENCIES].reshape(*relative.shape[:-1], bands, BAND_FREQUENCIES)
    return np.asarray(split.mean(axis=-1).max(axis=-1))


def _drawn(noise: FloatArray, length: int, random: np.random.Generator) -> FloatArray:
    """Return random series of noise of variance 1, shape (NOISE_DRAWS, length), for `noise` = (a, q)."""
    a, q = map(float, noise)
    burn_in = 100  # number of samples after which the series no longer depends on its start
    innovations = np.sqrt((1.0 - q) * (1.0 - a**2)) * random.standard_normal((NOISE_DRAWS, length + burn_in))
    coloured: FloatArray = signal.lfilter([1.0], [1.0, -a], innovations, axis=-1)[:, burn_in:]
    coloured += np.sqrt(q) * random.standard_normal(coloured.shape)
    return coloured
