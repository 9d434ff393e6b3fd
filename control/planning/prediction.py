"""Prediction: the reduced model over a horizon of inputs that are constant in each step, with its derivatives.

    X_{k+1} = F(X_k, U_k),   dX_{k+1}/dU = A_k dX_k/dU + B_k dU_k/dU,   A_k = dF/dX, B_k = dF/dU at (X_k, U_k)   (O3)

What the cost counts as a miss, `control.planning.cost`, is a function of each X_{k+1}, U_k and of what is wanted there.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from control.estimation.reduced import INPUTS, STATES, ReducedModel
from worm3d.machine.buffered import Buffered
from worm3d.values.arrays import FloatArray


class Prediction:
    """The states, (O3), and the misses of a horizon.

    Parameters
    ----------
    model : ReducedModel
    misses : casadi.Function
        (state (9,), input (3,), wanted) -> misses (M,).
    step : float
        Time between two states [s].
    steps : int
        Number of steps, at least 2.
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
    """Return the function that gives the derivatives of a value to state and input."""
    slopes = [ca.densify(ca.jacobian(value, to)) for to in (state, given)]
    return ca.Function("slopes", [state, given, *more], ca.cse(slopes))
