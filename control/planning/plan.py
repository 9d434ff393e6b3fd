"""What a controller plans, chooses and records: the values that planner, fallback and control loop pass on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import nan
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from control.estimation.estimate import Estimate
from control.gaits.steering import GaitParameters
from worm3d.values.arrays import FloatArray

Source = Literal["mpc", "shifted plan", "gait", "stop", "pi_los", "open_loop"]
SOURCES: tuple[Source, ...] = get_args(Source)


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
    """Inputs over a horizon of H steps; a plan that could not be made has NaN for its numbers.

    Attributes
    ----------
    time : float
        Start of the horizon [s].
    step : float
        Time over which an input is constant [s].
    inputs : ndarray, shape (H, 3)
        Amplitude, frequency [Hz] and steering.
    horizon : ndarray, shape (H + 1, 2)
        Predicted way of the centre of mass [m].
    status : PlanStatus
    seconds : float
        Time that the planning took.
    parameters : GaitParameters or None
        Gait parameters of the first input; None where there is no plan.
    iterations : int
        Quadratic programmes solved.
    cost, plain_cost : float
        Cost of the plan, and of the better of the two starts of the search: the plan before, shifted, and the plain
        wave.
    certificate : float
        Distance from a minimum, `control.planning.gauss_newton.Solution.certificate`.
    """

    time: float
    step: float
    inputs: FloatArray
    horizon: FloatArray
    status: PlanStatus
    seconds: float
    parameters: GaitParameters | None = None
    iterations: int = 0
    cost: float = nan
    plain_cost: float = nan
    certificate: float = nan

    def at(self, t: ArrayLike) -> FloatArray:
        """Return the inputs at times of shape (...) [s], shape (..., 3); beyond an end those of the step there."""
        # A time that equals the start of a step but for rounding lies within that step.
        k = np.floor((np.asarray(t, dtype=float) - self.time) / self.step + 1e-9).astype(int)
        planned: FloatArray = self.inputs[np.clip(k, 0, len(self.inputs) - 1)]
        return planned


class Choice(NamedTuple):
    """Gait parameters that a controller chose, and why."""

    source: Source
    parameters: GaitParameters
    status: str
    """Sentence of the plan, or why there is none."""
    plan: Plan | None = None
    """Plan of this instant, whether it was accepted or not."""
    failed: bool = False
    """Whether something better should have been available, such as an accepted plan."""


@dataclass(frozen=True, eq=False)
class Decision:
    """Record of a choice of the gait parameters and of what the controller knew.

    Attributes
    ----------
    time : float
        Time from which on the parameters are in force [s].
    source : str
        Where they come from: an accepted plan ("mpc"), the plan before ("shifted plan"), the feed-forward or the last
        parameters ("gait"), rest ("stop"), or a baseline ("pi_los", "open_loop").
    parameters : GaitParameters
    estimate : Estimate or None
        None for a controller without estimator.
    status : str
        Sentence of the solver, or why it was not asked or not followed; empty where nothing is solved.
    failed : bool
        Whether something better should have been available.
    iterations : int
    cost : float
        NaN where nothing is minimised.
    seconds : float
        Wall time of the decision, estimator included [s].
    horizon : ndarray, shape (H + 1, 2), or None
        Predicted way of the centre of mass [m].
    """

    time: float
    source: Source
    parameters: GaitParameters
    estimate: Estimate | None
    status: str = ""
    failed: bool = False
    iterations: int = 0
    cost: float = nan
    seconds: float = 0.0
    horizon: FloatArray | None = None
