"""The wave that a body really makes, found in its chamber strains.

A travelling wave of contraction of wavelength lambda (body lengths) and commanded phase psi strains segment i by

    s_i = mean + Re(a exp(i (k x_i +- psi))) + shorter waves,   x_i = (i + 1/2)/N, k = 2 pi / lambda           (W1)

(+ for a retrograde wave). Least squares over the segments give mean and a exp(+- i psi) of one sample of the strains,
the mean of left and right; a, which is constant in a steady wave, is smoothed over a part of a wave. |a| is how far
the wave strains, arg a how it lags behind its command. What rocks with the wave goes with

    wave(psi) = (Re, Im) a exp(+- i psi),                                                                     (W2)

at any instant whose commanded phase is known, whether a sample of the strains arrived then or not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from control.gaits.steering import Schedule
from worm3d.values.arrays import FloatArray

SMOOTHING = 0.25
"""Waves over which a is smoothed: the shorter waves, of which two pass in a wave, nearly vanish."""

UNKNOWNS = 3
"""Number of unknowns of (W1) in one sample; fewer segments tell nothing."""


class MeasuredWave:
    """The wave of one body, sample by sample.

    Parameters
    ----------
    segments : int
    schedule : Schedule
        Its wavelength and direction.
    """

    def __init__(self, segments: int, schedule: Schedule) -> None:
        x = 2.0 * np.pi * (np.arange(segments) + 0.5) / segments / schedule.wavelength
        self._columns = np.column_stack([np.ones(segments), np.cos(x), -np.sin(x)])
        self._fit = _cos_sin(self._columns)
        self._turning = 1j if schedule.direction == "retrograde" else -1j
        self.reset()

    def reset(self) -> None:
        """Forget the wave."""
        self.amplitude = 0j
        self._phase: float | None = None

    def take(self, strain: FloatArray, phase: float) -> None:
        """Take a sample of the strains, shape (N, 2), of an instant with the commanded phase psi [rad], (W1).

        Unknown strains are NaN.
        """
        sampled = self._fitted(strain)
        if sampled != sampled:
            return
        passed = 0.0 if self._phase is None else abs(phase - self._phase) / (2.0 * np.pi)
        self._phase = phase
        sampled *= np.exp(-self._turning * phase)
        self.amplitude += (1.0 - np.exp(-passed / SMOOTHING)) * (sampled - self.amplitude)

    def _fitted(self, strain: FloatArray) -> complex:
        """Return a exp(+- i psi) of one sample; NaN if too little is known."""
        sampled = complex(self._fit @ strain.mean(axis=1))
        if sampled == sampled:
            return sampled
        known = np.isfinite(strain)
        rows = known.any(axis=1)
        if rows.sum() < UNKNOWNS:
            return complex(np.nan)
        means = np.where(known, strain, 0.0)[rows].sum(axis=1) / known[rows].sum(axis=1)
        return complex(_cos_sin(self._columns[rows]) @ means)

    def at(self, phase: float) -> FloatArray:
        """Return (W2), shape (2,)."""
        turned = self.amplitude * np.exp(self._turning * phase)
        return np.array([turned.real, turned.imag])


def _cos_sin(columns: FloatArray) -> NDArray[np.complex128]:
    """Return what takes strains of segments, of which the columns are 1, cos and -sin, to their wave."""
    inverse = np.linalg.pinv(columns)
    fit: NDArray[np.complex128] = inverse[1] + 1j * inverse[2]
    return fit
