"""Runs of a requested accuracy: steps become finer until runs agree, and the result contains an error estimate."""

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

STEP_ERROR = 4e-7
"""Allowed error of a step at an accuracy of 0.01, as a fraction of the body length. The allowed error is proportional
to the square of the accuracy: if contacts land and slide, the error of a run falls with the square root of the allowed
error."""
FINER = 4.0
"""Ratio of the allowed errors of a step in two successive runs."""
COARSER_RUNS, MAX_REFINEMENTS = 2, 4
"""Number of coarser runs that a run is compared with, and the largest number of further refinements."""
FINAL, EARLIER, LEAST_SHARE = 2.0, 1.25, 0.03
"""Factors of the error estimate. The estimate is the larger of FINAL times the difference from the previous run and
EARLIER times the difference from the run before the previous run. The estimate is at least LEAST_SHARE of the requested
error, since runs may agree by chance."""
TURN_AND_WORK = 1.25
"""Further factor of the errors of turn and work, which fall less steadily with the step than the error of the distance.
Of the turns of 127 random runs 98 % lie within two estimates, and 94 % with a factor of 1; double doubles the
estimates."""
LATER_SHARE = 0.5
"""Final share of a run in which the rms difference to another run counts as much as the difference at the end: runs
that agree at the end by chance do not agree all the time. Half and double leave 98 and 96 % of these turns within two
estimates, and 97 % of the distances."""
ESTIMATE_SAFETY_FACTOR = 2.0
"""Least ratio of the requested error to the estimate; a run is refined until then, and errors are rarely larger."""
OF_THE_COMPUTATION = frozenset({"real_time_factor", "newton_iterations_mean", "halved_steps"})
"""Numbers of a summary that describe the computation; they have no error estimate."""


def begin(
    problem: Problem,
    placing: Callable[[Problem], Placed] = place,
    observed: Callable[[Run], Sequence[Observer]] = lambda run: (),
    checked: Sequence[Observer] = (),
) -> Callable[[], Result]:
    """Return a function that simulates a problem with the requested accuracy, or until the run stops early.

    Parameters
    ----------
    problem : Problem
    placing : callable, optional
        As in `Run`.
    observed : callable, optional
        Returns the observers of a run that may be the result. With an accuracy, another run follows if this run is not
        accurate enough.
    checked : sequence of Observer
        Observers of the coarser runs that come first in this case.
    """
    accuracy = problem.accuracy
    if accuracy is None:
        run = Run(problem, placing)
        return lambda: run.finish(*observed(run))
    share = STEP_ERROR * (accuracy / 0.01) ** 2
    # Below 1e-12 of the body length rounding shows in the errors of steps.
    allowed = [
        max(1e-12, share * FINER ** (COARSER_RUNS - k)) * problem.worm.length
        for k in range(COARSER_RUNS + MAX_REFINEMENTS + 1)
    ]
    coarsest = Run(problem, placing, allowed[0])

    def finish() -> Result:
        found: list[FloatArray] = []
        summaries: list[Mapping[str, Any]] = []
        seconds = 0.0
        for k, most in enumerate(allowed):
            run = Run(problem, placing, most) if k > 0 else coarsest
            may_be_it = k >= COARSER_RUNS
            result = run.finish(*(observed(run) if may_be_it else checked))
            seconds += result.wall_s
            if result.status is not Status.DONE and (may_be_it or not result.status.diverged):
                break  # a failed coarser run is no comparison
            if result.status is Status.DONE:
                found.append(_measured(result))
                summaries.append(result.summary())
            if may_be_it and len(found) > 1:
                asked = accuracy * max(abs(float(found[-1][0, -1])), 0.1 * problem.worm.length)
                distance, heading, work = _errors_on_the_way(found, asked, problem)
                figures = _errors_of_figures(summaries, accuracy)
                estimate = ErrorEstimate(distance, heading, work, asked, most, int(run.solves), k + 1, figures)
                result = replace(result, error_estimate=estimate)
                if ESTIMATE_SAFETY_FACTOR * distance <= asked:
                    break
        return replace(result, wall_s=seconds)

    return finish


def _measured(result: Result) -> FloatArray:
    """Return distance [m], turn [rad] and work [J] of a run up to each row, shape (3, T)."""
    along = way(result.com, result.joints[0], result.world)
    moved = np.linalg.norm(result.com - result.com[0], axis=1) if along is None else along - along[0]
    return np.array([moved, result.heading - result.heading[0], np.cumsum(result.energy.work_contract)])


def _errors_on_the_way(found: Sequence[FloatArray], asked: float, problem: Problem) -> tuple[float, ...]:
    """Return the estimated errors of distance, turn and work at the end of the last run.

    Runs differ at the end, or before, and coarse runs may agree by chance. Therefore each error has a lower bound, the
    same share of three values: the requested error, the turn that moves an end of the body by the requested error, and
    the accuracy times the work.
    """
    accuracy, last = problem.accuracy or 0.0, found[-1]
    at_end = _errors([each[:, -1] for each in found])
    later = int((1.0 - LATER_SHARE) * last.shape[1])
    rms = [np.sqrt(np.mean(np.nan_to_num(each - last)[:, later:] ** 2, axis=1)) for each in found]
    least = np.array([asked, asked / problem.worm.length, accuracy * float(np.abs(last[2]).max())])
    off = np.maximum(np.maximum(at_end, _errors(rms)) * [1.0, TURN_AND_WORK, TURN_AND_WORK], LEAST_SHARE * least)
    return tuple(off.tolist())


def _errors(found: Sequence[FloatArray]) -> tuple[float, ...]:
    """Return the estimated errors of the last run, from the results of the earlier runs."""
    *coarser, last = found
    before = coarser[max(0, len(coarser) - 2)]
    off = np.maximum(FINAL * abs(coarser[-1] - last), EARLIER * abs(before - last))
    return tuple(off.tolist())


def _errors_of_figures(summaries: Sequence[Mapping[str, Any]], accuracy: float) -> tuple[tuple[str, float], ...]:
    """Return name and error of each number that all the last runs have; the error is 0 if all values are equal."""
    compared = summaries[-COARSER_RUNS - 1 :]
    names = [
        name
        for name in compared[-1]
        if name not in OF_THE_COMPUTATION and all(isinstance(each.get(name), float) for each in compared)
    ]
    values = [np.array([each[name] for name in names]) for each in compared]
    off = np.array(_errors(values))
    least = LEAST_SHARE * accuracy * abs(values[-1])
    return tuple(zip(names, np.where(off > 0.0, np.maximum(off, least), 0.0).tolist(), strict=True))
