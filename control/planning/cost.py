"""The cost of a plan, term by term; to change what a plan is to achieve, change `MISSES`, `Problem` or `Tolerances`.

With u the inputs scaled to [-1, 1] over the ranges of the identified map, constant over each of H steps, and the misses
of the reduced model at the end of each step, each over its tolerance a,

    minimise 1/2 sum_k [ ((V - V_ref)/a_V)^2 + (e/a_e)^2 + ((h - psi + crab)/a_h)^2
                         + |(u_k - u_{k-1})/a_rate|^2 + ((f_k - f_0)/a_f)^2 ],   -1 <= u <= 1                   (O2)

where terms drop out for which the reference has no path or heading; without both the steering s is held near 0 by
(s_k/a_s)^2. u_{-1} is what is in force, f_0 the preferred frequency. With the speed V_ref, point r and heading psi that
the reference asks for, the misses of a state are

    V - V_ref,   e = (p - r) . n(psi),   h - psi + crab,   crab = u / V_ref                                    (O4)

V being the speed along the heading h, less what slips, and n(psi) = (-sin psi, cos psi) the left of the path. The body
stands across its path by the angle crab, so that its centre of mass follows the path although it is carried to the left
by u. Steering itself carries it so, hence u is that of the state: with the u of an earlier plan, crab and plan chase
each other, and a worm comes back to its line along another way than the cost says.

States and their derivatives follow the reduced model over inputs that are constant in each step:

    X_{k+1} = F(X_k, U_k),   dX_{k+1}/dU = A_k dX_k/dU + B_k dU_k/dU,   A_k = dF/dX, B_k = dF/dU at (X_k, U_k)   (O3)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from control.estimation.reduced import INPUTS, STATES, ReducedModel
from control.identification.surrogate import Ranges
from control.tracking.references import Preview
from worm3d.machine.buffered import Buffered
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter

MAX_CRAB = 0.3
"""Largest angle by which the body may stand across its path [rad]."""


@documented
@dataclass(frozen=True)
class Tolerances:
    """Misses that weigh the same, (O2).

    Offset (0.01 to 0.02), heading (0.05 to 0.1) and steering rate (0.25 to 1) were tuned on the default worm with the
    sensors' default noise: seven triples in runs of a minute on line, circle and S-curve with the seeds 10 and 11, as
    many as `control.baselines.Gains` had; mean rms offsets are 0.0017 (chosen) to 0.0021 body lengths.

    An offset dies away as exp(-s/L) over the way s, L = a_e/a_h body lengths, once the worm has turned (two seconds),
    if the horizon reaches 2 L or further and L is 0.2 or more: at 0.14 it is a tenth shorter.
    """

    speed: float = parameter(0.004, unit="body lengths/s", gt=0, meaning="a_V, miss of the speed")
    offset: float = parameter(0.015, unit="body lengths", gt=0, meaning="a_e, offset from the path")
    heading: float = parameter(0.07, unit="rad", gt=0, meaning="a_h, miss of the heading")
    # The others are shares of half the range of the input.
    amplitude_rate: float = parameter(0.3, gt=0, meaning="a_rate, change of the amplitude from step to step")
    frequency_rate: float = parameter(0.2, gt=0, meaning="a_rate, change of the frequency")
    steering_rate: float = parameter(0.25, gt=0, meaning="a_rate, change of the steering")
    frequency: float = parameter(1.0, gt=0, meaning="a_f, distance of the frequency from the preferred one")
    steering: float = parameter(0.2, gt=0, meaning="a_s, steering where nothing is to be followed")

    def __post_init__(self) -> None:
        check(self)


class Wanted(NamedTuple):
    """What the reference asks for at the end of a step."""

    speed: ca.SX
    x: ca.SX
    y: ca.SX
    heading: ca.SX
    crab: ca.SX
    """Angle by which the body is to stand to the right of that heading, for each m/s of speed to the left [s/m]."""


class Moment(NamedTuple):
    """The worm at the end of a step, and what is wanted of it there."""

    x: ca.SX
    y: ca.SX
    heading: ca.SX
    speed: ca.SX
    """Speed along the heading, less what slips [m/s]."""
    sideways: ca.SX
    """Speed to the left of the heading [m/s]."""
    wanted: Wanted


def _offset(at: Moment) -> ca.SX:
    wanted = at.wanted
    return (at.y - wanted.y) * ca.cos(wanted.heading) - (at.x - wanted.x) * ca.sin(wanted.heading)


def _heading(at: Moment) -> ca.SX:
    crab = ca.fmax(-MAX_CRAB, ca.fmin(MAX_CRAB, at.wanted.crab * at.sideways))
    return at.heading - at.wanted.heading + crab


class Miss(NamedTuple):
    """A term of the cost: a miss of the predicted motion, squared over its tolerance."""

    of: Callable[[Moment], ca.SX]
    tolerance: Callable[[Tolerances, float], float]
    """Tolerance in the unit of the miss, from the tolerances and the body's length [m]."""
    asked: Callable[[Preview], bool]
    """Whether the reference asks for it at all."""


