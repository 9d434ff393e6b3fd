"""Gains and phases of the chambers, which describe how each chamber responds to its commands.

The response of a chamber that is weak, slow, leaking or loaded is modelled as the response of a healthy chamber, (SM1)
of `control.identification.strain_model`, to a smaller and later command. Let x_m be the commands of the chamber,
delayed by the lags T_m, psi the phase of the wave, and y_m = dx_m/dpsi = (u - x_m)/(T_m psi') their slopes. With the
weights w_m of the healthy model, the strain s is

    s = b + sum_m w_m (p x_m + q y_m) + the same sums over the other inputs                                   (CG1)
    gain = hypot(p, q),   phase = atan2(q, p)

A healthy chamber has p = 1 and q = 0. If the other inputs are given, s is linear in the chamber's own p, q and b. One
Kalman filter per chamber estimates these three states from the strains, sample by sample, with the latest states of the
other chambers. The states may change slowly from wave to wave. An error of the model lasts for a part of a wave instead
of one sample. Therefore the variance of the error is multiplied by the number of samples in this time.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import isfinite, pi

import numpy as np

from control.identification.strain_model import StrainModel, inputs, lagged
from worm3d import Command
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import Checked


@documented
@dataclass(frozen=True, kw_only=True)
class GainTrust(Checked):
    """Standard deviations of the effects that (CG1) does not contain. They determine how fast gains are adapted."""

    begin: float = parameter(0.2, "p and q of a chamber before the first sample", gt=0)
    begin_mean: float = parameter(0.05, "mean strain b before the first sample", gt=0)
    wander: float = parameter(0.01, "change of p and q in a wave", ge=0)
    wander_mean: float = parameter(0.003, "change of b in a wave", ge=0)
    missed: float = parameter(0.014, "strain that the model of a healthy worm misses", gt=0)
    lasts: float = parameter(0.25, "time for which the missed strain lasts", "waves", gt=0)
    judged: float = parameter(2.0, "time over which the misfit is averaged", "waves", gt=0)
    smoothing: float = parameter(0.05, "time over which noise in unexplained strains is averaged", "s", gt=0)
    usual_strain: float = parameter(0.1, "strain caused by the command, rms, before the first sample", gt=0)
    least_strain: float = parameter(0.01, "least strain caused by the command for which the misfit is judged", gt=0)


class ChamberGains:
    """Gains and phases of the chambers of a worm of N segments, (CG1).

    Parameters
    ----------
    model : StrainModel
        Model of the strains of a healthy worm.
    noise : float
        Standard deviation of the noise of a strain.
    span : float
        Greatest age of a sample that is used [s].
    trust : GainTrust, optional

    Attributes
    ----------
    gain, phase, doubt : ndarray of float, shape (N, 2)
        Gain and phase [rad] of each chamber, and the larger of the standard deviations of p and q.
    miss : ndarray of float, shape (N, 2)
        Latest strain minus the strain predicted by (CG1). NaN without a strain. It is positive if the chamber is longer
        than predicted.
    expected, healthy : ndarray of float, shape (N, 2)
        Part of the predicted strain that the chamber's own command causes, and the part that it would cause in a
        healthy chamber.
    misfit : ndarray of float, shape (N, 2)
        Rms of the unexplained strain divided by the rms of `expected`, over the last waves. Noise from sample to sample
        is excluded.
    """

    def __init__(
        self, model: StrainModel, noise: float = 0.01, span: float = 2.0, trust: GainTrust | None = None
    ) -> None:
        self._model, self._noise, self._span, self._trust = model, noise, span, trust or GainTrust()
        self._lags = model.time_constants
        weights = model.weights.transpose(2, 0, 1)[:, :, None]
        self._own, self._others = weights[..., 0], weights.copy()
        self._others[..., 0] = 0.0
        self._change = np.array([self._trust.wander, self._trust.wander, self._trust.wander_mean]) ** 2
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        count, trust = self._model.segments, self._trust
        self._state = np.zeros((count, 2, 3))
        self._state[..., 0], self._state[..., 2] = 1.0, self._model.mean[:, None]
        self._most = np.array([trust.begin, trust.begin, trust.begin_mean]) ** 2
        self._covariance = np.zeros((count, 2, 3, 3)) + np.diag(self._most)
        self._variances = np.einsum("ijkk->ijk", self._covariance)  # a view
        self._told: FloatArray | None = None
        self._given = np.zeros((3 * count - 1, 1))
        self._lagged = np.zeros((3 * count - 1, len(self._lags)))
        self._time = self._phase = np.nan
        self._since = 0.0, 0.0
        self._past: deque[tuple[float, FloatArray, FloatArray]] = deque()
        self._left, self._left_power = np.zeros((2, count, 2))
        self._own_power = np.full((count, 2), trust.usual_strain**2)
        self.miss, self.expected, self.healthy = np.full((count, 2), np.nan), *np.zeros((2, count, 2))

    @property
    def gain(self) -> FloatArray:
        """Gain of each chamber, shape (N, 2)."""
        return np.hypot(self._state[..., 0], self._state[..., 1])

    @property
    def phase(self) -> FloatArray:
        """Phase lead of each chamber over a healthy chamber [rad], shape (N, 2)."""
        return np.arctan2(self._state[..., 1], self._state[..., 0])

    @property
    def doubt(self) -> FloatArray:
        """Larger of the standard deviations of p and q, shape (N, 2)."""
        return np.sqrt(np.maximum(self._covariance[..., 0, 0], self._covariance[..., 1, 1]))

    @property
    def misfit(self) -> FloatArray:
        """Unexplained strain divided by the strain that the chamber's own command causes, rms, shape (N, 2)."""
        return np.asarray(np.sqrt(self._left_power / np.maximum(self._own_power, self._trust.least_strain**2)))

    def tell(self, t: float, command: Command) -> None:
        """Set the command that holds from time t [s] on."""
        if self._told is None:
            self._time = t
        self._told = np.concatenate([command.contraction.ravel(), command.hinge])[:, None]

    def take(self, t: float, phase: float, strain: FloatArray | None, instant: float) -> None:
        """Process the strains of the time `instant` [s] that have arrived by time t [s].

        `strain` has the shape (N, 2), with NaN where unknown. `phase` is the phase of the wave at the last command
        [rad].
        """
        if self._told is None or t <= self._time:
            return
        passed, turned = t - self._time, abs(phase - self._phase) if isfinite(self._phase) else 0.0
        self._time, self._phase = t, phase
        x = self._lagged = lagged(self._lagged, self._given, self._told, self._lags, passed)
        self._given = self._told
        rate = turned / passed
        # While the wave stands still, the slopes y are unknown.
        y = (self._given - x) / (self._lags * rate) if rate > 1e-3 else np.zeros_like(x)
        self._past.append((t, x, y))
        while self._past[0][0] < t - self._span:
            self._past.popleft()
        waves = turned / (2.0 * pi)
        self._wander(waves)
        self.miss = np.full_like(self.miss, np.nan)
        self._since = self._since[0] + waves, self._since[1] + passed
        if strain is not None and self._past[0][0] <= instant + 1e-9:
            x, y = next(rows for at, *rows in reversed(self._past) if at <= instant + 1e-9)
            self._correct(strain, x, y, *self._since)
            self._since = 0.0, 0.0

    def _wander(self, waves: float) -> None:
        """Increase the variance of the states by the change expected in the given number of waves."""
        most = np.maximum(self._variances, self._most)
        np.minimum(self._variances + waves * self._change, most, out=self._variances)

    def _correct(self, strain: FloatArray, x: FloatArray, y: FloatArray, waves: float, passed: float) -> None:
        """Process strains with the delayed commands x and their slopes y, shape (3 N - 1, M) each.

        `waves` and `passed` are the number of waves and the time [s] since the last strains. Nothing is learnt while
        the wave stands still, since a model error then lasts as long as the wave stands.
        """
        p, q = self._state[..., 0], self._state[..., 1]
        x, y, chambers = x.T, y.T, p.size
        own, slope = (each[:, :chambers].reshape(-1, *p.shape) for each in (x, y))
        others = (self._others * inputs(p * own + q * slope, x[:, chambers:])).sum(axis=(0, -1))
        own_x, own_y = (self._own * own).sum(axis=0), (self._own * slope).sum(axis=0)
        row = np.stack([own_x, own_y, np.ones_like(own_x)], axis=-1)
        self.expected, self.healthy = p * own_x + q * own_y, own_x
        self.miss = strain - others - self.expected - self._state[..., 2]
        if waves < 1e-6:  # the wave stands still
            return
        known, lasting = np.isfinite(self.miss), max(self._trust.lasts / waves, 1.0)
        miss = np.where(known, self.miss, 0.0)
        spread = np.einsum("ijkl,ijl->ijk", self._covariance, row)
        variance = self._noise**2 + self._trust.missed**2 * lasting + (row * spread).sum(axis=-1)
        gain = (known / variance)[..., None] * spread
        self._state += gain * miss[..., None]
        self._covariance -= gain[..., None] * spread[..., None, :]
        left = miss * (1.0 - (gain * row).sum(axis=-1))
        self._left += (1.0 - np.exp(-passed / self._trust.smoothing)) * (left - self._left)
        judged = known & (np.abs(own_x).max() > self._trust.least_strain)
        share = judged * (1.0 - np.exp(-waves / self._trust.judged))
        self._left_power += share * (self._left**2 - self._left_power)
        self._own_power += share * (self.expected**2 - self._own_power)
