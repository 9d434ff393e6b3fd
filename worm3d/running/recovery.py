"""Recovery of a gait from pushes: stability from separate runs, which take long and are not part of the table.

At the end of a run the worm has reached its limit cycle. From there two runs continue: one unchanged, one with a push
during the first period. The distance of the two shapes (`worm3d.measures.stability.shapes`) after each further period
shrinks by the largest modulus of the return map's multipliers that the push excites, as in (J7). If the push has
brought the worm to another cycle, such as lying on a side, the distance stays and the factor is 1: pushes of a tenth of
the weight tip the default worm. A push consists of random forces on the joints along x and y, without resultant and
moment about z, over a half-sine in time; the push does not displace the worm as a whole.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from worm3d.measures.stability import UNEVEN_ROWS, decay, shapes
from worm3d.results.result import Result
from worm3d.running.problem import Problem
from worm3d.running.run import Run
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import spelled


@spelled
def recovery(problem: Problem, *, pushes: int = 3, periods: int = 5, size: float = 0.01, seed: int = 0) -> FloatArray:
    """Return the decay factor per period of the effect of each push, shape (pushes,): below 1 the gait is stable.

    A factor of about 1 means that the push has brought the worm to another cycle, or that the worm does not recover.

    Parameters
    ----------
    problem : Problem
        Run before the pushes, long enough for the worm to reach the limit cycle. A controller restarts after this run.
    pushes : int
        Number of pushes, each different.
    periods : int
        Number of periods after each push, at least 2.
    size : float
        Root mean square of the components of the pushes, divided by the worm's weight, or without gravity by the mean k
        of the springs.
    seed : int
        Seed of the pushes.

    Raises
    ------
    ValueError
        The actuation has no period, the period is not a whole number of time steps, or a run stops early.
    """
    arguments.whole("pushes", pushes)
    arguments.number("size", size, gt=0.0)
    if arguments.whole("periods", periods) < 2:
        raise ValueError(f"periods: got {periods}, must be at least 2: a factor is that from one to the next")
    period = problem.period
    if period is None:
        raise ValueError("actuation: has no `period` [s], must have one: pushes are followed from period to period")
    step = round(period / problem.dt)
    if abs(period / problem.dt - step) > 1e-6 * step:
        raise ValueError(f"dt: {UNEVEN_ROWS}; got {problem.dt:g} s and a period of {period:g} s")
    before = _finished(problem)
    on = replace(problem, state=before.state, duration=(periods + 1) * step * problem.dt, record_every=step)
    plain, rng = _finished(on), np.random.default_rng(seed)
    rows = np.arange(1, periods + 2)
    left = []
    for _ in range(pushes):
        push = _forces(rng, before) * size * _scale(problem)
        pushed = _finished(replace(on, external_force=_Pushing(problem, push, before.state.time, period)))
        left.append(decay(shapes(pushed, rows) - shapes(plain, rows)))
    return np.array(left)


class _Pushing:
    """The external force of a run plus a push of shape (N+1, 3) [N], over a period [s] from a given time."""

    def __init__(self, problem: Problem, push: FloatArray, begin: float, period: float) -> None:
        self._own, self._push, self._begin, self._period = problem.external_force, push, begin, period

    def __call__(self, t: float) -> FloatArray:
        part = (t - self._begin) / self._period
        force: FloatArray = self._push * float(np.sin(np.pi * part) if 0.0 < part < 1.0 else 0.0)
        if self._own is None:
            return force
        total: FloatArray = force + np.asarray(self._own(t), dtype=float)
        return total


def _forces(rng: np.random.Generator, result: Result) -> FloatArray:
    """Return random forces on the joints without resultant and moment about z, shape (N+1, 3)."""
    joints = result.joints[-1]
    arm = joints[:, :2] - joints[:, :2].mean(axis=0)
    force: FloatArray = np.zeros_like(joints)
    force[:, :2] = rng.standard_normal(arm.shape)
    force -= force.mean(axis=0)
    moment = float((arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]).sum())
    force[:, :2] -= moment * np.column_stack([-arm[:, 1], arm[:, 0]]) / float((arm**2).sum())
    return force


def _scale(problem: Problem) -> float:
    weight = problem.worm.mass * float(np.linalg.norm(problem.weight))
    return weight if weight > 0.0 else float(np.mean(problem.worm.k_spring))


def _finished(problem: Problem) -> Result:
    result = Run(problem).finish()
    if result.status.name != "DONE":
        raise ValueError(f"problem: {result.stop.sentence}; a gait is pushed only where it runs to the end")
    return result
