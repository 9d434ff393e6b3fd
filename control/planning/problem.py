"""The least-squares problem of a plan.

With u the inputs scaled to [-1, 1] over the ranges of the identified map, constant over each of H steps, and the misses
(H2) of the reduced model, each over its tolerance a,

    minimise 1/2 sum_k [ ((V - V_ref)/a_V)^2 + (e/a_e)^2 + ((h - psi + crab)/a_h)^2
                         + |(u_k - u_{k-1})/a_rate|^2 + ((f_k - f_0)/a_f)^2 ],   -1 <= u <= 1                   (G2)

where terms drop out for which the reference has no path or heading; without both the steering s is held near 0 by
(s_k/a_s)^2. u_{-1} is what is in force, f_0 the preferred frequency.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from control.estimation.reduced import INPUTS
from control.identification.surrogate import Ranges
from control.planning.prediction import Prediction
from control.planning.preview import Preview
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True)
class Tolerances:
    """Misses that weigh the same, (G2).

    Offset, heading and steering rate were tuned on the default worm with the sensors' default noise, by runs of a
    minute on line, circle and S-curve with the seeds 10 and 11: seven triples of offset (0.01 to 0.02), heading (0.05
    to 0.1) and steering rate (0.25 to 1), as many as `control.baselines.Gains` had. The mean rms offset of the three
    goes from 0.0017 (chosen) to 0.0021 body lengths.

    An offset dies away as exp(-s/L) over the way s, L = a_e/a_h body lengths, once the worm has turned (two seconds),
    if the horizon reaches 2 L or further and L is 0.2 or more: at 0.14 it is a tenth shorter.

    Attributes
    ----------
    speed : float
        a_V [body lengths/s].
    offset : float
        a_e [body lengths].
    heading : float
        a_h [rad].
    amplitude_rate, frequency_rate, steering_rate : float
        a_rate, changes from step to step; shares of half the range, like the next two.
    frequency : float
        a_f.
    steering : float
        a_s.
    """

    speed: float = 0.004
    offset: float = 0.015
    heading: float = 0.07
    amplitude_rate: float = 0.3
    frequency_rate: float = 0.2
    steering_rate: float = 0.25
    frequency: float = 1.0
    steering: float = 0.2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{field.name}: got {value!r}, must be finite and above 0")


class Scale:
    """Inputs scaled to [-1, 1] over the ranges of a map.

    Parameters
    ----------
    ranges : Ranges
    """

    def __init__(self, ranges: Ranges) -> None:
        bounds = np.array([ranges.amplitude, ranges.frequency, (-ranges.steering, ranges.steering)])
        self.half: FloatArray = (bounds[:, 1] - bounds[:, 0]) / 2.0
        self.centre: FloatArray = (bounds[:, 1] + bounds[:, 0]) / 2.0

    def inputs(self, z: FloatArray) -> FloatArray:
        """Return inputs, shape (K, 3), of scaled ones, shape (3 K,)."""
        return self.centre + self.half * z.reshape(-1, INPUTS)

    def scaled(self, inputs: FloatArray) -> FloatArray:
        """Return the scaled inputs, shape (3 K,), of inputs (K, 3)."""
        return np.asarray((inputs - self.centre) / self.half).ravel()


@dataclass(frozen=True, eq=False)
class Problem:
    """(G2) at an instant.

    Attributes
    ----------
    prediction : Prediction
    scale : Scale
    tolerances : Tolerances
    length : float
        Of the body [m].
    state : ndarray, shape (9,)
        Estimated, of the reduced model.
    preview : Preview
    crab : ndarray, shape (H,)
        By which the body is to stand to the right of the path's heading, for each m/s that it is carried to the left
        [s/m].
    before : ndarray, shape (3,)
        u_{-1}
    preferred : float
        f_0, scaled like the inputs.
    """

    prediction: Prediction
    scale: Scale
    tolerances: Tolerances
    length: float
    state: FloatArray
    preview: Preview
    crab: FloatArray
    before: FloatArray
    preferred: float

    def residuals(self, z: FloatArray) -> FloatArray:
        """Return the residuals of scaled inputs z, shape (3 H,)."""
        inputs = self.scale.inputs(z)
        return self._residuals(z, inputs, self.states(inputs))

    def linearised(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals and their derivatives, shape (rows, 3 H)."""
        inputs = self.scale.inputs(z)
        states = self.states(inputs)
        slopes = self.prediction.miss_slopes(states, inputs, self._wanted)
        scaled = self._weights[None, :, None] * slopes * np.tile(self.scale.half, len(inputs))
        return self._residuals(z, inputs, states), np.vstack([scaled.reshape(-1, z.size), self._own])

    def _residuals(self, z: FloatArray, inputs: FloatArray, states: FloatArray) -> FloatArray:
        misses = self._weights * self.prediction.misses(states, inputs, self._wanted)
        return np.concatenate([misses.ravel(), self._own @ z - self._own_target])

    def states(self, inputs: FloatArray) -> FloatArray:
        """Return the predicted states, shape (H + 1, 9)."""
        return self.prediction.states(self.state, inputs)

    @cached_property
    def _wanted(self) -> FloatArray:
        ahead = self.preview
        return np.column_stack([ahead.speed, ahead.point, ahead.heading, self.crab])

    @cached_property
    def _weights(self) -> FloatArray:
        """One over the tolerances of (H2), 0 where nothing is asked for."""
        a, ahead = self.tolerances, self.preview
        speed, offset = 1.0 / (a.speed * self.length), ahead.follows / (a.offset * self.length)
        return np.array([speed, offset, ahead.heads / a.heading])

    @cached_property
    def _own(self) -> FloatArray:
        """The matrix of the terms of (G2) that are linear in the inputs: changes, frequency, steering."""
        a, steps = self.tolerances, self.prediction.steps
        change = np.kron(np.eye(steps) - np.eye(steps, k=-1), np.diag(1.0 / self._rates))
        free = 0.0 if self.preview.heads else 1.0 / a.steering
        return np.vstack([change, np.kron(np.eye(steps), [[0.0, 1.0 / a.frequency, 0.0], [0.0, 0.0, free]])])

    @cached_property
    def _own_target(self) -> FloatArray:
        steps = self.prediction.steps
        change = np.zeros(INPUTS * steps)
        change[:INPUTS] = self.before / self._rates
        return np.concatenate([change, np.tile([self.preferred / self.tolerances.frequency, 0.0], steps)])

    @property
    def _rates(self) -> FloatArray:
        a = self.tolerances
        return np.array([a.amplitude_rate, a.frequency_rate, a.steering_rate])
