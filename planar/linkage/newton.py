"""Newton-Raphson (P1), (P2) with an exact Jacobian and a line search.

Each pass has two parts. The first part minimises the potential of a step for given normal loads. Its Hessian is
symmetric, and every search direction descends. The second part, the polish, takes full Newton steps, with loads that
depend on the iterate. Its Jacobian is exact, but unsymmetric. If the polish does not converge, the given loads are
updated and the next pass begins.

If no pass converges, the solver polishes with given regimes of the contacts (`planar.linkage.regimes`), and changes the
regimes until they agree with the law. A first attempt changes all wrong regimes in the first rounds and a single one in
later rounds. A second attempt changes a single regime in every round. Each attempt is made from the last iterate, then
from the initial guess, and then from the positions X_n + dt V_n of joints that move freely.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from planar.linkage import regimes
from planar.linkage.element import HALF_BANDWIDTH, NO_BAND, ROWS, Body, Now, apex_gauge, evaluate
from planar.linkage.ground import Ground
from planar.linkage.segment_law import slenderness
from planar.linkage.shape import apexes_by_law
from worm3d.machine.compiled import njit
from worm3d.values.arrays import FloatArray

RELAXATIONS = (1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.25, 0.25) + (0.1,) * 17
"""Fraction of the change of the loads that is applied after each pass without convergence (under-relaxation)."""
EXTRAPOLATION_FRACTION = 1e-4
"""Fraction of a step over which the motion of a stuck contact is measured, to extrapolate it over the whole step."""


@dataclass(frozen=True)
class Solution:
    """Outcome of Newton's method."""

    q: FloatArray
    """Last iterate, shape (2 (N+1),) [m]."""
    gradient: FloatArray
    """Residual at `q`, zero on held coordinates, shape (2 (N+1),) [N]."""
    converged: bool
    iterations: int
    """Evaluations of the Jacobian."""


