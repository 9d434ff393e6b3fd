"""The reduced model over a horizon of constant inputs a step, and how it depends on them.

    X_{k+1} = F(X_k, U_k),   dX_{k+1}/dU = A_k dX_k/dU + B_k dU_k/dU,   A_k = dF/dX, B_k = dF/dU at (X_k, U_k)   (H1)

What is wanted of a state (speed V_ref; point r and heading psi of the path) is missed by

    V - V_ref,   e = (p - r) . n(psi),   h - psi + crab,   crab = u / V_ref                                    (H2)

V being the speed along the heading h, less what slips, and n(psi) = (-sin psi, cos psi) the left of the path. The body
stands across its path by the angle crab, so that its centre of mass follows the path although it is carried to the left
by u. Steering itself carries it so, hence u is that of the state: with the u of an earlier plan, crab and plan chase
each other, and a worm comes back to its line along another way than the cost says.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from control.estimation.reduced import INPUTS, STATES, ReducedModel
from control.planning.buffered import Buffered
from worm3d.values.arrays import FloatArray

GREATEST_CRAB = 0.3
"""By which the body may stand across its path [rad]."""


class Wanted(NamedTuple):
    """What is wanted at the end of a step."""

    speed: ca.SX
    x: ca.SX
    y: ca.SX
    heading: ca.SX
    crab: ca.SX
    """By which the body stands to the right of that heading, for each m/s that it is carried to the left [s/m]."""


WANTED = len(Wanted._fields)
MISSES = 3
"""Speed [m/s], offset to the left [m] and heading [rad]: (H2)."""


class Prediction:
    """(H1) and (H2) over a horizon.

    Parameters
    ----------
    model : ReducedModel
    step : float
        [s]
    steps : int
        At least 2.
    """

    def __init__(self, model: ReducedModel, step: float, steps: int) -> None:
        self.step, self.steps = step, steps
        given, missed = _stage(model, step)
        self._roll = Buffered(given["next"].mapaccum("roll", steps))
        self._slopes = Buffered(given["slopes"].map(steps))
        self._missed = Buffered(missed["miss"].map(steps))
        self._missed_slopes = Buffered(missed["slopes"].map(steps))

    def states(self, begin: FloatArray, inputs: FloatArray) -> FloatArray:
        """Return the states of a horizon, shape (steps + 1, 9), from inputs of shape (steps, 3)."""
        (after,) = self._roll(begin, inputs.T)
        return np.vstack([begin, after.T])

    def misses(self, states: FloatArray, inputs: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return (H2) at the end of each step, shape (steps, 3); `wanted` has shape (steps, 5)."""
        (missed,) = self._missed(states[1:].T, inputs.T, wanted.T)
        return missed.T

    def miss_slopes(self, states: FloatArray, inputs: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return the derivatives of (H2) to all inputs of the horizon, shape (steps, 3, 3 steps)."""
        to_state, to_input = self._missed_slopes(states[1:].T, inputs.T, wanted.T)
        slopes: FloatArray = self._blocks(to_state, STATES) @ self._state_slopes(states, inputs)
        for k, own in enumerate(self._blocks(to_input, INPUTS)):
            slopes[k][:, INPUTS * k : INPUTS * (k + 1)] += own
        return slopes

    def _state_slopes(self, states: FloatArray, inputs: FloatArray) -> FloatArray:
        """Return dX/dU, (H1), shape (steps, 9, 3 steps)."""
        to_state, to_input = self._slopes(states[:-1].T, inputs.T)
        slopes = np.zeros((self.steps, STATES, INPUTS * self.steps))
        before = slopes[0]
        for k, (a, b) in enumerate(zip(self._blocks(to_state, STATES), self._blocks(to_input, INPUTS), strict=True)):
            slopes[k] = a @ before
            slopes[k][:, INPUTS * k : INPUTS * (k + 1)] += b
            before = slopes[k]
        return slopes

    def _blocks(self, side_by_side: FloatArray, columns: int) -> FloatArray:
        """Return the matrices of the steps, which a mapped function puts side by side."""
        return side_by_side.reshape(len(side_by_side), self.steps, columns).transpose(1, 0, 2)


def _stage(model: ReducedModel, step: float) -> tuple[dict[str, ca.Function], dict[str, ca.Function]]:
    """Return the functions of one step: its end and what is missed there, and their derivatives."""
    state, given, wanted = ca.SX.sym("state", STATES), ca.SX.sym("input", INPUTS), ca.SX.sym("wanted", WANTED)
    end = ca.cse(model.step(step)(state, given))  # before it is differentiated: that takes a tenth of the time
    miss = _miss(model, state, given, Wanted(*ca.vertsplit(wanted)))
    return (
        {
            "next": ca.Function("next", [state, given], ca.cse([end])),
            "slopes": ca.Function("slopes", [state, given], ca.cse([*_dense(end, state, given)])),
        },
        {
            "miss": ca.Function("miss", [state, given, wanted], ca.cse([miss])),
            "slopes": ca.Function("slopes", [state, given, wanted], ca.cse([*_dense(miss, state, given)])),
        },
    )


def _dense(value: ca.SX, state: ca.SX, given: ca.SX) -> tuple[ca.SX, ca.SX]:
    return ca.densify(ca.jacobian(value, state)), ca.densify(ca.jacobian(value, given))


def _miss(model: ReducedModel, state: ca.SX, given: ca.SX, wanted: Wanted) -> ca.SX:
    """Return (H2)."""
    velocity, heading = model.output(state, given), state[2]
    speed = velocity[0] * ca.cos(heading) + velocity[1] * ca.sin(heading)
    aside = velocity[1] * ca.cos(heading) - velocity[0] * ca.sin(heading)
    crab = ca.fmax(-GREATEST_CRAB, ca.fmin(GREATEST_CRAB, wanted.crab * aside))
    offset = (state[1] - wanted.y) * ca.cos(wanted.heading) - (state[0] - wanted.x) * ca.sin(wanted.heading)
    return ca.vertcat(speed - wanted.speed, offset, heading - wanted.heading + crab)
