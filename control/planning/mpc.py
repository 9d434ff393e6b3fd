"""Model predictive control of the gait's parameters: amplitude, frequency and steering over some waves ahead.

What a plan is to achieve is its cost, (O2), made of `control.planning.terms` and `control.planning.constraints`. Slip,
yaw bias and drift are those of the estimate and constant over the horizon: what they stand for leaves no lasting error.
Where something turns the worm (its yaw bias is surely not 0) they are never known well enough, and an offset e is left
that lasts; what is followed is moved aside by its integral, within bounds,

    e_lasting' = e / T,   r -> r - e_lasting n                                                                (P4)

The speed V has an integral of its own, since slow waves that turn sharply go faster than the plain waves below which
the search does not go; it makes up for a speed that is missed by a little, and not for one that has just changed,

    trim' = (1 - V/V_ref)/T,   V_ref -> V_ref (1 + trim)                                                      (P5)

The search begins at the better of two waves, the plan before and the plain wave of the feed-forward, and is never worse
than either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import inf, isfinite, nan
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from control.estimation.estimate import HEADING, SURE, Estimate
from control.estimation.reduced import INPUTS, ReducedInput, ReducedModel, ReducedState
from control.gaits.steering import GaitParameters
from control.identification.identified import Identified
from control.planning.constraints import Constraint, default_constraints
from control.planning.cost import Cost, Prediction, Problem, Scale
from control.planning.feed_forward import FeedForward
from control.planning.gauss_newton import GaussNewton, Outcome, Solution, half_square
from control.planning.terms import CostTerm, default_terms
from control.tracking.paths import offset
from control.tracking.preview import Ability, Preview, look_ahead, speed_at, turn_rate
from control.tracking.references import Reference
from worm3d import Worm
from worm3d.values.arrays import FloatArray

TURNED = 2.0
"""Standard deviations of the yaw bias from which something turns the worm that its map does not know of."""
YAW_BIAS = ReducedState._fields.index("yaw_bias")
LASTING = 6.4
"""Time constant T of (P4) and (P5) [waves]: four times that in which other offsets die away."""
MOST_LASTING = 0.01
"""Greatest offset that is taken for one that lasts [body lengths]; a worm that is farther off is on its way back."""
MOST_MISSED = 0.25
"""Greatest share of a speed that is taken for one that is missed lastingly, and the greatest trim of (P5), which dies
away while more is missed."""
LEAST_WAY = 1e-3
"""Way in a step below which the curvature of a path is not known [body lengths]."""
MOST_UNSURE = 0.02
"""Greatest standard deviation of the place by which a body keeps off obstacles [body lengths]: with a greater one the
worm would leave its way, which has as much room as there is on both sides."""
LEAST_SHARE = 0.5
"""Least share of the gait's speed that the plain wave counts on, however large the estimated slip is."""


class PlanStatus(Enum):
    """Outcome of the search for a plan; the value is the sentence to print."""

    OPTIMAL = "the best wave was found"
    BETTER = "out of iterations, but better than the plan before and the plain wave"
    NOT_BETTER = "no better than the plan before and the plain wave"
    NOT_FINITE = "the estimate or the reference is not finite"
    NOT_SOLVED = "the quadratic programme was not solved"

    @property
    def ok(self) -> bool:
        """Whether the plan can be used."""
        return self in (PlanStatus.OPTIMAL, PlanStatus.BETTER)


