"""The cost of a plan, a sum of squares of the terms and constraints over a horizon of H steps.

The inputs u are constant in each step, and scaled so that [-1, 1] is the range of the identified map. Let m_k be the
misses and c_k the excesses of the reduced model at the end of step k, each divided by its tolerance
(`control.planning.terms`, `control.planning.constraints`). Then the problem is

    minimise 1/2 sum_k [ |m_k|^2 + |max(0, c_k)|^2 ],   -1 <= u <= 1                                           (O2)

There are two exceptions to the bounds: frequencies may be lower than any identified frequency, and amplitudes change
their sign where the worm goes backwards. Terms without a goal in the reference are left out. The states and their
derivatives follow from the reduced model:

    X_{k+1} = F(X_k, U_k),   dX_{k+1}/dU = A_k dX_k/dU + B_k dU_k/dU,   A_k = dF/dX, B_k = dF/dU at (X_k, U_k)   (O3)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from control.estimation.reduced import INDEX, INPUTS, STATES, ReducedInput, ReducedModel, ReducedState
from control.identification.identified import SteeringMap
from control.identification.surrogate import Ranges
from control.planning.constraints import Constraint
from control.planning.terms import CostTerm, Moment, Wanted
from control.tracking.preview import Preview
from worm3d.machine.buffered import Buffered
from worm3d.values.arrays import FloatArray

WANTED = len(Wanted._fields)


class Scale:
    """Scaling of inputs, so that [-1, 1] is the range of a map."""

    def __init__(self, ranges: Ranges) -> None:
        ends = np.array([ranges.amplitude, ranges.frequency, (-ranges.steering, ranges.steering)])
        self.half: FloatArray = (ends[:, 1] - ends[:, 0]) / 2.0
        self.centre: FloatArray = (ends[:, 1] + ends[:, 0]) / 2.0
        self.bounds: FloatArray = (ranges.bounds - self.centre) / self.half
        """Least and greatest allowed scaled inputs, shape (2, 3)."""

    def inputs(self, z: FloatArray) -> FloatArray:
        """Return the inputs, shape (K, 3), that belong to the scaled inputs `z`, shape (3 K,)."""
        return self.centre + self.half * z.reshape(-1, INPUTS)

    def sized(self, scaled: ca.SX) -> ca.SX:
        """Return the scaled inputs with the amplitude replaced by its absolute value, shape (3,).

        In backward waves the amplitude is negative.
        """
        (centre, *_), (half, *_) = self.centre, self.half
        return ca.vertcat((ca.fabs(centre + half * scaled[0]) - centre) / half, scaled[1:])

    def scaled(self, inputs: FloatArray) -> FloatArray:
        """Return the scaled inputs, shape (3 K,), that belong to `inputs`, shape (K, 3)."""
        return np.asarray((inputs - self.centre) / self.half).ravel()


class Cost(NamedTuple):
    """Terms and constraints of a plan, combined in one CasADi function."""

    terms: tuple[CostTerm, ...]
    constraints: tuple[Constraint, ...]
    rows: tuple[int, ...]
    """Number of misses of each term, followed by the number of excesses of each constraint."""
    function: ca.Function
    """(state, scaled input (3,), scaled input of the previous step (3,), wanted (10,)) -> misses of all terms followed
    by all excesses, shape (M,)."""

    @classmethod
    def of(
        cls,
        model: ReducedModel,
        found: SteeringMap,
        length: float,
        terms: Sequence[CostTerm],
        constraints: Sequence[Constraint],
    ) -> Cost:
        """Return the cost for a worm with the given model, map and body length [m].

        Constraints on quantities that the map does not contain are left out.

        Raises
        ------
        ValueError
            There are no terms, an entry is not a term or constraint, or its value is not a vector of symbols.
        """
        if not terms:
            raise ValueError("terms: got none, must be at least one: control.planning.terms.default_terms()")
        for name, given, kind in (("terms", terms, CostTerm), ("constraints", constraints, Constraint)):
            wrong = next((part for part in given if not isinstance(part, kind)), None)
            if wrong is not None:
                raise ValueError(
                    f"{name}: got {type(wrong).__name__}, must be each a {kind.__module__}.{kind.__name__}"
                )
        state, wanted = ca.SX.sym("state", STATES), ca.SX.sym("wanted", WANTED)
        scaled, before = ca.SX.sym("scaled", INPUTS), ca.SX.sym("before", INPUTS)
        at = _moment(model, found, length, state, scaled, before, wanted)
        misses = [(term, _vector(term, term.misses(at))) for term in terms]
        excesses = [(limit, _vector(limit, limit.excesses(at))) for limit in constraints]
        asked = [(limit, value) for limit, value in excesses if ca.symvar(value)]
        values = [value for _, value in misses] + [value for _, value in asked]
        names = ["state", "scaled", "before", "wanted"]
        function = ca.Function("cost", [state, scaled, before, wanted], [ca.vertcat(*values)], names, ["misses"])
        rows = tuple(value.numel() for value in values)
        return cls(tuple(terms), tuple(limit for limit, _ in asked), rows, function)

    def weights(self, ahead: Preview) -> FloatArray:
        """Return the factors of all misses and excesses at the end of each step, shape (H, M)."""
        parts: list[CostTerm | Constraint] = [*self.terms, *self.constraints]
        columns = [np.full(len(ahead.speed), part.weight(ahead), dtype=float) for part in parts]
        return np.repeat(np.column_stack(columns), self.rows, axis=1)

    @property
    def misses(self) -> int:
        """Number of misses. The excesses follow the misses in the vector."""
        return sum(self.rows[: len(self.terms)])


def _moment(
    model: ReducedModel, found: SteeringMap, length: float, state: ca.SX, scaled: ca.SX, before: ca.SX, wanted: ca.SX
) -> Moment:
    scale = Scale(found.ranges)
    given = ca.DM(scale.centre) + ca.DM(scale.half) * scaled
    size = ca.fabs(given[0])
    velocity, heading = model.output(state, given), state[INDEX["heading"]]
    least = found.ranges.frequency[0]
    return Moment(
        state=ReducedState(*ca.vertsplit(state)),
        given=ReducedInput(*ca.vertsplit(given)),
        scaled=scale.sized(scaled),
        before=scale.sized(before),
        speed=velocity[0] * ca.cos(heading) + velocity[1] * ca.sin(heading),
        sideways=velocity[1] * ca.cos(heading) - velocity[0] * ca.sin(heading),
        turn_rate=velocity[2],
        roll=ca.SX(0) if found.roll is None else found.roll(size, ca.fmax(given[1], least), state[INDEX["steering"]]),
        wanted=Wanted(*ca.vertsplit(wanted)),
        length=length,
    )


def _vector(part: CostTerm | Constraint, value: ca.SX) -> ca.SX:
    """Return the values of a part as a dense column. ValueError if they are not a column of symbols."""
    try:
        vector = ca.densify(ca.SX(value))
    except NotImplementedError:
        vector = ca.SX()
    if vector.numel() == 0 or vector.size2() != 1:
        got = f"shape {vector.shape}" if vector.numel() else type(value).__name__
        raise ValueError(f"{type(part).__name__}: got misses of {got}, must be a column of CasADi's SX")
    return vector


class Prediction:
    """Prediction of the states, (O3), and of the misses over a horizon of at least two steps.

    Parameters
    ----------
    model : ReducedModel
    cost : casadi.Function
        `Cost.function`.
    step : float
        Time between two states [s].
    steps : int
    scale : Scale
    """

    def __init__(self, model: ReducedModel, cost: ca.Function, step: float, steps: int, scale: Scale) -> None:
        self.step, self.steps, self.scale = step, steps, scale
        state, scaled, before, wanted = cost.sx_in()
        given = ca.DM(scale.centre) + ca.DM(scale.half) * scaled
        end = ca.cse(model.step(step)(state, given))  # before the differentiation, which then takes a tenth of the time
        missed = cost(state, scaled, before, wanted)
        self._states = Buffered(ca.Function("next", [state, scaled], ca.cse([end])).mapaccum("roll", steps))
        self._state_slopes = Buffered(_slopes(end, [state, scaled], []).map(steps))
        self._misses = Buffered(ca.Function("miss", [state, scaled, before, wanted], ca.cse([missed])).map(steps))
        self._miss_slopes = Buffered(_slopes(missed, [state, scaled, before], [wanted]).map(steps))

    def states(self, begin: FloatArray, z: FloatArray) -> FloatArray:
        """Return the states over the horizon, shape (steps + 1, n).

        `z` contains the scaled inputs, shape (3 steps,).
        """
        (after,) = self._states(begin, z.reshape(-1, INPUTS).T)
        return np.vstack([begin, after.T])

    def misses(self, states: FloatArray, z: FloatArray, before: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return the misses and excesses at the end of each step, shape (steps, M).

        `before` contains the scaled inputs in force before the first step, shape (3,).
        """
        (missed,) = self._misses(states[1:].T, *_pairs(z, before), wanted.T)
        return missed.T

    def miss_slopes(self, states: FloatArray, z: FloatArray, before: FloatArray, wanted: FloatArray) -> FloatArray:
        """Return the derivatives of `misses` with respect to all scaled inputs, shape (steps, M, 3 steps)."""
        to_state, to_input, to_before = self._miss_slopes(states[1:].T, *_pairs(z, before), wanted.T)
        slopes: FloatArray = self._by_step(to_state, STATES) @ self._slopes_of_states(states, z)
        own, earlier = self._by_step(to_input, INPUTS), self._by_step(to_before, INPUTS)
        for k in range(self.steps):
            slopes[k][:, INPUTS * k : INPUTS * (k + 1)] += own[k]
            if k > 0:
                slopes[k][:, INPUTS * (k - 1) : INPUTS * k] += earlier[k]
        return slopes

    def _slopes_of_states(self, states: FloatArray, z: FloatArray) -> FloatArray:
        """Return dX/dU, (O3), shape (steps, n, 3 steps)."""
        to_state, to_input = self._state_slopes(states[:-1].T, z.reshape(-1, INPUTS).T)
        slopes = np.zeros((self.steps, STATES, INPUTS * self.steps))
        for k, (a, b) in enumerate(zip(self._by_step(to_state, STATES), self._by_step(to_input, INPUTS), strict=True)):
            slopes[k] = a @ slopes[k - 1]  # slopes[-1] before the first step, still 0
            slopes[k][:, INPUTS * k : INPUTS * (k + 1)] += b
        return slopes

    def _by_step(self, side_by_side: FloatArray, columns: int) -> FloatArray:
        """Return the matrices of the single steps. A mapped CasADi function returns them side by side."""
        return side_by_side.reshape(len(side_by_side), self.steps, columns).transpose(1, 0, 2)