MISSES: dict[str, Miss] = {
    "speed": Miss(lambda at: at.speed - at.wanted.speed, lambda a, length: a.speed * length, lambda ahead: True),
    "offset": Miss(_offset, lambda a, length: a.offset * length, lambda ahead: ahead.follows),
    "heading": Miss(_heading, lambda a, length: a.heading, lambda ahead: ahead.heads),
}
"""(O4) by name."""


def misses_of(model: ReducedModel) -> ca.Function:
    """Return the function (state (9,), input (3,), wanted (5,)) -> (O4), in the order of `MISSES`."""
    state, given = ca.SX.sym("state", STATES), ca.SX.sym("input", INPUTS)
    wanted = ca.SX.sym("wanted", len(Wanted._fields))
    velocity, heading = model.output(state, given), state[2]
    along = velocity[0] * ca.cos(heading) + velocity[1] * ca.sin(heading)
    sideways = velocity[1] * ca.cos(heading) - velocity[0] * ca.sin(heading)
    at = Moment(state[0], state[1], heading, along, sideways, Wanted(*ca.vertsplit(wanted)))
    missed = ca.vertcat(*(miss.of(at) for miss in MISSES.values()))
    return ca.Function("misses", [state, given, wanted], [missed], ["state", "input", "wanted"], ["misses"])


class Scale:
    """Inputs scaled to [-1, 1] over the ranges of a map."""

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


