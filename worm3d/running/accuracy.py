"""Runs with a requested accuracy. A run is repeated with finer steps until runs agree, and its error is estimated."""

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
"""Allowed error of a step for an accuracy of 0.01, as a fraction of the body length. The allowed error is proportional
to the square of the accuracy, because the error of a run with contacts that land and slide is proportional to the
square root of the allowed error."""
FINER = 4.0
"""Ratio of the allowed errors of a step in two successive runs."""
COARSER_RUNS, MAX_REFINEMENTS = 2, 4
"""Number of coarser runs before the first run that may be the result, and the largest number of further refinements."""
FINAL, EARLIER, LEAST_SHARE = 2.0, 1.25, 0.03
"""Factors of the error estimate. The estimate is the larger of FINAL times the difference from the previous run and
EARLIER times the difference from the run before the previous run. It is at least LEAST_SHARE times the requested error,
because runs may agree by chance."""
TURN_AND_WORK = 1.25
"""Additional factor for the error estimates of turn and work. These errors decrease less steadily with finer steps than
the error of the distance. In 127 random runs, 98 % of the errors of the turn were at most twice the estimate. With a
factor of 1, only 94 % of the errors were at most twice the estimate."""
LATER_SHARE = 0.5
"""Runs may agree at the end by chance. They are therefore also compared by their rms difference over this final share
of the run. In 127 random runs, the error of the turn was at most twice the estimate in 98 % of the runs with half this
value, and in 96 % of the runs with double this value. The error of the distance was at most twice the estimate in 97 %
of the runs with either value."""
ESTIMATE_SAFETY_FACTOR = 2.0
"""A run is refined until the requested error is at least this many times the estimated error. Errors are rarely larger
than this factor times the estimate."""
OF_THE_COMPUTATION = frozenset({"real_time_factor", "newton_iterations_mean", "halved_steps"})
"""Metrics of a summary that describe the computation. They have no error estimate."""


def begin(
    problem: Problem,
    placing: Callable[[Problem], Placed] = place,
    observed: Callable[[Run], Sequence[Observer]] = lambda run: (),
    checked: Sequence[Observer] = (),
) -> Callable[[], Result]:
    """Return a function that simulates a problem, with the requested accuracy if there is one, and returns the result.

    Parameters
    ----------
    problem : Problem
    placing : callable, optional
        As in `Run`.
    observed : callable, optional
        Function of a run that may be the result. It returns the observers of the run. If a requested accuracy is not
        reached, another run follows.
    checked : sequence of Observer
        Observers of the coarser runs, which come first if an accuracy is requested.
    """
    accuracy = problem.accuracy
    if accuracy is None:
        run = Run(problem, placing)
        return lambda: run.finish(*observed(run))
    share = STEP_ERROR * (accuracy / 0.01) ** 2
    # If the allowed error is below 1e-12 of the body length, rounding errors disturb the estimated errors of steps.
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
                break  # a coarser run that fails is left out of the comparison, and the next run follows
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
    """Return distance [m], turn [rad] and work [J] from the start of a run to each row, shape (3, T)."""
    along = way(result.com, result.joints[0], result.world)
    moved = np.linalg.norm(result.com - result.com[0], axis=1) if along is None else along - along[0]
    return np.array([moved, result.heading - result.heading[0], np.cumsum(result.energy.work_contract)])


def _errors_on_the_way(found: Sequence[FloatArray], asked: float, problem: Problem) -> tuple[float, ...]:
    """Return the estimated errors of distance, turn and work at the end of the last run.

    `found` has the results of `_measured`, and `asked` is the requested error of the distance [m]. Coarse runs may
    agree by chance. Each estimate therefore has a lower bound, which is `LEAST_SHARE` times a reference: for the
    distance, the requested error; for the turn, the requested error divided by the body length; and for the work, the
    accuracy times the largest work.
    """
    accuracy, last = problem.accuracy or 0.0, found[-1]
    at_end = _errors([each[:, -1] for each in found])
    later = int((1.0 - LATER_SHARE) * last.shape[1])
    rms = [np.sqrt(np.mean(np.nan_to_num(each - last)[:, later:] ** 2, axis=1)) for each in found]
    least = np.array([asked, asked / problem.worm.length, accuracy * float(np.abs(last[2]).max())])
    off = np.maximum(np.maximum(at_end, _errors(rms)) * [1.0, TURN_AND_WORK, TURN_AND_WORK], LEAST_SHARE * least)
    return tuple(off.tolist())


def _errors(found: Sequence[FloatArray]) -> tuple[float, ...]:
    """Return the estimated errors of the last run, from its differences to the two runs before."""
    *coarser, last = found
    before = coarser[max(0, len(coarser) - 2)]
    off = np.maximum(FINAL * abs(coarser[-1] - last), EARLIER * abs(before - last))
    return tuple(off.tolist())


def _errors_of_figures(summaries: Sequence[Mapping[str, Any]], accuracy: float) -> tuple[tuple[str, float], ...]:
    """Return the name and the estimated error of each metric that has a number in all of the last runs.

    The error is 0 if the values of the runs are equal.
    """
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
