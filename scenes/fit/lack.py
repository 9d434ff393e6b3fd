"""Lack of fit: whether what a fit leaves is noise, or what the scene cannot follow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import fft

from worm3d.values.arrays import FloatArray

LEAST_SAMPLES = 30
"""Least number of samples of a channel that is looked at."""
LONGEST = 0.9
"""Largest correlation of neighbouring samples of what passes for noise: a memory of ten samples."""
BAND = 6
"""Number of frequencies of a band."""
SLOW = 8
"""One over the part of the frequencies that counts as slow."""
LIMIT = 20.0
"""Ratio that tells a lack of fit. About one in a hundred series of autoregressive noise with a correlation of 0.8 and
as much white noise exceeds it, fewer without white noise, and none of four series together."""


@dataclass(frozen=True)
class Lack:
    """How much slower residuals change than noise would."""

    ratio: float
    """Power of their slow part over that of the noise which their quick changes tell of: of each channel in its worst
    band of frequencies, then the geometric mean of the channels; 0 if too little is known."""

    @property
    def found(self) -> bool:
        """Whether the scene does not follow the data."""
        return self.ratio > LIMIT

    @property
    def sentence(self) -> str:
        """What it means and what to do, for people."""
        return (
            f"the scene does not follow the data: the slow part of the residuals has {self.ratio:.3g} times the power "
            "of noise with their quick changes, so values may be off by more than the intervals say; vary further keys "
            "that may be wrong, such as those of friction, gait and worm, and look at the residuals in fit.png"
        )


def lack_of(residuals: FloatArray) -> Lack:
    """Return the lack of fit of residuals, shape (C, T), NaN where nothing was measured.

    The differences of neighbouring samples hardly see a slow error of the model, so they tell the variance and the
    correlation of first-order autoregressive noise, hence the power that it would have at low frequencies. The errors
    of a wrong scene go with strides and with the whole crawl, far slower than noise, and exceed this power many times,
    in a single channel too and however the noise of different channels is correlated.
    """
    ratios = [ratio for ratio in map(_ratio, _series(residuals)) if ratio > 0.0]
    if not ratios:
        return Lack(0.0)
    return Lack(float(np.exp(np.mean(np.log(ratios)))))


def _series(residuals: FloatArray) -> Iterator[FloatArray]:
    """Yield the known values of each channel that has enough of them."""
    for series in residuals:
        known = series[np.isfinite(series)]
        if len(known) >= LEAST_SAMPLES:
            yield known


def _ratio(series: FloatArray) -> float:
    """Return the largest ratio, over bands of low frequencies, of the power of a series to that of the noise in it.

    Of e_t = a e_{t-1} + u_t the differences have a correlation of (a - 1)/2 and a variance of 2 var(u)/(1 + a).
    """
    steps = np.diff(series)
    power = float(steps @ steps)
    if power == 0.0:
        return 0.0
    a = float(np.clip(1.0 + 2.0 * (steps[1:] @ steps[:-1]) / power, 0.0, LONGEST))
    angle = np.pi * np.arange(len(series)) / len(series)
    noise = 0.5 * (1.0 + a) * power / len(steps) / (1.0 - 2.0 * a * np.cos(angle) + a**2)
    ratio = fft.dct(series, norm="ortho") ** 2 / noise
    bands = max(1, len(series) // (SLOW * BAND))
    return float(ratio[: bands * BAND].reshape(bands, BAND).mean(axis=1).max())
