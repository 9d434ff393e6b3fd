"""How a gait recovers from pushes: its stability by runs of its own, which take long, and so no part of the table.

From the end of a run, where the worm has come to its cycle, it goes on twice, once as before and once pushed during the
first period. The distance of the two shapes (`worm3d.measures.stability.shapes`) after each further period shrinks by
the largest modulus of the return map's multipliers that the push excites, as in (J7). It stays, and the factor is 1,
where the push has brought the worm to another cycle, as on its side: pushes of a tenth of the weight tip the default
worm. A push is random forces on the joints along x and y without resultant and moment about z, over half a wave of the
sine; it leaves the worm as a whole where it is.
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
    """Return the factor by which what each push has left shrinks a period, shape (pushes,): below 1 the gait is stable.

    About 1 means that the push was so large that the worm has come to another cycle, or that it does not recover.

    Parameters
    ----------
    problem : Problem
        Run after which the worm is pushed; long enough to come to its cycle. A controller begins anew behind it.
    pushes : int
        Number of pushes, each different.
    periods : int
        Number of periods after each push, at least 2.
    size : float
        Root mean square of the pushes' components, over the worm's weight, or without gravity over its springs' k.
    seed : int
        Seed of the pushes.

    Raises
    ------
    ValueError
        The actuation has no period, or it is no whole number of time steps; a run does not come to its end.
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
    """The force of a run and a push of shape (N+1, 3) [N] on top, over a period [s] from a time on."""

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