def _pairs(z: FloatArray, before: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the inputs of each step and the inputs of its previous step, each of shape (3, steps)."""
    inputs = z.reshape(-1, INPUTS)
    return inputs.T, np.vstack([before, inputs[:-1]]).T


def _slopes(value: ca.SX, to: list[ca.SX], more: list[ca.SX]) -> ca.Function:
    return ca.Function("slopes", [*to, *more], ca.cse([ca.densify(ca.jacobian(value, each)) for each in to]))


@dataclass(frozen=True, eq=False)
class Problem:
    """Problem (O2) at one instant, as residuals that depend on the scaled inputs z, shape (3 H,).

    The residuals are the misses, followed by `limits` excesses.
    """

    prediction: Prediction
    cost: Cost
    state: FloatArray
    """Estimated state of the reduced model."""
    preview: Preview
    slowest: float
    """Smallest speed that is used as a divisor in the crab angle [m/s]."""
    before: FloatArray
    """Scaled inputs in force before the first step, u_{-1}, shape (3,)."""
    frequency: FloatArray
    """Preferred frequencies f_0 of the steps, scaled like the inputs, shape (H,)."""

    def residuals(self, z: FloatArray) -> FloatArray:
        """Return the residuals, shape (rows,)."""
        return self._rows(self.prediction.misses(self.states(z), z, self.before, self._wanted))

    def linearised(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the residuals, shape (rows,), and their derivatives, shape (rows, 3 H)."""
        states = self.states(z)
        slopes = self.prediction.miss_slopes(states, z, self.before, self._wanted)
        return self._rows(self.prediction.misses(states, z, self.before, self._wanted)), self._rows(slopes)

    def states(self, z: FloatArray) -> FloatArray:
        """Return the predicted states, shape (H + 1, n)."""
        return self.prediction.states(self.state, z)

    @property
    def limits(self) -> int:
        """Number of excesses. These are the last residuals, and they count only where they are above 0."""
        return int(self._asked[:, self.cost.misses :].sum())

    def _rows(self, values: FloatArray) -> FloatArray:
        """Return the weighted misses, followed by the weighted excesses. Rows with zero weight are left out.

        `values` has the shape (H, M, ...).
        """
        weights, misses = self._weights, self.cost.misses
        weighted = values * weights.reshape(*weights.shape, *[1] * (values.ndim - 2))
        parts = [weighted[:, part][self._asked[:, part]] for part in (slice(misses), slice(misses, None))]
        return np.concatenate(parts)

    @cached_property
    def _weights(self) -> FloatArray:
        return self.cost.weights(self.preview)

    @cached_property
    def _asked(self) -> np.ndarray:
        return self._weights > 0.0

    @cached_property
    def _wanted(self) -> FloatArray:
        ahead = self.preview
        crab = ahead.follows * ahead.ways / np.maximum(np.abs(ahead.speed), self.slowest)
        # A bound of a kilometre has no effect, but is finite.
        bounds = np.minimum([ahead.left, ahead.right, ahead.room_left, ahead.room_right], 1e3)
        return np.column_stack([ahead.speed, ahead.point, ahead.heading, crab, self.frequency, *bounds])
