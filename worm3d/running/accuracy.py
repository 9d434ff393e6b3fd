"""Runs as accurate as was asked for: steps are made finer until runs agree, and the result says how far they do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from worm3d.measures.way import way
from worm3d.recorded.estimate import ErrorEstimate
from worm3d.recorded.status import Status
from worm3d.results.result import Result
from worm3d.running.problem import Problem
from worm3d.running.run import Observer, Run
from worm3d.running.start import Placed, place
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
FINAL, EARLIER, LEAST_SHARE = 2.0, 1.25, 0.03
"""A run is expected to be off by so many times what it differs by from the run before, or from the one before that,
whichever is more, and at least by this share of what was asked for: runs may agree by chance."""
TURN_AND_WORK = 1.25
"""Further factor of the errors of turn and work, which fall less steadily with the step than the error of the distance.
Of the turns of 127 random runs 98 % lie within two estimates, at 1 it is 94 %; double doubles the estimates."""
LATER_SHARE = 0.5
"""Last share of a run in which the rms difference to another run counts as much as the difference at the end: runs that
cross at the end by chance do not cross all the time. Half and double leave 98 and 96 % of these turns within two
estimates, and 97 % of the distances."""
SURE = 2.0
"""A run is made finer until so many times its estimate is as little as was asked for: errors are rarely larger."""
OF_THE_COMPUTATION = frozenset({"real_time_factor", "newton_iterations_mean", "halved_steps"})
"""Numbers of a summary that tell of the computation: no error is estimated for them."""
LEAST_WAY = 0.1
"""Distance, as a fraction of the body length, that an accuracy is relative to at least."""


def begin(
    problem: Problem,
    placing: Callable[[Problem], Placed] = place,
    observed: Callable[[Run], Sequence[Observer]] = lambda run: (),
    checked: Sequence[Observer] = (),
) -> Callable[[], Result]:
    """Return a function that simulates a problem: as accurately as that asks for, or as far as it gets.

    Parameters
    ----------
    problem : Problem
    placing : callable, optional
        As of `Run`.
    observed : callable, optional
        Returns the observers of a run that may be the result. With an accuracy another follows if it is not accurate
        enough.
    checked : sequence of Observer
        Of the coarser runs that come first then.
    """
    accuracy = problem.accuracy
    if accuracy is None:
        run = Run(problem, placing)
        return lambda: run.finish(*observed(run))
    share = STEP_ERROR * (accuracy / USUAL) ** 2
    allowed = [max(FINEST, share * FINER ** (CHECKS - k)) * problem.worm.length for k in range(CHECKS + TIGHTENED + 1)]
    coarsest = Run(problem, placing, allowed[0])

    def finish() -> Result:
        found: list[FloatArray] = []
        summaries: list[Mapping[str, Any]] = []
        seconds = 0.0
        for k, most in enumerate(allowed):
            run = Run(problem, placing, most) if k > 0 else coarsest
            may_be_it = k >= CHECKS
            result = run.finish(*(observed(run) if may_be_it else checked))
            seconds += result.wall_s
            if result.status is not Status.DONE and (may_be_it or not result.status.diverged):
                break  # a coarser run that failed is no comparison
            if result.status is Status.DONE:
                found.append(_measured(result))
                summaries.append(result.summary())
            if may_be_it and len(found) > 1:
                asked = accuracy * max(abs(float(found[-1][0, -1])), LEAST_WAY * problem.worm.length)
                distance, heading, work = _errors_on_the_way(found, asked, problem)
                figures = _errors_of_figures(summaries, accuracy)
                estimate = ErrorEstimate(distance, heading, work, asked, most, int(run.solves), k + 1, figures)
                result = replace(result, error_estimate=estimate)
                if SURE * distance <= asked:
                    break
        return replace(result, wall_s=seconds)

    return finish


def _measured(result: Result) -> FloatArray:
    """Return distance [m], turn [rad] and work [J] of a run until each row, shape (3, T)."""
    along = way(result.com, result.joints[0], result.world)
    moved = np.linalg.norm(result.com - result.com[0], axis=1) if along is None else along - along[0]
    return np.array([moved, result.heading - result.heading[0], np.cumsum(result.energy.work_contract)])


def _errors_on_the_way(found: Sequence[FloatArray], asked: float, problem: Problem) -> tuple[float, ...]:
    """Return what distance, turn and work of the last run are off by at its end.

    Runs differ at the end, or before, and one that was asked for little differs by little by chance: the least errors
    are the same share of what was asked for, of the turn that moves an end of the body by that, and of the work.
    """
    accuracy, last = problem.accuracy or 0.0, found[-1]
    at_end = _errors([each[:, -1] for each in found])
    later = int((1.0 - LATER_SHARE) * last.shape[1])
    rms = [np.sqrt(np.mean(np.nan_to_num(each - last)[:, later:] ** 2, axis=1)) for each in found]
    least = np.array([asked, asked / problem.worm.length, accuracy * float(np.abs(last[2]).max())])
    off = np.maximum(np.maximum(at_end, _errors(rms)) * [1.0, TURN_AND_WORK, TURN_AND_WORK], LEAST_SHARE * least)
    return tuple(off.tolist())


def _errors(found: Sequence[FloatArray]) -> tuple[float, ...]:
    """Return what the last run is off by, from what those before it found."""
    *coarser, last = found
    before = coarser[max(0, len(coarser) - 2)]
    off = np.maximum(FINAL * abs(coarser[-1] - last), EARLIER * abs(before - last))
    return tuple(off.tolist())


def _errors_of_figures(summaries: Sequence[Mapping[str, Any]], accuracy: float) -> tuple[tuple[str, float], ...]:
    """Return name and error of each number that the last runs all have; 0 for one that is the same in all of them."""
    compared = summaries[-CHECKS - 1 :]
    names = [
        name
        for name in compared[-1]
        if name not in OF_THE_COMPUTATION and all(isinstance(each.get(name), float) for each in compared)
    ]
    values = [np.array([each[name] for name in names]) for each in compared]
    off = np.array(_errors(values))
    least = LEAST_SHARE * accuracy * abs(values[-1])
    return tuple(zip(names, np.where(off > 0.0, np.maximum(off, least), 0.0).tolist(), strict=True))
