"""The step on the paper's ground, in three parts: a predictor without friction, the loads (P9), and a corrector.

The loads are the forces that hold the heights of the joints. The corrector includes the friction (P10).
"""

from __future__ import annotations

import numpy as np

from worm3d.machine.compiled import inner
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.kernels import segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import Core
from worm3d.solver.block import fill, matrix, vector
from worm3d.solver.evaluate import NO_HESSIAN, evaluate
from worm3d.solver.newton import solve

_T_REF = segment.SEGMENT_LAYOUT.first("t_ref")


@inner
def solve_clamped(core: Core, dt: float) -> bool:
    """Solve a step of the clamped worm, and return whether Newton's method converged both times."""
    x, load = vector(core.block, a.X), vector(core.block, a.JOINT_LOAD)
    friction, past = matrix(core.block, a.JOINT_FRICTION), matrix(core.block, a.JOINTS)
    fill(vector(core.block, a.JOINT_FRICTION), 0.0)
    if not solve(core, False):
        return False
    evaluate(core, a.X, True, NO_HESSIAN)  # leaves the forces of held coordinates in the gradient
    gradient = vector(core.block, a.GRADIENT)
    for j in range(core.n + 1):
        load[j] = abs(gradient[BLOCK_SIZE * j + 2])
    for j in range(core.n + 1):
        vx, vy = (x[BLOCK_SIZE * j] - past[0, j]) / dt, (x[BLOCK_SIZE * j + 1] - past[1, j]) / dt
        tx, ty = _heading(core, j)
        along, across = _p10(core, j, vx * tx + vy * ty, vy * tx - vx * ty, load[j])
        friction[0, j], friction[1, j] = along * tx - across * ty, along * ty + across * tx
    return solve(core, True)


@inner
def _heading(core: Core, j: int) -> tuple[float, float]:
    """Return the horizontal unit vector towards the head at joint j, at the start of the step."""
    rows = matrix(core.block, a.SEGMENT_IN)
    behind, ahead = max(j - 1, 0), min(j, core.n - 1)
    tx, ty = rows[_T_REF, behind] + rows[_T_REF, ahead], rows[_T_REF + 1, behind] + rows[_T_REF + 1, ahead]
    size = np.sqrt(tx * tx + ty * ty)
    return (tx / size, ty / size) if size > 0.0 else (1.0, 0.0)


@inner
def _p10(core: Core, j: int, along: float, across: float, load: float) -> tuple[float, float]:
    """Return the friction (P10) along and across the worm. It is opposite to the velocity, on the gauge's ellipse."""
    mu, threshold = matrix(core.block, a.JOINT_MU), vector(core.block, a.NUMBERS_)[a.THRESHOLD]
    mu_x, mu_l = mu[0 if along > 0.0 else 1, j], mu[2, j]
    gauge = np.sqrt((mu_x * along) ** 2 + (mu_l * across) ** 2)
    if not (np.sqrt(along * along + across * across) > threshold and gauge > 0.0):
        return 0.0, 0.0
    return -load * mu_x * mu_x * along / gauge, -load * mu_l * mu_l * across / gauge
