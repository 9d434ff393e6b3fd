"""Recovery of a gait from pushes, as a measure of its stability.

This measure is not part of a result's summary, because it needs several additional runs. At the end of a run, the worm
has reached its limit cycle. From there, a run continues without a push, and other runs continue with a push during the
first period. After each further period, the shapes of the worm in the two runs (`worm3d.measures.stability.shapes`) are
compared. Their difference shrinks by a factor per period. This factor is the largest modulus of those multipliers of
the return map that the push excites, as in (J7). If the push has brought the worm to another limit cycle, for example
lying on its side, the difference does not shrink and the factor is about 1. Pushes of a tenth of the weight tip the
default worm over.

A push consists of random forces on the joints along x and y, without resultant and moment about z, so that it does not
displace the worm as a whole. In time, the forces are a half-sine over the period.
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
    """Return the factor by which the effect of each push decays in a period, shape (pushes,).

    If the factors are below 1, the gait is stable. A factor of about 1 means that the push has brought the worm to
    another limit cycle, or that the worm does not recover.

    Parameters
    ----------
    problem : Problem
        Run before the pushes. It must be long enough for the worm to reach its limit cycle. A controller is reset after
        this run.
    pushes : int
        Number of pushes, each with other random forces.
    periods : int
        Number of periods after each push, at least 2.
    size : float
        Root mean square of the force components, divided by the weight of the worm, or without gravity by the mean
        `k_spring`.
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
    """The external force of a run plus a push, with the forces `push` of shape (N+1, 3) [N] at its maximum.

    The push starts at the time `begin` [s] and lasts a period [s].
    """

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
