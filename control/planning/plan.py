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
    """Record of a choice of the gait parameters and of what the controller knew."""

    time: float
    """Time from which on the parameters are in force [s]."""
    source: Source
    """Where they come from: an accepted plan ("mpc"), the plan before ("shifted plan"), the feed-forward or the last
    parameters ("gait"), rest ("stop"), or a baseline ("pi_los", "open_loop")."""
    parameters: GaitParameters
    estimate: Estimate | None
    """Estimate of that time; None for a controller without estimator."""
    status: str = ""
    """Sentence of the solver, or why it was not asked or not followed; empty where nothing is solved."""
    failed: bool = False
    """Whether something better should have been available."""
    iterations: int = 0
    cost: float = nan
    """Cost of the plan; NaN where nothing is minimised."""
    seconds: float = 0.0
    """Wall time of the decision, estimator included [s]."""
    horizon: FloatArray | None = None
    """Predicted way of the centre of mass [m], shape (H + 1, 2)."""