class Newton:
    """Solver for the steps of one worm. An instance owns the work arrays, which all steps reuse."""

    def __init__(self, body: Body, ground: Ground, length: float, held: NDArray[np.bool_]) -> None:
        self.body, self.ground, self.length = body, ground, length
        self.held = held
        self.gradient = np.zeros(len(held))
        self.band = np.zeros((ROWS, len(held)))

    def solve(self, q: FloatArray, now: Now) -> Solution:
        """Return the solution of the step from the initial guess q. The solver changes `now.load`."""
        iterations, guess = 0, q
        for relaxation in RELAXATIONS:
            q, used, descended = self._descend(q, now)
            iterations += used
            if descended:
                polished, used, converged = self._polish(q, now)
                iterations += used
                if converged:
                    return Solution(polished, self.gradient.copy(), True, iterations)
            load = loads(q, self.body, self.ground, now)
            now.load[:] += relaxation * (load - now.load)
        for first, start in product((0, regimes.AT_ONCE), (q, guess, now.joint_hat.ravel())):
            polished, used, converged = self._by_regimes(start, now, first)
            iterations += used
            if converged:
                return Solution(polished, self.gradient.copy(), True, iterations)
        self._evaluate(q, now, coupled=True)
        return Solution(q, self.gradient.copy(), False, iterations)

    def residual(self, q: FloatArray, now: Now) -> FloatArray:
        """Return the residual, shape (2 (N+1),) [N]; on held coordinates it is minus the force that holds them."""
        gradient = np.empty_like(q)
        evaluate(q, self.body, self.ground, now, True, gradient, NO_BAND)
        return gradient

    def _evaluate(self, q: FloatArray, now: Now, coupled: bool) -> float:
        phi = evaluate(q, self.body, self.ground, now, coupled, self.gradient, self.band)
        if self.held.any():
            _hold(self.band, self.held)
            self.gradient[self.held] = 0.0
        return phi

    def _descend(self, q: FloatArray, now: Now) -> tuple[FloatArray, int, bool]:
        for iteration in range(1, 61):
            phi = self._evaluate(q, now, coupled=False)
            if not np.isfinite(phi):
                return q, iteration, False
            direction = _descent_direction(self.band, self.gradient)
            if direction is None:
                return q, iteration, False
            q_next = self._search(q, phi, direction, now)
            if q_next is None:
                return q, iteration, True  # no descent left above rounding
            q = q_next
            if np.abs(direction).max() < 1e-9 * self.length:
                return q, iteration, True
        return q, iteration, False

    def _search(self, q: FloatArray, phi: float, direction: FloatArray, now: Now) -> FloatArray | None:
        """Search along a direction of descent, first at the points where contacts come to rest.

        Return None if no point of the direction lowers the potential. The slope of friction changes abruptly within the
        tiny displacement of a stuck contact. Plain bisection would need very many evaluations to find such a point.
        """
        slope, scratch, noise = float(self.gradient @ direction), np.empty_like(q), 1e-14 * abs(phi)
        kinks = np.empty(2 * len(self.body.k_apex))
        kinks = np.sort(kinks[: _resting_points(q, direction, self.body, self.ground, now, kinks)])
        low, high, step = 0.0, 1.0, 1.0
        best: FloatArray | None = None
        for _ in range(40):
            trial = q + step * direction
            value = evaluate(trial, self.body, self.ground, now, False, scratch, NO_BAND)
            rise = float(scratch @ direction) if np.isfinite(value) else np.inf
            lower = value <= phi + 1e-4 * step * slope + noise
            if lower:
                best = trial
                if rise <= 0.9 * abs(slope):  # the slope has fallen enough
                    return trial
            low, high = (step, high) if lower and rise <= 0.0 else (low, step)
            between = kinks[(kinks > low) & (kinks < high)]
            step = float(between[len(between) // 2]) if len(between) else 0.5 * (low + high)
        return best

    def _by_regimes(self, q: FloatArray, now: Now, first: int) -> tuple[FloatArray, int, bool]:
        """Polish with given regimes until the regimes agree with the law at the solution.

        The first regimes are those that the law gives at q. Rounds are numbered from `first`. From the round number
        `regimes.AT_ONCE` on, a single contact changes in each round.
        """
        if not np.isfinite(self._evaluate(q, now, coupled=False)):
            return q, 1, False  # the worm cannot take this shape
        regime, iterations = regimes.of_law(q, self.body.segment_law, self.ground, now), 0
        for turn in range(first, 60):
            taken = now._replace(regime=regime)
            q, used, converged = self._polish(q, taken, most=40)
            iterations += used
            if not converged:
                break
            regime = regimes.after(q, self.body.segment_law, self.ground, taken, turn)
            if (regime == taken.regime).all():
                return q, iterations, True
        return q, iterations, False

    def _polish(self, q: FloatArray, now: Now, most: int = 12) -> tuple[FloatArray, int, bool]:
        size = np.inf
        for iteration in range(1, most + 1):
            if not np.isfinite(self._evaluate(q, now, coupled=True)):
                return q, iteration, False
            _, _, step, info = scipy.linalg.lapack.dgbsv(HALF_BANDWIDTH, HALF_BANDWIDTH, self.band, self.gradient)
            if info != 0 or not np.isfinite(step).all():
                return q, iteration, False
            previous, size = size, float(np.abs(step).max())
            if size > 0.1 * self.length:
                return q, iteration, False
            q = q - step
            stagnates = previous <= 2.0 * size < 2e-10 * self.length
            if size < 1e-12 * self.length or stagnates:
                self._evaluate(q, now, coupled=True)
                return q, iteration, True
        return q, most, False


def loads(q: FloatArray, body: Body, ground: Ground, now: Now) -> FloatArray:
    """Return the normal loads (G1) at q, shape (N, 2) [N]."""
    k, c, dt = ground.stiffness, ground.damping, now.dt
    if k == 0.0:
        return np.zeros_like(now.load)
    stiff = k + c / dt
    depth = np.maximum(0.0, -apexes_by_law(q.reshape(-1, 2), now.l_cmd, body.segment_law)[..., 1])
    return np.asarray(stiff * np.maximum(0.0, depth - c / dt * now.depth_n / stiff))


@njit
def _resting_points(
    q: FloatArray, direction: FloatArray, body: Body, ground: Ground, now: Now, steps: FloatArray
) -> int:
    """Write the step lengths in (0, 1) where contacts come to rest into `steps`, and return their number.

    The step lengths are exact to first order. A stuck contact comes to rest where it passes from its softer to its
    stiffer direction. The step ends just beyond this point, so that the next Hessian contains the stiffness that holds
    the contact.
    """
    n, found = len(body.k_apex), 0
    for i in range(n):
        for j in range(2):
            if now.load[i, j] <= 0.0 or ground.stiffness == 0.0:
                continue
            y, stuck, soft, margin = np.empty(2), False, False, 0.0
            for end in range(2):
                k, far = 2 * i, end * (EXTRAPOLATION_FRACTION if stuck else 1.0)
                ax, az = q[k] + far * direction[k], q[k + 1] + far * direction[k + 1]
                bx, bz = q[k + 2] + far * direction[k + 2], q[k + 3] + far * direction[k + 3]
                square = (bx - ax) ** 2 + (bz - az) ** 2
                w, _, _ = slenderness(i, square, now.l_cmd[i], body.segment_law)
                x = 0.5 * (ax + bx) - (2.0 * j - 1.0) * w * (bz - az)
                y[end], mu, b = apex_gauge(i, j, x, ground, now)
                if end == 0:
                    stuck = abs(y[0]) <= now.cap[i, j] * b
                    soft = mu < max(ground.mu_forward[i], ground.mu_backward[i])
                    margin = np.sign(y[0]) * 1e-5 * max(abs(y[0]), b) if stuck else 0.0
            if stuck:
                y[1] = y[0] + (y[1] - y[0]) / EXTRAPOLATION_FRACTION
            if y[0] * y[1] < 0.0 and (not stuck or soft):
                steps[found] = (y[0] + margin) / (y[0] - y[1])
                found += 1
    return found


def _descent_direction(band: FloatArray, gradient: FloatArray) -> FloatArray | None:
    """Return the Newton direction with a Hessian that is shifted until it is positive definite.

    Return None if no shift suffices.
    """
    upper = band[HALF_BANDWIDTH : 2 * HALF_BANDWIDTH + 1]
    scale = float(np.abs(upper[HALF_BANDWIDTH]).max())
    shift = 0.0
    while shift < 1e6 * scale:
        shifted = upper.copy()
        shifted[HALF_BANDWIDTH] += shift
        _, solution, info = scipy.linalg.lapack.dpbsv(shifted, gradient)
        if info == 0 and np.isfinite(solution).all():
            return np.asarray(-solution)
        shift = max(10.0 * shift, 1e-9 * scale)
    return None


def _hold(band: FloatArray, held: NDArray[np.bool_]) -> None:
    """Replace the rows and columns of held coordinates by rows and columns of the identity."""
    size = len(held)
    for offset in range(-HALF_BANDWIDTH, HALF_BANDWIDTH + 1):
        columns = np.arange(max(0, -offset), min(size, size - offset))
        dead = held[columns] | held[columns + offset]
        band[2 * HALF_BANDWIDTH + offset, columns[dead]] = 0.0
    band[2 * HALF_BANDWIDTH, held] = 1.0
