"""Least-squares fit of scene keys to a measurement.

    min over x of the sum over channels c and instants t of (w_c (f_c(t; x) - y_c(t)))^2                           (F3)

Here x are the values of the keys, f_c(t; x) the simulated and y_c(t) the measured values of a channel, and w_c its
weight. In the first minimisation all channels with the same unit have the same weight, which makes metres and newtons
comparable. Afterwards, each weight is the reciprocal of the standard deviation of the channel's residuals. SciPy's
trust-region reflective algorithm finds the minimum. If a run fails, the algorithm takes a shorter step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import least_squares

from scenes.studies.fit.dips import dips
from scenes.studies.fit.identifiability import MIN_SINGULAR_VALUE, Determined, Relation, axes_of, determined, vague
from scenes.studies.fit.lack import Lack, lack_of, ratio_of
from scenes.studies.fit.slopes import MAX_DERIVATIVE_HALVINGS, Slopes, slopes_at
from scenes.studies.fit.suspects import suspects_of
from scenes.studies.fit.trials import SpentError, Trials
from scenes.studies.fit.uncertainty import MOST_CHANNELS, UNCERTAINTY_DRAWS, Uncertainty, uncertainty_of
from worm3d.values.arrays import BoolArray, FloatArray

FIRST_STEP = 0.02
"""Step of the first derivatives, as a fraction of a key's scale. It is so large that a single contact that sticks or
slips hardly affects the derivative."""
DERIVATIVE_STEP_RANGE = (1e-4, 0.1)
"""Smallest and largest step of the later derivatives, as fractions of a key's scale."""
TINY_STEP = 1e-6
"""Step, as a fraction of a key's scale, that is too short to change when contacts stick. It shows whether the effects
of keys cancel exactly."""
STEP_PER_ERROR = 2.0
"""Step of the derivatives in units of the standard error. A derivative is then the slope of a chord that is as wide as
the interval of the value. The derivative at the minimum itself is often steeper because of one or two contact
events."""
ALIKE = 0.1
"""Minimisations with new weights end when they change the values by less than this fraction of their standard
errors."""
PASSES = 4
"""Largest number of minimisations with new weights."""
MIN_RESIDUAL_FRACTION = 1e-6
"""Lower limit of the standard deviation of residuals, as a fraction of the standard deviation of the data. Smaller
residuals are integration errors."""
COARSE_TOLERANCE = 1e-3
"""The first minimisations end at this relative change of the sum of squares."""
DEEPER = 0.01
"""Smallest relative decrease of the sum of squares that moves the final search to another minimum."""
VALLEYS = 3
"""Largest number of moves from one minimum to a lower minimum."""
SUSPECT = 4.0
"""If the ratio (FL1) of `scenes.studies.fit.lack` reaches this value, a minimum may be wrong. In tests with 100 sets of
six channels of noise, no set reached this value at a correlation of neighbouring samples of 0.5, and one set at 0.8. A
fit that ended in the wrong minimum had a ratio of 7."""
STARTS = 6
"""The search is repeated from this number of random points around such a minimum."""
AROUND = 0.02
"""Standard deviation of the distances of these points from the minimum, as a fraction of each key's scale."""
AT_BOUND = 1e-3
"""Largest distance between a bound and a value that counts as being at the bound, as a fraction of the key's scale."""


@dataclass(frozen=True)
class Solution:
    """Values of P keys that minimise (F3), and the information about these values."""

    values: FloatArray
    """Shape (P,)."""
    simulated: FloatArray
    """Channels of the run with these values, shape (C, T)."""
    at_bound: tuple[str, ...]
    """Bound that each key has reached, "lowest" or "highest"; empty if a key is not at a bound."""
    known: BoolArray
    """Whether a key is determined by the data and not at a bound, shape (P,)."""
    uncertainty: Uncertainty
    """Errors of the keys in their units, valid for the keys that are `known`."""
    relations: tuple[Relation, ...]
    """Directions that the data do not determine."""
    finished: bool
    """Whether the values are a minimum; False if the allowed runs were used up first."""
    exact: bool
    """Whether the model matches the data to within integration errors, so that nothing is known about the noise."""
    lack: Lack
    """Result of the test whether the residuals change too slowly for noise."""


