"""Commanded and actual wave of a body. The actual wave is measured by the strains of the chambers.

For a travelling wave of contraction with the wavelength lambda (body lengths) and the commanded phase psi, the strain
of segment i is

    s_i = mean + Re(a exp(i (k x_i +- psi))) + shorter waves,   x_i = (i + 1/2)/N, k = 2 pi / lambda           (W1)

with + for a retrograde wave. The strains of left and right are averaged. Least squares over the segments give mean and
a exp(+- i psi) for each sample of the strains. In a steady wave a is constant; it is smoothed over a part of a wave.
|a| is the amplitude of the strain, and arg a its lag behind the command. The rocking of the centre of mass is
proportional to

    wave(psi) = (Re, Im) a exp(+- i psi),                                                                     (W2)

which is known at any instant with a known commanded phase, even if no strains were sampled at that instant. A backward
wave is the wave of the worm turned round (`control.gaits.steering`, (S3)). Therefore it is fitted to the strains in the
order from head to tail. It rocks the centre of mass in the opposite direction, so that -wave(psi) is used.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from control.gaits.steering import BLEND, PACE, Schedule
from worm3d.values.arrays import FloatArray

FIT_SMOOTHING = 0.25
"""Number of waves over which a is smoothed. The shorter waves of (W1) oscillate twice per wave, and nearly vanish."""


class InputHistory:
    """History of the commands over a time span [s], which is needed for delayed measurements.

    It contains the inputs of the reduced model and the phases. The frequency in force follows from the phases. The
    amplitude in force follows the commanded amplitude as in a `WaveGenerator`.
    """

    def __init__(self, span: float) -> None:
        self._span = span
        self._times: list[float] = []
        self._phases: list[float] = []
        self._inputs: list[FloatArray] = []
        self._amplitudes: list[float] = []

    def add(self, t: float, given: FloatArray, phase: float) -> None:
        """Add the input that was in force until t [s], and the phase at t [rad]."""
        last = self._inputs[-1] if self._inputs else given
        now, passed = (self._amplitudes[-1], t - self._times[-1]) if self._times else (0.0, 0.0)
        left_over = np.exp(-passed * max(float(last[1]), PACE) / BLEND)
        self._amplitudes.append(float(given[0] + (now - given[0]) * left_over))
        self._times.append(t)
        self._phases.append(phase)
        self._inputs.append(last if np.array_equal(last, given) else given)
        if self._times[0] < t - 2.0 * self._span:  # many at once, which is cheaper
            old = bisect_left(self._times, t - self._span)
            del self._times[:old], self._phases[:old], self._inputs[:old], self._amplitudes[:old]

    def __len__(self) -> int:
        return len(self._times)

    def is_back(self, t: float) -> bool:
        """Return whether the wave commanded at t [s] goes backwards."""
        return bool(self._inputs[min(bisect_left(self._times, t), len(self._times) - 1)][0] < 0.0)

    def phase(self, t: float) -> float:
        """Return the commanded phase at t [s] [rad]."""
        return self._at(t, self._phases)

    def _at(self, t: float, values: list[float]) -> float:
        """Return the value at t [s], interpolated in `values`, a list with one value for each stored instant."""
        k = min(max(bisect_left(self._times, t), 1), len(self._times) - 1)
        if len(self._times) == 1 or self._times[k] == self._times[k - 1]:
            return values[-1]
        share = (t - self._times[k - 1]) / (self._times[k] - self._times[k - 1])
        return values[k - 1] + share * (values[k] - values[k - 1])

    def frequency(self, t: float) -> float:
        """Return the frequency in force at t [s] [Hz]. It is 0 if only one instant is stored."""
        k = min(max(bisect_left(self._times, t - 1e-12), 1), len(self._times) - 1)
        if k < 1:
            return 0.0
        return (self._phases[k] - self._phases[k - 1]) / (2.0 * np.pi * (self._times[k] - self._times[k - 1]))

    def between(self, begin: float, end: float) -> Iterator[tuple[FloatArray, float]]:
        """Yield the mean inputs in force in intervals between two instants [s], and the duration of each interval [s].

        An input consists of the amplitude and frequency of the wave and the commanded steering. Nothing is yielded
        before the first instant is added.
        """
        now, k = begin, bisect_left(self._times, begin + 1e-12)
        while self._times and now < end - 1e-12:
            k = min(k, len(self._times) - 1)
            given = self._inputs[k]
            while k < len(self._times) - 1 and self._inputs[k + 1] is given:
                k += 1
            until = end if k == len(self._times) - 1 else min(end, self._times[k])
            amplitude = (self._at(now, self._amplitudes) + self._at(until, self._amplitudes)) / 2.0
            frequency = (self.phase(until) - self.phase(now)) / (2.0 * np.pi * (until - now))
            yield np.array([amplitude, frequency, given[2]]), until - now
            now, k = until, k + 1


class MeasuredWave:
    """Wave of one body, measured by the strains."""

    def __init__(self, segments: int, schedule: Schedule) -> None:
        x = 2.0 * np.pi * (np.arange(segments) + 0.5) / segments / schedule.wavelength
        self._columns = np.column_stack([np.ones(segments), np.cos(x), -np.sin(x)])
        self._fit = _cos_sin(self._columns)
        self._turning = 1j if schedule.direction == "retrograde" else -1j
        self.amplitude = self.backward = 0j
        self._phase: float | None = None

    def take(self, strain: FloatArray, phase: float, back: bool = False) -> None:
        """Process a sample of the strains at the commanded phase psi [rad], (W1).

        `strain` has the shape (N, 2), with NaN where unknown. `back` is whether the commanded wave goes backwards. The
        measured wave in the other direction decays.
        """
        sampled = self._fitted(strain[::-1] if back else strain)
        if sampled != sampled:
            return
        passed = 0.0 if self._phase is None else abs(phase - self._phase) / (2.0 * np.pi)
        self._phase = phase
        sampled *= np.exp(-self._turning * phase)
        share = 1.0 - np.exp(-passed / FIT_SMOOTHING)
        self.amplitude += share * ((0j if back else sampled) - self.amplitude)
        self.backward += share * ((sampled if back else 0j) - self.backward)

    def _fitted(self, strain: FloatArray) -> complex:
        """Return a exp(+- i psi) for one sample of the strains. NaN if too few strains are known."""
        sampled = complex(self._fit @ strain.mean(axis=1))
        if sampled == sampled:
            return sampled
        known = np.isfinite(strain)
        rows = known.any(axis=1)
        if rows.sum() < 3:  # (W1) has three unknowns
            return complex(np.nan)
        means = np.where(known, strain, 0.0)[rows].sum(axis=1) / known[rows].sum(axis=1)
        return complex(_cos_sin(self._columns[rows]) @ means)

    def at(self, phase: float) -> FloatArray:
        """Return (W2) at a commanded phase [rad], shape (2,)."""
        turned = (self.amplitude - self.backward) * np.exp(self._turning * phase)
        return np.array([turned.real, turned.imag])


def _cos_sin(columns: FloatArray) -> NDArray[np.complex128]:
    """Return the linear map from strains to a exp(+- i psi) by least squares.

    `columns` contains 1, cos and -sin at the segments.
    """
    inverse = np.linalg.pinv(columns)
    return np.asarray(inverse[1] + 1j * inverse[2])
