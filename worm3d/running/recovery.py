"""Recovery of a gait from pushes, as a measure of its stability.

The measure needs additional runs, which take a long time. Therefore it is not part of the summary of a run.

A first run continues until the worm has reached its limit cycle. Two runs start from its final state: one without
changes, and one with a push during the first period. The difference of the shapes of the two worms
(`worm3d.measures.stability.shapes`) is compared after each further period. It decreases per period by a factor, as in
(J7) of `worm3d.measures.stability`. The factor is the largest modulus of those multipliers of the return map that the
push excites. If the push brings the worm to another cycle (for example if it tips over), the difference does not
decrease, and the factor is about 1. Pushes of a tenth of the weight make the default worm tip over.

A push consists of random forces on the joints in the directions x and y. Their sum and their moment about z are zero,
so that the push does not displace the worm as a whole. The forces vary in time as half a sine wave.
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
    """Return the decay factor of the effect of each push per period, shape (pushes,).

    The gait is stable if the factors are below 1. A factor of about 1 means that the push has brought the worm to
    another cycle, or that the worm does not recover.

    Parameters
    ----------
    problem : Problem
        Run before the pushes. It must be long enough for the worm to reach the limit cycle. A controller is reset after
        this run.
    pushes : int
        Number of pushes, each with other random forces.
    periods : int
        Number of periods after each push, at least 2.
    size : float
        Root mean square of the components of the forces, divided by the weight of the worm. Without gravity, they are
        divided by the mean stiffness k of the springs [N].
    seed : int
        Seed of the random forces.

    Raises
    ------
    ValueError
        The actuation has no period, the period is not a whole number of time steps, or a run stops early.
    """
    arguments.whole("pushes", pushes)
    arguments.number("size", size, gt=0.0)
    if arguments.whole("periods", periods) < 2:
        raise ValueError(f"periods: got {periods}, must be at least 2: the factor compares successive periods")
    period = problem.period
    if period is None:
        raise ValueError(
            "actuation: has no `period` [s], must have one: the effect of a push is compared at each period"
        )
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
    """External force of a run plus a push, shape (N+1, 3) [N]. The push begins at a given time and lasts one period."""

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
    """Return random forces on the joints whose sum and moment about z are zero, shape (N+1, 3)."""
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
        raise ValueError(f"problem: {result.stop.sentence}; the recovery of a gait needs runs that reach their end")
    return result