class Prediction:
    """The states, (O3), and the misses of a horizon of at least two steps.

    Parameters
    ----------
    model : ReducedModel
    misses : casadi.Function
        (state (9,), input (3,), wanted) -> misses (M,).
    step : float
        Time between two states [s].
    steps : int
    """

    def __init__(self, model: ReducedModel, misses: ca.Function, step: float, steps: int) -> None:
        self.step, self.steps = step, steps
        state, given, wanted = misses.sx_in()
        end = ca.cse(model.step(step)(state, given))  # before it is differentiated: that takes a tenth of the time
        missed = misses(state, given, wanted)
        self._states = Buffered(ca.Function("next", [state, given], ca.cse([end])).mapaccum("roll", steps))
        self._state_slopes = Buffered(_slopes(end, state, given, []).map(steps))
        self._misses = Buffered(ca.Function("miss", [state, given, wanted], ca.cse([missed])).map(steps))
        self._miss_slopes = Buffered(_slopes(missed, state, given, [wanted]).map(steps))

    def states(self, begin: FloatArray, inputs: FloatArray) -> FloatArray:
        """Return the states of a horizon, shape (steps + 1, 9), from inputs of shape (steps, 3)."""
        (after,) = self._states(begin, inputs.T)
        return np.vstack([begin, after.T])

    def misses(self, states: FloatArray, inputs: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return what is missed at the end of each step, shape (steps, M)."""
        (missed,) = self._misses(states[1:].T, inputs.T, wanted.T)
        return missed.T

    def miss_slopes(self, states: FloatArray, inputs: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return the derivatives of the misses to all inputs of the horizon, shape (steps, M, 3 steps)."""
        to_state, to_input = self._miss_slopes(states[1:].T, inputs.T, wanted.T)
        slopes: FloatArray = self._by_step(to_state, STATES) @ self._slopes_of_states(states, inputs)
        for k, own in enumerate(self._by_step(to_input, INPUTS)):
            slopes[k][:, INPUTS * k : INPUTS * (k + 1)] += own
        return slopes

    def _slopes_of_states(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """Return dX/dU, (O3), shape (steps, 9, 3 steps)."""
        to_state, to_input = self._state_slopes(states[:-1].T, inputs.T)
        slopes = np.zeros((self.steps, STATES, INPUTS * self.steps))
        before = slopes[0]
        for k, (a, b) in enumerate(zip(self._by_step(to_state, STATES), self._by_step(to_input, INPUTS), strict=True)):
            slopes[k] = a @ before
            slopes[k][:, INPUTS * k : INPUTS * (k + 1)] += b
            before = slopes[k]
        return slopes

    def _by_step(self, side_by_side: FloatArray, columns: int) -> FloatArray:
        """Return the matrices of the steps, which a mapped function puts side by side."""
        return side_by_side.reshape(len(side_by_side), self.steps, columns).transpose(1, 0, 2)


def _slopes(value: ca.SX, state: ca.SX, given: ca.SX, more: list[ca.SX]) -> ca.Function:
    slopes = [ca.densify(ca.jacobian(value, to)) for to in (state, given)]
    return ca.Function("slopes", [state, given, *more], ca.cse(slopes))


@dataclass(frozen=True, eq=False)
class Problem:
    """(O2) at an instant, as residuals of scaled inputs z, shape (3 H,)."""

    prediction: Prediction
    scale: Scale
    tolerances: Tolerances
    length: float
    """Length of the body [m]."""
    state: FloatArray
    """Estimated state of the reduced model, shape (9,)."""
    preview: Preview
    slowest: float
    """Speed below which the worm had better stand [m/s]; it bounds the crab angle of a slow worm."""
    before: FloatArray
    """Inputs in force, u_{-1}, shape (3,)."""
    preferred: float
    """Preferred frequency f_0, scaled like the inputs."""

    def residuals(self, z: FloatArray) -> FloatArray:
        """Return the residuals: the misses of each step, then the terms of the inputs alone."""
        inputs = self.scale.inputs(z)
        return self._residuals(z, inputs, self.states(inputs))

    def linearised(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals and their derivatives, shape (rows, 3 H)."""
        inputs = self.scale.inputs(z)
        states = self.states(inputs)
        slopes = self.prediction.miss_slopes(states, inputs, self._wanted)
        scaled = self._weights[None, :, None] * slopes * np.tile(self.scale.half, len(inputs))
        return self._residuals(z, inputs, states), np.vstack([scaled.reshape(-1, z.size), self._of_inputs[0]])

    def states(self, inputs: FloatArray) -> FloatArray:
        """Return the predicted states, shape (H + 1, 9)."""
        return self.prediction.states(self.state, inputs)

    def _residuals(self, z: FloatArray, inputs: FloatArray, states: FloatArray) -> FloatArray:
        misses = self._weights * self.prediction.misses(states, inputs, self._wanted)
        matrix, target = self._of_inputs
        return np.concatenate([misses.ravel(), matrix @ z - target])

    @cached_property
    def _wanted(self) -> FloatArray:
        ahead = self.preview
        crab = ahead.follows / np.maximum(ahead.speed, self.slowest)
        return np.column_stack([ahead.speed, ahead.point, ahead.heading, crab])

    @cached_property
    def _weights(self) -> FloatArray:
        """One over the tolerance of each miss, 0 where nothing is asked for."""
        a, length, ahead = self.tolerances, self.length, self.preview
        return np.array([miss.asked(ahead) / miss.tolerance(a, length) for miss in MISSES.values()])

    @cached_property
    def _of_inputs(self) -> tuple[FloatArray, FloatArray]:
        """Matrix and target of the terms that are linear in the inputs: changes, then frequency and steering."""
        a, steps = self.tolerances, self.prediction.steps
        rates = np.array([a.amplitude_rate, a.frequency_rate, a.steering_rate])
        change = np.kron(np.eye(steps) - np.eye(steps, k=-1), np.diag(1.0 / rates))
        straight = 0.0 if self.preview.heads else 1.0 / a.steering
        stay = np.kron(np.eye(steps), [[0.0, 1.0 / a.frequency, 0.0], [0.0, 0.0, straight]])
        begin = np.concatenate([self.before / rates, np.zeros(INPUTS * (steps - 1))])
        preferred = np.tile([self.preferred / a.frequency, 0.0], steps)
        return np.vstack([change, stay]), np.concatenate([begin, preferred])
