"""The supervisor: model predictive control with fallbacks, so that there is a command even if planning fails.

The supervisor commands the first available wave of this list:

1. an accepted plan ("mpc"). A plan is accepted if it is finite, within the identified ranges, no worse than the
   previous plan and the plain wave (see 3), and ready in time;
2. the continuation of the last accepted plan ("shifted plan"), at most five times in a row;
3. the plain wave, which is the feed-forward of the identified map ("gait"). As long as the heading is unknown, only
   this choice is used, and the wave turns like the path, or goes straight;
4. the parameters in force ("gait"), at most five times in a row;
5. rest ("stop").

The worm also rests if the requested speed is (almost) zero, and at the end of a path with an end. After five failures
in a row the planner discards its last plan. The reference's clock never stops. An exception of any type and from any
source counts as a failure of the choice that raised it, and the next choice follows.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from math import isfinite, nan
from typing import Any, Literal, Self, get_args

import numpy as np

from control.estimation.estimate import Estimate
from control.estimation.estimator import Estimator
from control.estimation.reduced import INPUTS, ReducedInput, ReducedModel
from control.gaits.steering import GaitParameters, Mechanism
from control.identification.surrogate import Ranges
from control.loop import (
    MOST_KEPT,
    NO_DECISION,
    Choice,
    Estimates,
    WaveController,
    complaint_of,
    observed,
    rest,
    still,
)
from control.planning.constraints import Constraint
from control.planning.gauss_newton import PlanStatus
from control.planning.mpc import GaitMPC, Plan
from control.planning.terms import CostTerm
from control.task import ControlTask
from control.tracking.preview import turn_of_path
from worm3d.values import arguments
from worm3d.values.named import EXCEPTIONS

Deadline = Literal["iterations", "wall"]

UNKNOWN = "the heading is not known yet: straight on, or as the path turns"
THERE, STAYS = 0.004, 0.02
"""Distances to the end of a path [body lengths]: the worm stops below `THERE`, and starts again above `STAYS`."""
BACKWARDS = "the reference asks for a way backwards, and no wave of this worm goes backwards: it rests"
STANDS = "the reference asks for less speed than the worm can crawl at: it rests"
ARRIVED = "the worm is at the end of its path"
LATE = "the plan came too late"
NO_PLAN = "what was planned is no plan"
NOT_NUMBERS = "the plan is of another shape, or not finite"
OUTSIDE = "the plan is outside the ranges in which the worm was identified"
_LOG = logging.getLogger(__name__)


class Supervisor(WaveController):
    """A controller for `worm3d.simulate` that plans ahead. `failures` counts the decisions without an accepted plan.

    Parameters
    ----------
    task : ControlTask
    model : ReducedModel
    estimator : Estimates
    mpc : GaitMPC
    deadline : str
        With "iterations", planning may take any time up to the maximum number of iterations, and runs are repeatable
        bit for bit. With "wall", a plan that took longer than the control period is not accepted.

    Raises
    ------
    ValueError
        `deadline` is neither of these.
    """

    plans = True

    def __init__(
        self,
        task: ControlTask,
        model: ReducedModel,
        estimator: Estimates,
        mpc: GaitMPC,
        deadline: Deadline = "iterations",
    ) -> None:
        arguments.choice("deadline", deadline, get_args(Deadline))
        self._model, self.planner = model, mpc
        self._longest = task.period if deadline == "wall" else np.inf
        super().__init__(task, mpc.feed_forward, estimator)

    @classmethod
    def of(
        cls,
        task: ControlTask,
        *,
        deadline: Deadline = "iterations",
        model: type[ReducedModel] = ReducedModel,
        estimator: type[Estimator] = Estimator,
        terms: Sequence[CostTerm] | None = None,
        constraints: Sequence[Constraint] | None = None,
    ) -> Self:
        """Return the supervisor for a task.

        By default, the supplied model, estimator, terms of the cost and constraints are used.
        """
        reduced, estimates = observed(task, model, estimator)
        return cls(task, reduced, estimates, GaitMPC(task.worm, task.map, reduced, terms, constraints), deadline)

    def reset(self) -> None:
        """Return to the initial state."""
        super().reset()
        self.planner.reset()
        self._accepted: Plan | None = None
        self._failures = self._kept = 0
        self._near: float | None = None
        self._is_there = self._was_back = False

    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        assert estimate is not None
        speed, able = self._speed(t), self.feed_forward
        if speed < 0.0 and not able.backward:
            return Choice("stop", rest(self._target), BACKWARDS)
        if abs(speed) < able.slowest:
            return Choice("stop", still(self._target), STANDS)
        if _tried(self._arrived, estimate, speed < 0.0)[0]:
            return Choice("stop", still(self._target), ARRIVED)
        if not self._heading_is_known(estimate):
            blind = self._blind(t, estimate)
            if blind is not None:
                return Choice("gait", blind, UNKNOWN)
        plan, complaint = self._plan(t, estimate)
        if plan is None or complaint:
            return self._without(t, estimate, complaint, plan)
        assert plan.parameters is not None
        self._accepted, self._failures, self._kept = plan, 0, 0
        return Choice("mpc", plan.parameters, plan.status.value, plan)

    def _arrived(self, estimate: Estimate, back: bool = False) -> bool:
        """Return whether the worm is at the end of the path.

        A worm that has arrived stays at the end even if it is pushed back a little (`STAYS`). When the worm crawls
        backwards, the beginning of the path is its end.
        """
        path = self.reference.path
        if path is None or not self.reference.ends:
            return False
        if not estimate.is_placed(self.worm.length):  # a worm at rest stays at rest without a position
            return self._is_there and back == self._was_back
        self._near = float(path.project(estimate.position, self._near))
        left = (self._near if back else path.length - self._near) / self.worm.length
        self._is_there = left < (STAYS if self._is_there and back == self._was_back else THERE)
        self._was_back = back
        return self._is_there

    def _blind(self, t: float, estimate: Estimate) -> GaitParameters | None:
        """Return the wave that turns like the path, or None if there is no such wave."""
        speed, turn = self._speed(t), _tried(lambda: turn_of_path(self.reference, t, estimate.position))[0]
        return self._parameters(_tried(self.feed_forward, speed, 0.0 if turn is None else turn)[0])

    def _speed(self, t: float) -> float:
        """Return the requested speed [m/s], or NaN if the reference raises an exception."""
        speed, _ = _tried(lambda: float(self.reference.speed(t)))
        return nan if speed is None else speed

    def _plan(self, t: float, estimate: Estimate) -> tuple[Plan | None, str]:
        """Return a plan (None if planning failed) and the reason why it is not accepted.

        The reason is empty if the plan is accepted.
        """
        plan, complaint = _tried(self.planner.plan, t, estimate, self.reference)
        if not complaint:
            complaint = " ".join(filter(None, _tried(_fault, plan, self.feed_forward.ranges, self._model.mechanism)))
        if complaint:
            _LOG.warning("no plan at %.3f s: %s", t, complaint)
            return None, complaint
        if not plan.status.ok:
            return plan, plan.status.value
        return plan, LATE if plan.seconds > self._longest else ""

    def _without(self, t: float, estimate: Estimate, complaint: str, plan: Plan | None) -> Choice:
        """Return the next best choice when no plan was accepted."""
        self._failures += 1
        if self._failures % MOST_KEPT == 0:
            _tried(self.planner.forget)
        if self._accepted is not None and self._failures <= MOST_KEPT:
            shifted = self._model.parameters(ReducedInput(*self._accepted.at(t)))
            return Choice("shifted plan", shifted, complaint, plan, failed=True)
        slip = float(estimate.state.slip)
        plain = self._parameters(_tried(self.planner.plain, t, slip if isfinite(slip) else 0.0, self.reference)[0])
        if plain is not None:
            return Choice("gait", plain, complaint, plan, failed=True)
        self._kept += 1
        if self._kept <= MOST_KEPT:
            return Choice("gait", self._target, complaint, plan, failed=True)
        return Choice("stop", rest(self._target), NO_DECISION, plan, failed=True)

    def _parameters(self, wave: ReducedInput | None) -> GaitParameters | None:
        """Return the parameters of a wave, or None if `wave` is None or not finite."""
        known = wave is not None and all(isfinite(part) for part in wave)
        return _tried(self._model.parameters, wave)[0] if known else None


def _tried(act: Callable[..., Any], *given: Any) -> tuple[Any, str]:
    """Return the result of a function and an empty text.

    If the function raises an exception, return None and the text of the exception.
    """
    try:
        return act(*given), ""
    except EXCEPTIONS as error:
        return None, complaint_of(error)


def _fault(plan: Any, ranges: Ranges, mechanism: Mechanism) -> str:
    """Return the defect of a plan as a text.

    The text is empty if there is no defect, or if the status of the plan is not ok.
    """
    if not isinstance(plan, Plan) or not isinstance(plan.status, PlanStatus):
        return NO_PLAN
    if np.array([plan.cost, plan.seconds, plan.iterations]).dtype.kind not in "fi":
        return NOT_NUMBERS
    if not plan.status.ok:
        return ""
    if not isinstance(plan.parameters, GaitParameters):
        return NO_PLAN
    inputs, horizon = np.asarray(plan.inputs, dtype=float), np.asarray(plan.horizon, dtype=float)
    if inputs.ndim != 2 or inputs.shape[1] != INPUTS or not len(inputs) or horizon.shape != (len(inputs) + 1, 2):
        return NOT_NUMBERS
    if not (np.isfinite(inputs).all() and np.isfinite(horizon).all() and plan.step > 0.0 and plan.seconds >= 0.0):
        return NOT_NUMBERS
    first = plan.parameters
    waves = np.vstack([inputs, [first.amplitude, first.frequency, first.steering(mechanism)]])
    waves[:, 0] = np.abs(waves[:, 0])  # below 0 backwards
    (low, high), slack = ranges.bounds, 1e-6 * np.ptp(ranges.bounds, axis=0)
    return OUTSIDE if ((waves < low - slack) | (waves > high + slack)).any() else ""
