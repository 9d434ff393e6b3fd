"""Bounded least squares by the Gauss-Newton method, with a measure of the distance from a minimum.

    minimise 1/2 |r(z)|^2 + 1/2 |max(0, c(z))|^2,  lower <= z <= upper                                      (O1)

r and c are stored in one vector. Its last `limits` entries are c, which count only where they are above 0. Each
iteration linearises the residuals with the Jacobians R and C. Then it solves a quadratic programme for a step d and
slacks s, with DAQP, a dual active-set method that comes with CasADi:

    minimise 1/2 |r + R d|^2 + 1/2 |s|^2,  c + C d <= s,  0 <= s,                                            (O6)

The method tries shorter and shorter shares of d until the true cost decreases enough. All iterates satisfy the bounds,
and no iterate is worse than the previous one, so that each of them can be used. A mirrored problem has mirrored
iterates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cache, partial
from math import inf

import casadi as ca
import numpy as np

from worm3d.machine.buffered import Buffered
from worm3d.values.arrays import FloatArray

Residuals = Callable[[FloatArray], FloatArray]
"""Function z (n,) -> r (m,)."""
Linearised = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Function z (n,) -> r (m,) and dr/dz (m, n)."""

SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.015625)
"""Shares of the step that are tried, in this order."""


class PlanStatus(Enum):
    """Result of the search for a plan. The value is a sentence for messages."""

    OPTIMAL = "the best wave was found"
    BETTER = "out of iterations, but better than the plan before and the plain wave"
    NOT_BETTER = "no better than the plan before and the plain wave"
    NOT_FINITE = "the estimate or the reference is not finite"
    NOT_SOLVED = "the quadratic programme was not solved"

    @property
    def ok(self) -> bool:
        """Whether the plan is usable."""
        return self in (PlanStatus.OPTIMAL, PlanStatus.BETTER)


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of the minimisation."""

    z: FloatArray
    """Best point, shape (n,)."""
    cost: float
    """Value of (O1) at this point."""
    outcome: PlanStatus
    iterations: int
    """Number of quadratic programmes that were solved."""
    certificate: float
    """Largest |z - clip(z - gradient)| at the last linearisation. It is 0 at a minimum, whichever bounds are active."""


class GaussNewton:
    """Gauss-Newton method for problems with n unknowns, with a maximum number of iterations."""

    def __init__(self, n: int, iterations: int) -> None:
        self.n, self.iterations = n, iterations
        self._programme = cache(partial(_Programme, n))

    def minimise(
        self,
        residuals: Residuals,
        linearised: Linearised,
        start: FloatArray,
        lower: FloatArray,
        upper: FloatArray,
        limits: int = 0,
    ) -> Solution:
        """Solve (O1), starting from `start`. `start`, `lower` and `upper` have the shape (n,)."""
        z, cost, certificate = np.clip(start, lower, upper), inf, inf
        for iteration in range(self.iterations):
            r, jacobian = linearised(z)
            if not (np.isfinite(r).all() and np.isfinite(jacobian).all()):
                return Solution(z, cost, PlanStatus.NOT_FINITE, iteration, certificate)
            cost, gradient = half_square(r, limits), jacobian.T @ _counted(r, limits)
            certificate = float(np.abs(z - np.clip(z - gradient, lower, upper)).max())
            step = self._step(r, jacobian, lower - z, upper - z, limits)
            if step is None:
                return Solution(z, cost, PlanStatus.NOT_SOLVED, iteration, certificate)
            promised = cost - half_square(r + jacobian @ step, limits)
            if promised <= 1e-6 * (1.0 + cost):
                return Solution(z, cost, PlanStatus.OPTIMAL, iteration + 1, certificate)
            moved = _better(residuals, z, step, cost, promised, limits)
            if moved is None:
                return Solution(z, cost, PlanStatus.NOT_BETTER, iteration + 1, certificate)
            z, cost = np.clip(moved[0], lower, upper), moved[1]
        return Solution(z, cost, PlanStatus.BETTER, self.iterations, certificate)

    def _step(
        self, r: FloatArray, jacobian: FloatArray, lower: FloatArray, upper: FloatArray, limits: int
    ) -> FloatArray | None:
        """Return the step d of (O6), or None if (O6) could not be solved."""
        n, equal = self.n, len(r) - limits
        hessian, gradient = np.eye(n + limits), np.zeros(n + limits)
        hessian[:n, :n] = jacobian[:equal].T @ jacobian[:equal]
        # The shift, relative to the mean of the diagonal, fixes directions that no residual depends on.
        hessian[range(n), range(n)] += 1e-9 * hessian[:n, :n].trace() / n
        gradient[:n] = jacobian[:equal].T @ r[:equal]
        excesses = np.hstack([jacobian[equal:], -np.eye(limits)]) if limits else 0.0
        bounds = np.concatenate([lower, np.zeros(limits)]), np.concatenate([upper, np.full(limits, inf)])
        programme = self._programme(limits)
        step = programme(hessian, gradient, excesses, -inf, -r[equal:], *bounds, *[0.0] * 5)[0][:n]
        return np.clip(step, lower, upper) if programme.solved and np.isfinite(step).all() else None


def half_square(r: FloatArray, limits: int = 0) -> float:
    """Return the cost (O1) of given residuals."""
    counted = _counted(r, limits)
    return 0.5 * float(counted @ counted)


def _counted(r: FloatArray, limits: int) -> FloatArray:
    """Return the residuals with negative excesses replaced by 0."""
    equal = len(r) - limits
    return np.concatenate([r[:equal], np.maximum(r[equal:], 0.0)]) if limits else r


class _Programme(Buffered):
    """Solver of (O6) for n unknowns and some limits. The arguments are those of CasADi's `conic`, in their order."""

    def __init__(self, n: int, limits: int) -> None:
        shapes = {"h": ca.Sparsity.dense(n + limits, n + limits), "a": ca.Sparsity.dense(limits, n + limits)}
        super().__init__(ca.conic("programme", "daqp", shapes, {"error_on_fail": False}))

    @property
    def solved(self) -> bool:
        """Whether the last call found the solution."""
        return bool(self._buffer.stats()["success"])


def _better(
    residuals: Residuals, z: FloatArray, step: FloatArray, cost: float, promised: float, limits: int
) -> tuple[FloatArray, float] | None:
    """Return the first trial point that lowers the cost enough, and its cost. None if there is no such point."""
    for share in SHARES:
        trial = z + share * step
        reached = half_square(residuals(trial), limits)
        if reached <= cost - 1e-4 * share * promised:  # Armijo's condition; false for NaN
            return trial, reached
    return None