@dataclass(frozen=True, eq=False)
class Plan:
    """Inputs over a horizon of H steps; a plan that could not be made has NaN for its numbers."""

    time: float
    """Start of the horizon [s]."""
    step: float
    """Time over which an input is constant [s]."""
    inputs: FloatArray
    """Amplitude, frequency [Hz] and steering, shape (H, 3)."""
    horizon: FloatArray
    """Predicted way of the centre of mass [m], shape (H + 1, 2)."""
    status: PlanStatus
    seconds: float
    """Time that the planning took [s]."""
    parameters: GaitParameters | None = None
    """Gait parameters of the first input; None where there is no plan."""
    iterations: int = 0
    """Number of quadratic programmes solved."""
    cost: float = nan
    """Cost of the plan, (O2)."""
    plain_cost: float = nan
    """Cost of the better of the two starts of the search: the plan before, shifted, and the plain wave."""
    certificate: float = nan
    """Distance from a minimum, `control.planning.gauss_newton.Solution.certificate`."""

    def at(self, t: ArrayLike) -> FloatArray:
        """Return the inputs at times of shape (...) [s], shape (..., 3); beyond an end those of the step there."""
        # A time that equals the start of a step but for rounding lies within that step.
        k = np.floor((np.asarray(t, dtype=float) - self.time) / self.step + 1e-9).astype(int)
        planned: FloatArray = self.inputs[np.clip(k, 0, len(self.inputs) - 1)]
        return planned


STATUS = {
    Outcome.CONVERGED: PlanStatus.OPTIMAL,
    Outcome.IMPROVED: PlanStatus.BETTER,
    Outcome.STUCK: PlanStatus.NOT_BETTER,
    Outcome.NOT_FINITE: PlanStatus.NOT_FINITE,
    Outcome.NO_STEP: PlanStatus.NOT_SOLVED,
}


