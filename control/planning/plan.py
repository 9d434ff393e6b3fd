"""Plans: what a controller means to do over its horizon, and what became of the search for it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from control.gaits.steering import GaitParameters
from worm3d.values.arrays import FloatArray


class PlanStatus(Enum):
    """What became of the search; the value is the sentence to print."""

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
    """What was planned at an instant.

    Attributes
    ----------
    time : float
        Its begin [s].
    step : float
        Over which an input is constant [s].
    inputs : ndarray, shape (H, 3)
        Amplitude, frequency [Hz] and steering; NaN where there is no plan.
    parameters : GaitParameters or None
        The first of them; None where there is no plan.
    horizon : ndarray, shape (H + 1, 2)
        Predicted way of the centre of mass [m].
    status : PlanStatus
    iterations : int
        Quadratic programmes solved.
    cost, plain_cost : float
        Of the plan, and of the better of what it could have begun with: the plan before, shifted, and the plain wave.
    certificate : float
        See `control.planning.gauss_newton.Solution.certificate`.
    seconds : float
        Time that it took.
    """

    time: float
    step: float
    inputs: FloatArray
    parameters: GaitParameters | None
    horizon: FloatArray
    status: PlanStatus
    iterations: int
    cost: float
    plain_cost: float
    certificate: float
    seconds: float

    def at(self, t: ArrayLike) -> FloatArray:
        """Return the inputs at times of shape (...) [s], shape (..., 3); beyond an end those of the step there."""
        # A time that is the begin of a step but for rounding lies within it.
        k = np.floor((np.asarray(t, dtype=float) - self.time) / self.step + 1e-9).astype(int)
        planned: FloatArray = self.inputs[np.clip(k, 0, len(self.inputs) - 1)]
        return planned