def solve(trials: Trials) -> Solution:
    """Return the values of the varied keys that minimise (F3), with their uncertainties.

    Raises
    ------
    SceneError
        All runs around the current values fail.
    StoppedError
        The user has stopped the fit.
    """
    _narrow(trials)
    problem = _Problem(trials)
    u = np.array([each.start for each in trials.varied]) / problem.scale
    weights, steps = 1.0 / trials.data.spread, np.full(len(u), FIRST_STEP)
    finished, exact = True, False
    try:
        u = problem.lowest(problem.minimum(u, weights, steps, COARSE_TOLERANCE), weights, steps)
        for _ in range(PASSES):
            before, u = u, problem.minimum(u, weights, steps)
            weights = problem.weights(u)
            errors = problem.errors(u, weights, steps)
            steps = np.clip(STEP_PER_ERROR * errors, *DERIVATIVE_STEP_RANGE)
            if np.all(np.abs(u - before) <= ALIKE * errors):
                break
        tiny = np.full(len(u), DERIVATIVE_STEP_RANGE[0])  # longer chords miss the bottom of a narrow minimum
        u = problem.minimum(u, weights, tiny)
        before, u = u, problem.beside(u, weights, tiny)
        u = problem.elsewhere(u, weights, tiny)
        weights = problem.weights(u)
        if np.any(u != before):
            steps = np.clip(STEP_PER_ERROR * problem.errors(u, weights, tiny), *DERIVATIVE_STEP_RANGE)
    except (SpentError, _MetError) as end:
        exact = isinstance(end, _MetError)
        finished = exact
        u = problem.best
        trials.allow(3 * (MAX_DERIVATIVE_HALVINGS + 1) * len(u) + 1)
        weights = problem.weights(u)
    return problem.solution(u, weights, steps, finished, exact)


def _narrow(trials: Trials) -> None:
    """Leave out the channels that no key affects at the start values, if there are many channels."""
    if len(trials.data.names) <= MOST_CHANNELS:
        return
    problem, steps = _Problem(trials), np.full(len(trials.varied), FIRST_STEP)
    moves = np.nanmax(np.abs(problem.slopes(problem.best, steps).values * steps), axis=(1, 2))
    used = moves > 1e-9 * trials.data.spread  # smaller effects are rounding errors
    if used.any():  # otherwise the fit goes on and reports that the data do not determine the keys
        trials.narrow(used)


class _MetError(Exception):
    """The model matches the data to within integration errors."""


