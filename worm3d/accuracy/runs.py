"""Runs as accurate as was asked for: steps are made finer until runs agree, and the result says how far they do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from worm3d.accuracy.estimate import ErrorEstimate
from worm3d.problem import Problem
from worm3d.result import Result
from worm3d.run import Observer, Run
from worm3d.start import Placed, place
from worm3d.status import Status
from worm3d.values.arrays import FloatArray

USUAL = 0.01
STEP_ERROR = 4e-7
"""Error that is allowed in a step at the usual accuracy, as a fraction of the body length; it goes with the square of
the accuracy: where contacts land and slide the error of a run falls with its square root."""
FINEST = 1e-12
"""Smallest error that is allowed in a step, as a fraction of the body length: rounding shows below."""

FINER = 4.0
"""How much less is allowed in the steps of each run than in those of the run before."""
CHECKS, TIGHTENED = 2, 4
"""Number of coarser runs that a run is compared with, and the largest number of times that it is made finer then."""
LEAST_FACTOR, SLOWEST = 2.0, 0.8
"""A run is expected to be off by so many times what it differs by from the run before, at least; if the differences of
runs fall by a ratio r, by r/(1 - r) times that, with r at most so large."""
COARSER, LEAST_SHARE = 0.5, 0.03
"""The same for its difference from the run two before, and the least error of the distance that is told, as a share of
what was asked for: runs may agree by chance."""

SURE = 2.0
"""A run is made finer until so many times its estimate is as little as was asked for: errors are rarely larger."""
LEAST_WAY = 0.1
"""Distance, as a fraction of the body length, that an accuracy is relative to at least."""


def first(problem: Problem, placing: Callable[[Problem], Placed] = place) -> Run:
    """Return the coarsest of the runs with which `finish` begins."""
    return Run(problem, placing, _allowed(problem, 0))


def _allowed(problem: Problem, k: int) -> float:
    """Return what is allowed in the steps of run k [m]."""
    assert problem.accuracy is not None
    share = STEP_ERROR * (problem.accuracy / USUAL) ** 2 * FINER ** (CHECKS - k)
    return max(FINEST, share) * problem.worm.length


def finish(
    begun: Run,
    problem: Problem,
    placing: Callable[[Problem], Placed] = place,
    observed: Callable[[Run], Sequence[Observer]] = lambda run: (),
    checked: Sequence[Observer] = (),
) -> Result:
    """Return a run that is as accurate as its problem asks for, or as far as it got.

    Parameters
    ----------
    begun : Run
        Of `first`.
    problem : Problem
    placing : callable, optional
        As of `Run`.
    observed : callable, optional
        Returns the observers of a run that may be the result. Another follows if it is not accurate enough.
    checked : sequence of Observer
        Of the coarser runs that come first.
    """
    found: list[FloatArray] = []
    seconds, run = 0.0, begun
    for k in range(CHECKS + TIGHTENED + 1):
        if k > 0:
            run = Run(problem, placing, _allowed(problem, k))
        may_be_it = k >= CHECKS
        result = run.finish(*(observed(run) if may_be_it else checked))
        seconds += result.wall_s
        if result.status is not Status.DONE and (may_be_it or not result.status.diverged):
            break  # a coarser run that failed is no comparison
        if result.status is Status.DONE:
            found.append(_measured(result))
        if may_be_it:
            result = replace(result, error_estimate=_estimate(found, problem, run, k + 1))
            if (
                result.error_estimate is not None
                and SURE * result.error_estimate.distance <= result.error_estimate.asked
            ):
                break
    return replace(result, wall_s=seconds)


def _measured(result: Result) -> FloatArray:
    """Return distance, turn and work of a run."""
    way = result.distance if np.isfinite(result.distance) else float(np.linalg.norm(result.com[-1] - result.com[0]))
    return np.array([way, result.heading[-1] - result.heading[0], result.energy.work_contract.sum()])


def _estimate(found: list[FloatArray], problem: Problem, run: Run, runs: int) -> ErrorEstimate | None:
    """Return what the last run is off by, from what those before it found; None without any."""
    *coarser, last = found
    if not coarser:
        return None
    changed, far = abs(coarser[-1] - last), abs(coarser[max(0, len(coarser) - 2)] - last)
    changed_before = abs(coarser[max(0, len(coarser) - 2)] - coarser[-1])
    ratio = changed / np.maximum(np.maximum(changed_before, changed / SLOWEST), 1e-300)
    off = np.maximum(np.maximum(LEAST_FACTOR, ratio / (1.0 - ratio)) * changed, COARSER * far)
    assert problem.accuracy is not None
    asked = problem.accuracy * max(abs(float(last[0])), LEAST_WAY * problem.worm.length)
    distance, heading, work = max(float(off[0]), LEAST_SHARE * asked), float(off[1]), float(off[2])
    return ErrorEstimate(distance, heading, work, asked, _allowed(problem, runs - 1), int(run.solves), runs)
