"""Lack of fit: a test of whether the residuals of a fit are noise, or contain an effect that the scene does not model.

Such an effect is slow: it varies over strides or over the whole run. The test compares the power of the residuals at
low frequencies with the power that noise would have there. The noise is assumed to be autoregressive of first order,
e_t = a e_{t-1} + u_t with white u_t, and is estimated in two ways.

(FL1) uses the differences of consecutive residuals, d_t = e_t - e_{t-1}, since a slow effect contributes little to
them. With the variance var(d) of the differences, and the correlation r of consecutive differences,

    a = 1 + 2 r,  var(u) = (1 + a) var(d)/2                                                                       (FL1)

This estimate is not precise. (FL2) is a maximum-likelihood estimate (P. Whittle, Bulletin of the International
Statistical Institute 39, 1962). It is more precise, but attributes a part of the slow effect to noise. Its noise also
contains white noise, with the fraction q of the variance. P_k is the power of the residuals at the frequency w_k, and
S_k is the power of noise with variance 1:

    minimise over a, q:  ln mean_k(P_k/S_k) + mean_k ln S_k                                                       (FL2)
    S_k = (1 - q) (1 - a^2)/(1 - 2 a cos w_k + a^2) + q

With each estimate, the *ratio* is the power of the residuals at low frequencies divided by the power of the noise at
these frequencies. If a scene is correct, the ratio is rarely large, and the residuals rarely resemble the effect of a
fixed key (`scenes.studies.fit.suspects`).
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
"""Minimum number of samples of a channel that takes part in the test."""
MAX_NOISE_CORRELATION = 0.9
"""Largest correlation a of consecutive samples that is accepted as noise. With 0.9 the noise has a correlation time of
ten samples."""
TRIED = np.array([(a, q) for a in np.linspace(0.0, MAX_NOISE_CORRELATION, 19) for q in (0.0, 0.1, 0.3, 0.5, 0.7)])
"""Pairs (a, q) among which the minimum (FL2) is searched."""
BAND_FREQUENCIES = 6
"""Number of frequencies in a band. The low frequencies are divided into bands, and the ratio is computed per band."""
SLOW = 8
"""The lowest 1/`SLOW` of all frequencies are the low frequencies."""
CERTAIN = 20.0
"""If the ratio by (FL1) is above this value, there is a lack of fit regardless of (FL2). For comparison: about 1 % of
single series of noise exceed it if the noise is autoregressive with a = 0.8 plus white noise of the same power, and
fewer without white noise. No set of four such series exceeded it."""
LIMIT = 3.0
"""Minimum ratio by (FL2) for a lack of fit; the probability must also be at most `CHANCE`. With 1.5 instead of 3, this
limit has no effect. With 6, the test misses a wrong mass in data sampled at 25 Hz."""
CHANCE = 1e-4
"""Maximum probability under noise for a lack of fit, computed with a normal distribution of the log-ratio. The actual
distribution has a longer tail: two or three of 2000 sets of four series of noise were at or below this value. With a
tenth of this value, the test would miss a wrong mass more often."""
NOISE_DRAWS = 100
"""Number of random series per channel. It suffices to estimate the mean and the standard deviation of the log-ratio to
within 10 %."""


@dataclass(frozen=True)
class Lack:
    """Result of the test for a lack of fit."""

    ratio: float
    """Power of the residuals at low frequencies divided by the power of the noise (FL1): the largest value of the bands
    of each channel, then the geometric mean over the channels. It is 0 if there are too few data."""
    likely: float = 0.0
    """The same ratio with the noise of (FL2)."""
    chance: float = 1.0
    """Probability under noise alone of a ratio (FL2) that is at least as large. It is set to 1 if the ratio is below
    `LIMIT`."""
    suspects: Suspects = NO_SUSPECTS
    """Fixed keys that would remove most of the residuals if they were varied."""

    @property
    def found(self) -> bool:
        """Whether there is a lack of fit: the residuals contain more than noise."""
        return self.ratio > CERTAIN or self.chance <= CHANCE or self.suspects.found

    @property
    def widening(self) -> float:
        """Factor that enlarges the standard errors of the fitted values; 1 without a lack of fit.

        If the slow residuals have r times the power of noise, the errors of the fitted values are sqrt(r) times as
        large.
        """
        return float(np.sqrt(max(1.0, self.likely))) if self.found else 1.0


def ratio_of(residuals: FloatArray) -> float:
    """Return the ratio (FL1) of residuals of shape (C, T), which are NaN where nothing was measured."""
    ratios = [_by_differences(series) for series in _series(residuals)]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 0.0


def lack_of(residuals: FloatArray) -> Lack:
    """Return the lack of fit of residuals of shape (C, T), which are NaN where nothing was measured.

    The residuals of an incorrect scene vary over strides and over the whole run, which is much slower than noise. At
    low frequencies their power is many times the power of noise, even in a single channel.
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
    """Yield the finite values of each channel that has enough of them and is not constant."""
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
    """Return the largest of the bands' means of the relative power, shape (...).

    `relative` is the power divided by that of the noise, shape (..., T). Only the low frequencies are used.
    """
    bands = max(1, relative.shape[-1] // (SLOW * BAND_FREQUENCIES))
    split = relative[..., : bands * BAND_FREQUENCIES].reshape(*relative.shape[:-1], bands, BAND_FREQUENCIES)
    return np.asarray(split.mean(axis=-1).max(axis=-1))


def _drawn(noise: FloatArray, length: int, random: np.random.Generator) -> FloatArray:
    """Return random noise of variance 1, shape (NOISE_DRAWS, length); `noise` contains a and q of (FL2)."""
    a, q = map(float, noise)
    burn_in = 100  # number of samples until the start of a series has no influence
    innovations = np.sqrt((1.0 - q) * (1.0 - a**2)) * random.standard_normal((NOISE_DRAWS, length + burn_in))
    coloured: FloatArray = signal.lfilter([1.0], [1.0, -a], innovations, axis=-1)[:, burn_in:]
    coloured += np.sqrt(q) * random.standard_normal(coloured.shape)
    return coloured