class _Problem:
    """Problem (F3) in scaled values u, shape (P,): each key is divided by its scale.

    In all methods, `weights` has a shape of (C,), and `steps` are the steps of the derivatives, shape (P,).
    """

    def __init__(self, trials: Trials) -> None:
        self.trials, self.data, self.varied = trials, trials.data, trials.varied
        self.scale = np.array([each.scale for each in self.varied])
        self.low = np.array([each.low for each in self.varied]) / self.scale
        self.high = np.array([each.high for each in self.varied]) / self.scale
        self.known = np.isfinite(self.data.values)
        self.best = np.array([each.start for each in self.varied]) / self.scale
        """Best scaled values of the latest minimisation."""

    def lowest(self, u: FloatArray, weights: FloatArray, steps: FloatArray) -> FloatArray:
        """Search for lower minima around the minimum `u`, and return the lowest minimum.

        The sum of squares is evaluated along the singular directions of the slopes at `u`.
        """
        for _ in range(VALLEYS):
            slopes = self.slopes(u, steps).values[self.known] * self._each(weights)[:, None]
            lengths, _, directions = axes_of(slopes)
            found = dips(partial(self._squares, weights=weights), u, directions / lengths)
            other = self.minimum(found[0], weights, steps, COARSE_TOLERANCE) if found else u
            if self._squares(other, weights) >= (1.0 - COARSE_TOLERANCE) * self._squares(u, weights):
                break
            u = other
        return u

    def beside(self, u: FloatArray, weights: FloatArray, steps: FloatArray) -> FloatArray:
        """Search for lower minima that contact events separate from the minimum `u`, and return the lowest minimum.

        Between contact events, a simulation depends almost linearly on the keys. A single run at a point therefore
        predicts the sum of squares at the nearest minimum: the sum of squares of the residuals without the part that
        the slopes can remove.
        """
        factor = self._each(weights)
        for _ in range(VALLEYS):
            slopes = factor[:, None] * self.slopes(u, steps).values[self.known]
            lengths, singular, directions = axes_of(slopes)
            kept = singular > MIN_SINGULAR_VALUE
            axes = directions[kept] / lengths
            basis = slopes @ (axes / singular[kept, None]).T
            floor = partial(self._floor, factor=factor, basis=basis)
            found = dips(floor, u, axes)
            if not found or floor(found[0]) >= (1.0 - DEEPER) * floor(u):
                break
            other = self.minimum(found[0], weights, steps)
            if self._squares(other, weights) >= (1.0 - DEEPER) * self._squares(u, weights):
                break
            u = other
        return u

    def elsewhere(self, u: FloatArray, weights: FloatArray, steps: FloatArray) -> FloatArray:
        """Return the lowest minimum that is found by minimisations from random points around `u`.

        If the residuals at `u` may be noise, `u` is returned without a search.
        """
        if ratio_of(self._residuals(u)) < SUSPECT:
            return u
        random = np.random.default_rng(0)
        lowest = u
        for _ in range(STARTS):
            start = np.clip(u + AROUND * random.standard_normal(len(u)), self.low, self.high)
            if np.isfinite(self._squares(start, weights)):
                other = self.minimum(start, weights, steps, COARSE_TOLERANCE)
                lowest = min(lowest, other, key=lambda place: self._squares(place, weights))
        if self._squares(lowest, weights) >= (1.0 - DEEPER) * self._squares(u, weights):
            return u
        return self.minimum(lowest, weights, steps)

    def _floor(self, u: FloatArray, factor: FloatArray, basis: FloatArray) -> float:
        """Return the sum (F3) of the residuals without their component in the space spanned by `basis`.

        Parameters
        ----------
        u : ndarray, shape (P,)
        factor : ndarray, shape (M,)
            Weights of the measured values.
        basis : ndarray, shape (M, K)
            Orthonormal columns.
        """
        if np.any(u < self.low) or np.any(u > self.high) or (found := self._channels(u)) is None:
            return np.inf
        off: FloatArray = factor * (found - self.data.values)[self.known]
        return float(off @ off - np.sum((basis.T @ off) ** 2))

    def _squares(self, u: FloatArray, weights: FloatArray) -> float:
        """Return the sum (F3), or infinity if `u` is out of range or the run fails."""
        if np.any(u < self.low) or np.any(u > self.high) or (found := self._channels(u)) is None:
            return np.inf
        return float(np.nansum((weights[:, None] * (found - self.data.values)) ** 2))

    def minimum(self, start: FloatArray, weights: FloatArray, steps: FloatArray, tolerance: float = 1e-6) -> FloatArray:
        """Return the values that minimise (F3); the tolerance is relative to the sum of squares."""
        factor = self._each(weights)
        least = np.inf

        def residuals(u: FloatArray) -> FloatArray:
            nonlocal least
            found = self._channels(u)
            if found is None:
                return np.full(len(factor), np.inf)
            all_off = found - self.data.values
            off: FloatArray = factor * all_off[self.known]
            if (squares := float(off @ off)) < least:
                least, self.best = squares, u.copy()
            if np.all(np.nanmean(all_off**2, axis=1) < (MIN_RESIDUAL_FRACTION * self.data.spread) ** 2):
                raise _MetError
            return off

        def jacobian(u: FloatArray) -> FloatArray:
            return factor[:, None] * self.slopes(u, steps).values[self.known]

        found = least_squares(
            residuals, start, jacobian, (self.low, self.high), x_scale="jac", ftol=tolerance, xtol=1e-6, gtol=1e-12
        )
        return np.asarray(found.x)

    def weights(self, u: FloatArray) -> FloatArray:
        """Return the reciprocal of the standard deviation of the residuals of each channel, shape (C,)."""
        squares = np.nanmean(self._residuals(u) ** 2, axis=1)
        used = 1.0 - len(u) / np.count_nonzero(self.known)
        return np.asarray(1.0 / np.maximum(np.sqrt(squares / used), MIN_RESIDUAL_FRACTION * self.data.spread))

    def errors(self, u: FloatArray, weights: FloatArray, steps: FloatArray) -> FloatArray:
        """Return rough estimates of the standard errors, shape (P,); infinite for keys that are not determined."""
        slopes = self.slopes(u, steps)
        found = self._determined(u, weights, slopes)
        quick = uncertainty_of(self._residuals(u), slopes.values, weights, found.inverse, draws=0)
        return np.where(found.known, quick.standard_error, np.inf)

    def solution(self, u: FloatArray, weights: FloatArray, steps: FloatArray, finished: bool, exact: bool) -> Solution:
        """Return the solution at the minimum, with intervals and lack of fit."""
        slopes = self.slopes(u, steps)
        found = self._determined(u, weights, slopes)
        draws = 0 if exact else UNCERTAINTY_DRAWS
        scaled = uncertainty_of(self._residuals(u), slopes.values, weights, found.inverse, draws)
        each = self._each(weights)[:, None]
        weighted, bent = each * slopes.values[self.known], each * (slopes.roughness * steps)[self.known]
        scaled = scaled.widened(found.inverse @ weighted.T @ bent)
        lack = Lack(0.0) if exact else lack_of(self._residuals(u))
        if finished and not exact:
            suspects = suspects_of(self.trials, u * self.scale, self._residuals(u), slopes.values, weights)
            lack = replace(lack, suspects=suspects)
        if lack.found:
            shifts = [suspect.shift for suspect in lack.suspects.named]
            scaled = scaled.scaled(lack.widening).widened(np.stack([np.zeros(len(u)), *shifts[:1]], axis=-1))
        vaguely = tuple(vague(self.varied, scaled.covariance, weighted))
        return Solution(
            values=u * self.scale,
            simulated=self._values(u),
            at_bound=self._bounds(u),
            known=found.known,
            uncertainty=replace(
                scaled,
                covariance=scaled.covariance * np.outer(self.scale, self.scale),
                half_width=scaled.half_width * self.scale,
            ),
            relations=(*found.relations, *vaguely),
            finished=finished,
            exact=exact,
            lack=lack,
        )

    def _channels(self, u: FloatArray) -> FloatArray | None:
        return self.trials(u * self.scale)

    def _values(self, u: FloatArray) -> FloatArray:
        """Return the channels of a run that is known to succeed."""
        found = self._channels(u)
        assert found is not None  # SciPy requests slopes, and ends, only at points where a run has succeeded
        return found

    def _residuals(self, u: FloatArray) -> FloatArray:
        return self.data.values - self._values(u)

    def slopes(self, u: FloatArray, steps: FloatArray) -> Slopes:
        return slopes_at(self._channels, u, self._values(u), steps, self.low, self.high)

    def _each(self, weights: FloatArray) -> FloatArray:
        """Return the weight of each measured value, shape (M,)."""
        return np.broadcast_to(weights[:, None], self.known.shape)[self.known]

    def _bounds(self, u: FloatArray) -> tuple[str, ...]:
        """Return "lowest" or "highest" for each key that is at a bound, and an empty string for other keys."""
        at_low, at_high = u - self.low < AT_BOUND, self.high - u < AT_BOUND
        return tuple("lowest" if low else "highest" if high else "" for low, high in zip(at_low, at_high, strict=True))

    def _determined(self, u: FloatArray, weights: FloatArray, slopes: Slopes) -> Determined:
        free = np.array([k for k, bound in enumerate(self._bounds(u)) if not bound], dtype=int)
        factor = self._each(weights)[:, None]
        weighted, rough = factor * slopes.values[self.known], factor * slopes.roughness[self.known]

        def probe(direction: FloatArray) -> FloatArray:
            move = np.zeros(len(u))
            move[free] = TINY_STEP * direction / np.abs(direction).max()
            found = self._channels(u + move)
            if found is None:
                return np.full(len(factor), np.inf)
            off: FloatArray = factor[:, 0] * (found - self._values(u))[self.known]
            return np.asarray(off * (np.abs(direction).max() / TINY_STEP))

        own = determined([self.varied[k] for k in free], weighted[:, free], rough[:, free], probe)
        inverse = np.zeros((len(u), len(u)))
        inverse[np.ix_(free, free)] = own.inverse
        known = np.zeros(len(u), dtype=bool)
        known[free] = own.known
        return Determined(inverse, known, own.relations)
