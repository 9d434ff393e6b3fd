"""Model predictive control of the gait's parameters: amplitude, frequency and steering over the next waves.

The cost (O2) of a plan consists of the terms in `control.planning.terms` and `control.planning.constraints`. Estimated
slip, yaw bias and drift are part of the prediction, and are constant over the horizon. Therefore the corresponding
disturbances cause almost no lasting error. If a disturbance turns the worm (the yaw bias differs significantly from 0),
the estimate is not accurate enough, however, and a lasting offset e remains. The reference r is then shifted along its
normal n by the bounded integral of e, with the time constant T:

    e_lasting' = e / T,   r -> r - e_lasting n                                                                (P4)

The speed V has a separate integral. It is needed because slow waves that turn sharply are faster than plain waves of
the same frequency, and the planner uses no slower frequencies than the plain waves. The integral corrects small errors
of the speed, but does not react to the large errors after a change of the requested speed:

    trim' = (1 - V/V_ref)/T,   V_ref -> V_ref (1 + trim)                                                      (P5)

The search starts from the better of two waves, which are the previous plan and the plain wave of the feed-forward. The
result is never worse than either of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from control.estimation.estimate import HEADING, SIGNIFICANT_EXCESS, Estimate
from control.estimation.reduced import INDEX, INPUTS, ReducedInput, ReducedModel, ReducedState
from control.gaits.steering import GaitParameters
from control.identification.identified import Identified
from control.planning.constraints import Constraint, default_constraints
from control.planning.cost import Cost, Prediction, Problem, Scale
from control.planning.feed_forward import FeedForward
from control.planning.gauss_newton import GaussNewton, PlanStatus, Solution, half_square
from control.planning.terms import CostTerm, default_terms
from control.tracking.paths import offset
from control.tracking.preview import Ability, Preview, look_ahead, speed_at, turn_rate
from control.tracking.references import Reference
from worm3d import Worm
from worm3d.values.arrays import FloatArray

SIGNIFICANT_YAW_BIAS = 2.0
"""The integral of (P4) changes only if the yaw bias differs from 0 by more than this number of standard deviations."""
INTEGRAL_TIME_CONSTANT = 6.4
"""Time constant T of (P4) and (P5) [waves]. Other offsets decay with a quarter of this time constant."""
MOST_LASTING = 0.01
"""Greatest offset that is integrated as a lasting offset [body lengths]. With a larger offset the worm is still
returning to the path."""
MOST_MISSED = 0.25
"""Greatest relative error of the speed that is integrated, and the greatest trim of (P5). While the error is larger,
the trim decays."""
MOST_UNSURE = 0.02
"""Upper limit of the standard deviation of the position in the distance that is kept from obstacles [body lengths].
With a greater limit, the worm would leave the path between obstacles, where both sides already have all the available
room."""
LEAST_SHARE = 0.5
"""Smallest share of the gait's speed that the plain wave assumes to remain, however large the estimated slip is."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Inputs over a horizon of H steps. All numbers are NaN if there is no plan."""

    time: float
    """Start of the horizon [s]."""
    step: float
    """Duration of each step [s]. The input is constant during a step."""
    inputs: FloatArray
    """Amplitude, frequency [Hz] and steering, shape (H, 3)."""
    horizon: FloatArray
    """Predicted path of the centre of mass [m], shape (H + 1, 2)."""
    status: PlanStatus
    seconds: float
    """Time taken by the planning [s]."""
    parameters: GaitParameters | None = None
    """Gait parameters of the first input. None if there is no plan."""
    iterations: int = 0
    """Number of quadratic programmes that were solved."""
    cost: float = nan
    """Cost of the plan, (O2)."""
    plain_cost: float = nan
    """Cost of the better start of the search. The two starts are the previous plan, shifted in time, and the plain
    wave."""
    certificate: float = nan
    """Distance from a minimum, `control.planning.gauss_newton.Solution.certificate`."""

    def at(self, t: ArrayLike) -> FloatArray:
        """Return the inputs at given times.

        The times `t` may have any shape (...) [s]; the result has the shape (..., 3). Before the first step and after
        the last step, the input of the nearest step is returned.
        """
        # A time that equals the start of a step except for rounding lies within that step.
        k = np.floor((np.asarray(t, dtype=float) - self.time) / self.step + 1e-9).astype(int)
        return np.asarray(self.inputs[np.clip(k, 0, len(self.inputs) - 1)])