class GaitMPC:
    """The planner of the gait's parameters.

    Parameters
    ----------
    worm : Worm
    identified : Identified
        Maps of the worm, from which `model` was made.
    model : ReducedModel
    terms : sequence of CostTerm, optional
        What a plan is to achieve; those that ship, `control.planning.terms.default_terms`, if left out.
    constraints : sequence of Constraint, optional
        What it has to keep to; those of `control.planning.constraints.default_constraints` if left out.
    step : float
        Time step of the prediction [s].
    steps : int
        Number of steps, H.
    iterations : int
        Largest number in each plan. The search goes on in the next plan; more of them make no difference that could be
        seen.

    Raises
    ------
    ValueError
        A step that is not above 0, fewer than two steps, no iteration, or something that is no term or constraint.
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
        self.feed_forward, self._model, self._scale = (
            FeedForward(found, worm.length, identified.backward),
            model,
            Scale(found.ranges),
        )
        self._length, self._lasts = worm.length, LASTING * self.feed_forward.wave
        terms = default_terms() if terms is None else terms
        self.cost = Cost.of(
            model, found, worm.length, terms, default_constraints() if constraints is None else constraints
        )
        self._prediction = Prediction(model, self.cost.function, step, steps, self._scale)
        self._search = GaussNewton(INPUTS * steps, iterations)
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._near: float | None = None
        self._lasting, self._trim, self._latest = 0.0, 0.0, nan
        self.forget()

    def forget(self) -> None:
        """Drop the last plan: the next one begins at the plain wave."""
        self._last: Plan | None = None

    @property
    def progress(self) -> float:
        """Arc length on the path at the last plan [m]; 0 before."""
        return self._near or 0.0

    def plan(self, t: float, estimate: Estimate, reference: Reference) -> Plan:
        """Return the plan from time t [s] on; the estimate is of that instant."""
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
        """Return the plain wave: the feed-forward of what is asked for at time t [s], at an estimated slip."""
        kept, able = max(1.0 - slip, LEAST_SHARE), self._able(slip)
        speed = float(speed_at(reference, t, self.progress, able))
        return self.feed_forward(speed / kept, turn_rate(reference, t, self.progress, able))

    def _able(self, slip: float, turn_gain: float = 1.0) -> Ability:
        """Return what a worm can do that slips and turns otherwise than its map."""
        kept = max(1.0 - slip, LEAST_SHARE)
        return Ability(
            lambda curvature: kept * self.feed_forward.reach(kept / turn_gain * curvature),
            self._length,
            self.feed_forward.wave,
        )

    def _preview(self, t: float, estimate: Estimate, reference: Reference) -> Preview | None:
        """Return what the reference asks for; None if that, or the estimate, is not finite."""
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
        """Return a preview whose speeds make up for a miss of the speed that lasts, (P5)."""
        asked = float(preview.speed[0])
        miss = 1.0 - estimate.speed / asked if asked != 0.0 else inf
        change = miss if abs(miss) < MOST_MISSED else -self._trim
        self._trim = min(max(self._trim + change * passed / self._lasts, -MOST_MISSED), MOST_MISSED)
        return replace(preview, speed=preview.speed * (1.0 + self._trim))

    def _beside(self, passed: float, estimate: Estimate, reference: Reference, preview: Preview) -> Preview:
        """Return a preview that is moved to the other side of an offset that lasts, (P4)."""
        assert reference.path is not None
        most = MOST_LASTING * self._length
        aside = float(offset(reference.path, estimate.position, preview.progress))
        turned = abs(estimate.state.yaw_bias) > TURNED * estimate.deviations[YAW_BIAS]
        if turned and abs(aside) < most and preview.speed[0] != 0.0:
            self._lasting = min(max(self._lasting + aside * passed / self._lasts, -most), most)
        left = np.column_stack([-np.sin(preview.heading), np.cos(preview.heading)])
        point = preview.point - self._lasting * left
        moved = {side: getattr(preview, side) + self._lasting for side in ("left", "room_left")}
        moved |= {side: getattr(preview, side) - self._lasting for side in ("right", "room_right")}
        return replace(preview, point=point, **moved)

    def _kept_off(self, estimate: Estimate, preview: Preview) -> Preview:
        """Return a preview with less room beside the body, by what its place and heading are unsure by."""
        if not np.isfinite([preview.room_left, preview.room_right]).any():
            return preview
        left = np.column_stack([-np.sin(preview.heading), np.cos(preview.heading)])
        place = np.einsum("ki,ij,kj->k", left, estimate.covariance[:2, :2], left)
        turned = (self._length / 2.0 * estimate.deviations[HEADING]) ** 2
        unsure = SURE * np.minimum(np.sqrt(place + turned), MOST_UNSURE * self._length)
        return replace(preview, room_left=preview.room_left - unsure, room_right=preview.room_right - unsure)

    def _candidates(self, t: float, estimate: Estimate, reference: Reference) -> list[FloatArray]:
        """Return inputs, shape (H, 3), to begin with: the plan before, if there is one, and the plain wave."""
        instants = t + self._prediction.step * (0.5 + np.arange(self._prediction.steps))
        wave = np.array(self.plain(t, float(estimate.state.slip), reference), dtype=float)
        plain = np.tile(wave, (len(instants), 1))
        return [plain] if self._last is None else [self._last.at(instants), plain]

    def _problem(self, t: float, state: ReducedState, preview: Preview, plain: FloatArray) -> Problem:
        """Return (O2); `plain` is the plain wave, shape (H, 3)."""
        kept = max(1.0 - float(state.slip), LEAST_SHARE)
        frequency = self.feed_forward.frequencies(preview.speed / kept, self._curvatures(preview))
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
        """Return the curvatures of what is followed, shape (H,) [1/m]; 0 where it is no path."""
        way = self._length * np.abs(preview.way)
        if not preview.follows:
            return np.zeros(len(way))
        return np.abs(np.gradient(preview.heading)) / np.maximum(way, LEAST_WAY * self._length)

    def _searched(self, problem: Problem, waves: list[FloatArray]) -> tuple[Solution, float]:
        bounds = np.tile(self._scale.bounds, self._prediction.steps)
        # No slower waves than what is asked for takes: far from its path a worm would rather stand than turn round.
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
            status=STATUS[found.outcome],
            seconds=perf_counter() - began,
            parameters=self._model.parameters(ReducedInput(*inputs[0])),
            iterations=found.iterations,
            cost=found.cost,
            plain_cost=plain_cost,
            certificate=found.certificate,
        )
