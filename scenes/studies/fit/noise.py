"""Autoregressive models of the residuals of a fit, which are seldom independent from sample to sample.

    e_t = a_1 e_{t-1} + ... + a_p e_{t-p} + u_t                                                                  (F1)

The innovations u_t are white noise. Innovations of different channels at the same instant may be correlated.

The coefficients come from Burg's method (J. P. Burg, 1975; S. M. Kay, "Modern Spectral Estimation", 1988, ch. 7.5),
which always gives a stationary model. The order comes from Akaike's criterion, corrected for short series.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from worm3d.values.arrays import FloatArray

HIGHEST_ORDER = 12
"""Highest order that is tried. With 6, models of smooth residuals are inaccurate. With 24, the results are the same and
the search takes longer."""
SAMPLES_PER_ORDER = 10
"""The order is at most the number of samples divided by this, so that a short series does not get a long memory."""


@dataclass(frozen=True)
class Noise:
    """An autoregressive model of C channels that have the same order p, (F1)."""

    coefficients: FloatArray
    """a_1 to a_p of each channel, shape (C, p)."""
    covariance: FloatArray
    """Covariance of the innovations u, shape (C, C)."""

    @property
    def order(self) -> int:
        """The order p."""
        return int(self.coefficients.shape[1])

    def score_covariance(self, spectra: FloatArray, size: int) -> FloatArray:
        """Return the covariance of J' e, the sum over channels and instants of slopes times noise, shape (P, P).

        Parameters
        ----------
        spectra : ndarray, shape (F, C, P), complex
            `spectra_of(J)`.
        size : int
            Number of points of the transform, as `spectra_of` returns it.
        """
        filtered = spectra / np.conj(self._response(size).T[:, :, None])
        both = np.einsum("fck,cd,fdl->fkl", np.conj(filtered), self.covariance, filtered, optimize=True).real
        weights = np.full(len(both), 2.0)
        weights[0] = 1.0
        if size % 2 == 0:
            weights[-1] = 1.0
        return np.asarray(np.tensordot(weights, both, 1) / size)

    def draw(self, length: int, random: np.random.Generator) -> FloatArray:
        """Return a random stationary series, shape (C, length)."""
        # The transform makes a periodic series, whose period is so long that its ends are independent.
        size = fft.next_fast_len(length + self._memory(), real=True)
        white = np.zeros(len(self.covariance))
        innovations = random.multivariate_normal(white, self.covariance, size, method="eigh").T
        return np.asarray(fft.irfft(fft.rfft(innovations) / self._response(size), size)[:, :length])

    def _response(self, size: int) -> FloatArray:
        """Return the Fourier transform of the sequence 1, -a_1, ..., -a_p over `size` points, shape (C, F), complex."""
        lags = np.concatenate([np.ones((len(self.coefficients), 1)), -self.coefficients], axis=1)
        return np.asarray(fft.rfft(lags, size))

    def _memory(self) -> int:
        """Return the number of samples, at most 20 000, until an innovation has decayed to 1e-6 of its size."""
        radius = max((float(np.abs(np.roots([1.0, *-own])).max(initial=0.0)) for own in self.coefficients), default=0.0)
        if radius == 0.0:
            return 0
        return min(20_000, int(np.log(1e-6) / np.log(min(radius, 1.0 - 1e-9))) + 1)


def spectra_of(slopes: FloatArray) -> tuple[FloatArray, int]:
    """Return the Fourier transforms of series over time, shape (F, C, P), and their number of points.

    The series are padded with zeros, so that products of transforms are not cyclic.

    Parameters
    ----------
    slopes : ndarray, shape (C, T, P)
    """
    size = fft.next_fast_len(2 * slopes.shape[1], real=True)
    return fft.rfft(slopes, size, axis=1).transpose(1, 0, 2), size


def noise_of(series: FloatArray, order: int | None = None) -> Noise:
    """Return a model of residuals of shape (C, T). Without `order`, the best common order of all channels is used."""
    highest = min(HIGHEST_ORDER, series.shape[1] // SAMPLES_PER_ORDER)
    stages = list(_burg(series, highest if order is None else order))
    if order is None:
        order = int(np.argmin([_akaike(innovations, p, series.shape[1]) for p, (_, innovations) in enumerate(stages)]))
    coefficients, innovations = stages[order]
    return Noise(coefficients, innovations @ innovations.T / innovations.shape[1])


def _burg(series: FloatArray, order: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return the coefficients, shape (C, p), and the innovations, shape (C, T - p), for p = 0 to `order`."""
    forward = backward = series
    coefficients = np.zeros((len(series), 0))
    stages = [(coefficients, forward)]
    for _ in range(order):
        ahead, behind = forward[:, 1:], backward[:, :-1]
        power = (ahead**2 + behind**2).sum(axis=1)
        reflection = 2.0 * (ahead * behind).sum(axis=1) / np.where(power > 0.0, power, 1.0)
        k = reflection[:, None]
        coefficients = np.concatenate([coefficients - k * coefficients[:, ::-1], k], axis=1)
        forward, backward = ahead - k * behind, behind - k * ahead
        stages.append((coefficients, forward))
    return stages


def _akaike(innovations: FloatArray, order: int, length: int) -> float:
    """Return Akaike's criterion, corrected for short series, summed over the channels with nonzero innovations."""
    power = np.mean(innovations**2, axis=1)
    noisy = power[power > 0.0]
    return float(length * np.log(noisy).sum() + len(noisy) * 2.0 * length * (order + 1) / (length - order - 2))


def autocorrelation(series: FloatArray, lags: int) -> FloatArray:
    """Return the autocorrelation of a series of shape (T,) at the lags 0 to `lags`; zeros if the series is constant."""
    off = series - series.mean()
    power = float(off @ off)
    found = [float(off[: len(off) - lag] @ off[lag:]) for lag in range(lags + 1)]
    return np.array(found) / power if power > 0.0 else np.zeros(lags + 1)