class GaitMPC:
    """The planner of the gait's parameters.

    Parameters
    ----------
    worm : Worm
    identified : Identified
        Maps of the worm; `model` was built from these maps.
    model : ReducedModel
    terms : sequence of CostTerm, optional
        Terms of the cost; by default `control.planning.terms.default_terms`.
    constraints : sequence of Constraint, optional
        Constraints on a plan; by default `control.planning.constraints.default_constraints`.
    step : float
        Time step of the prediction [s].
    steps : int
        Number of steps, H.
    iterations : int
        Maximum number of iterations per plan. The next plan continues the search, so that more iterations make no
        visible difference.

    Raises
    ------
    ValueError
        The step is not above 0, there are fewer than two steps or no iteration, or an entry is not a term or
        constraint.
    """

    def __init__(
        self,
        worm: Worm,
        identified: Identified,
        model: ReducedModel,
        terms: Sequence[CostTerm] | None = None,
        constraints: Sequence[Constraint] | None = None,
        step: float = 0.4,
        steps: int = 16,
        iterations: int = 2,
    ) -> None:
        for name, value, least in (("steps", steps, 2), ("iterations", iterations, 1)):
            if value < least:
                raise ValueError(f"{name}: got {value!r}, must be at least {least}")
        found = identified.maps[model.mechanism]
        self.feed_forward = FeedForward(found, worm.length, identified.backward)
        self._model, self._scale = model, Scale(found.ranges)
        self._length, self._lasts = worm.length, INTEGRAL_TIME_CONSTANT * self.feed_forward.wave
        terms = default_terms() if terms is None else terms
        constraints = default_constraints() if constraints is None else constraints
        self.cost = Cost.of(model, found, worm.length, terms, constraints)
        self._prediction = Prediction(model, self.cost.function, step, steps, self._scale)
        self._search = GaussNewton(INPUTS * steps, iterations)
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._near: float | None = None
        self._lasting, self._trim, self._latest = 0.0, 0.0, nan
        self.forget()

    def forget(self) -> None:
        """Discard the last plan. The next search then starts from the plain wave."""
        self._last: Plan | None = None

    @property
    def progress(self) -> float:
        """Arc length of the worm on the path at the last plan [m]. It is 0 before the first plan."""
        return self._near or 0.0

    def plan(self, t: float, estimate: Estimate, reference: Reference) -> Plan:
        """Return the plan from time t [s] on. `estimate` is the estimate at this instant."""
        began = perf_counter()
        preview = self._preview(t, estimate, reference)
        if preview is None:
            step, steps = self._prediction.step, self._prediction.steps
            inputs, horizon = np.full((steps, INPUTS), nan), np.full((steps + 1, 2), nan)
            return Plan(t, step, inputs, horizon, PlanStatus.NOT_FINITE, perf_counter() - began)
        waves = self._candidates(t, estimate, reference)
        problem = self._problem(t, estimate.state, preview, waves[-1])
        found, plain_cost = self._searched(problem, waves)
        plan = self._made(t, problem, found, plain_cost, began)
        if plan.status.ok:
            self._last = plan
        return plan

    def plain(self, t: float, slip: float, reference: Reference) -> ReducedInput:
        """Return the plain wave, which is the feed-forward of the reference at time t [s] for a given slip."""
        kept, able = max(1.0 - slip, LEAST_SHARE), self._able(slip)
        speed = float(speed_at(reference, t, self.progress, able))
        return self.feed_forward(speed / kept, turn_rate(reference, t, self.progress, able))

    def _able(self, slip: float, turn_gain: float = 1.0) -> Ability:
        """Return the speeds that a worm can reach if it slips and turns differently from the map."""
        kept = max(1.0 - slip, LEAST_SHARE)
        return Ability(
            lambda curvature: kept * self.feed_forward.reach(kept / turn_gain * curvature),
            self._length,
            self.feed_forward.wave,
        )

    def _preview(self, t: float, estimate: Estimate, reference: Reference) -> Preview | None:
        """Return the preview of the reference, or None if the preview or the estimate is not finite."""
        if not all(isfinite(part) for part in estimate.state):
            return None
        step, steps = self._prediction.step, self._prediction.steps
        able = self._able(float(estimate.state.slip), max(float(estimate.state.turn_gain), LEAST_SHARE))
        preview = look_ahead(reference, t, step, steps, estimate.position, estimate.heading, self._near, able)
        if not all(np.isfinite(part).all() for part in (preview.speed, preview.point, preview.heading)):
            return None
        self._near = preview.progress
        passed, self._latest = min(max(t - self._latest, 0.0), 1.0) if isfinite(self._latest) else 0.0, t
        preview = self._paced(passed, estimate, preview)
        preview = self._kept_off(estimate, preview)
        follows = preview.follows and not preview.walled
        return self._beside(passed, estimate, reference, preview) if follows else preview

    def _paced(self, passed: float, estimate: Estimate, preview: Preview) -> Preview:
        """Return a preview with speeds that compensate a lasting error of the speed, (P5)."""
        asked = float(preview.speed[0])
        miss = 1.0 - estimate.speed / asked if asked != 0.0 else inf
        change = miss if abs(miss) < MOST_MISSED else -self._trim
        self._trim = min(max(self._trim + change * passed / self._lasts, -MOST_MISSED), MOST_MISSED)
        return replace(preview, speed=preview.speed * (1.0 + self._trim))

    def _beside(self, passed: float, estimate: Estimate, reference: Reference, preview: Preview) -> Preview:
        """Return a preview that is shifted against a lasting offset, (P4)."""
        assert reference.path is not None
        most = MOST_LASTING * self._length
        aside = float(offset(reference.path, estimate.position, preview.progress))
        turned = abs(estimate.state.yaw_bias) > SIGNIFICANT_YAW_BIAS * estimate.deviations[INDEX["yaw_bias"]]
        if turned and abs(aside) < most and preview.speed[0] != 0.0:
            self._lasting = min(max(self._lasting + aside * passed / self._lasts, -most), most)
        left = np.column_stack([-np.sin(preview.heading), np.cos(preview.heading)])
        point = preview.point - self._lasting * left
        moved = {side: getattr(preview, side) + self._lasting for side in ("left", "room_left")}
        moved |= {side: getattr(preview, side) - self._lasting for side in ("right", "room_right")}
        return replace(preview, point=point, **moved)

    def _kept_off(self, estimate: Estimate, preview: Preview) -> Preview:
        """Return a preview with less room beside the body if position or heading are uncertain."""
        if not np.isfinite([preview.room_left, preview.room_right]).any():
            return preview
        left = np.column_stack([-np.sin(preview.heading), np.cos(preview.heading)])
        place = np.einsum("ki,ij,kj->k", left, estimate.covariance[:2, :2], left)
        turned = (self._length / 2.0 * estimate.deviations[HEADING]) ** 2
        unsure = SIGNIFICANT_EXCESS * np.minimum(np.sqrt(place + turned), MOST_UNSURE * self._length)
        return replace(preview, room_left=preview.room_left - unsure, room_right=preview.room_right - unsure)

    def _candidates(self, t: float, estimate: Estimate, reference: Reference) -> list[FloatArray]:
        """Return the possible initial inputs of the search, shape (H, 3) each.

        These are the previous plan, if there is one, and the plain wave.
        """
        instants = t + self._prediction.step * (0.5 + np.arange(self._prediction.steps))
        wave = np.array(self.plain(t, float(estimate.state.slip), reference), dtype=float)
        plain = np.tile(wave, (len(instants), 1))
        return [plain] if self._last is None else [self._last.at(instants), plain]

    def _problem(self, t: float, state: ReducedState, preview: Preview, plain: FloatArray) -> Problem:
        """Return (O2); `plain` is the plain wave, shape (H, 3)."""
        kept, turns = (max(float(share), LEAST_SHARE) for share in (1.0 - state.slip, state.turn_gain))
        frequency = self.feed_forward.frequencies(preview.speed / kept, self._curvatures(preview) * kept / turns)
        return Problem(
            prediction=self._prediction,
            cost=self.cost,
            state=np.array(state, dtype=float),
            preview=preview,
            slowest=self.feed_forward.least_divisor,
            before=self._scale.scaled(plain[:1] if self._last is None else self._last.at(t)),
            frequency=(frequency - self._scale.centre[1]) / self._scale.half[1],
        )

    def _curvatures(self, preview: Preview) -> FloatArray:
        """Return the curvatures of the path, shape (H,) [1/m]. They are 0 without a path."""
        if not preview.follows:
            return np.zeros(len(preview.way))
        way = np.maximum(np.abs(preview.way), 1e-3)  # avoids a division by 0 if the worm stands
        return np.abs(np.gradient(preview.heading)) / (self._length * way)

    def _searched(self, problem: Problem, waves: list[FloatArray]) -> tuple[Solution, float]:
        bounds = np.tile(self._scale.bounds, self._prediction.steps)
        # Waves slower than the requested speed needs are excluded. Otherwise a worm far from the path would not turn.
        bounds[0, 1::INPUTS] = np.maximum(bounds[0, 1::INPUTS], np.minimum(problem.frequency, -1.0))
        ways = problem.preview.ways
        least, most = self.feed_forward.ranges.amplitude
        ends = np.where(ways < 0.0, [[-most], [-least]], [[least], [most]])
        bounds[:, ::INPUTS] = (ends - self._scale.centre[0]) / self._scale.half[0]
        given = [np.column_stack([ways * np.abs(wave[:, 0]), wave[:, 1:]]) for wave in waves]
        starts = [np.clip(self._scale.scaled(wave), *bounds) for wave in given]
        costs = [half_square(problem.residuals(start), problem.limits) for start in starts]
        best = int(np.argmin(costs))
        search = problem.residuals, problem.linearised, starts[best], *bounds, problem.limits
        found = self._search.minimise(*search)
        return found, costs[best]

    def _made(self, t: float, problem: Problem, found: Solution, plain_cost: float, began: float) -> Plan:
        inputs = self._scale.inputs(found.z)
        return Plan(
            time=t,
            step=self._prediction.step,
            inputs=inputs,
            horizon=problem.states(found.z)[:, :2],
            status=found.outcome,
            seconds=perf_counter() - began,
            parameters=self._model.parameters(ReducedInput(*inputs[0])),
            iterations=found.iterations,
            cost=found.cost,
            plain_cost=plain_cost,
            certificate=found.certificate,
        )
