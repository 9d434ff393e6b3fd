"""Prediction of regimes, friction and loads in a step, which is the initial guess of Newton's method.

All contacts are assumed to continue as in the last two steps. A wrong guess costs iterations, but does not affect the
solution.
"""

from __future__ import annotations

from worm3d.machine import vectors
from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner
from worm3d.physics.kernels import point
from worm3d.solver import arrays as a
from worm3d.solver import regimes
from worm3d.solver.arrays import Core
from worm3d.solver.block import address, combine, copy, dot, fill, matrix, rows, vector
from worm3d.solver.entry import kernel

SMOOTH = 0.02
"""Largest change of motion that is extrapolated: squared norm of the change, divided by squared norm of the motion."""

_LOAD_N, _LOAD_M = point.POINT_LAYOUT.firsts("load_n", "load_m")
_PULL, _PULL_M = point.POINT_LAYOUT.firsts("pull", "pull_m")
_FORESEEN, _ERROR, _FIRST, _DT = point.POINT_LAYOUT.firsts("foreseen", "error", "first", "dt")


@inner
def goes_on(core: Core) -> bool:
    """Return whether the change of motion in the last step is small enough to extrapolate."""
    last, curve = vector(core.block, a.LAST), vector(core.block, a.CURVE)
    return bool(dot(curve, curve) < SMOOTH * dot(last, last))


@inner
def expect(core: Core) -> None:
    """Set the contacts to the expected regimes. Before the call, they have the regimes at the end of the last step."""
    p, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT)
    first, now = rows(core.block, a.POINT_IN, _FIRST, 3), rows(core.block, a.POINTS_PAST, 0, 3)
    before = rows(core.block, a.POINTS_PAST, 3, 3)
    if goes_on(core):  # BDF2: the last motion and its change
        combine(first, 2.0 * p[_DT, 0], rows(core.block, a.POINT_VELOCITY, 0, 3), -1.0, now)
        combine(first, 1.0, first, 1.0, before)
    else:
        combine(first, 1.0, now, -1.0, before)
    fill(rows(core.block, a.POINT_IN, _ERROR, 1), 0.0)
    regimes.look(core, a.POINT_NEAR)
    fill(rows(core.block, a.POINT_IN, _ERROR, 1), regimes.PRESSED * vector(core.block, a.NUMBERS_)[a.L0])
    for start in range(0, p.shape[1], vectors.VECTOR_WIDTH):
        if regimes.seen(core, start):
            evaluate_kernel(kernel(core, a.POINT_EXPECTED), p, out[:4], vectors.VECTOR_WIDTH, start)
            for row in range(4):
                here = address(core.block, a.YIELDING_OUT, row) + 8 * start
                vectors.move(address(core.block, a.POINT_IN, _PULL + row) + 8 * start, here, vectors.VECTOR_WIDTH)


@inner
def keep(core: Core) -> None:
    """Store friction and loads at the start of the step, from which the next step computes the trend."""
    copy(rows(core.block, a.POINT_IN, _PULL_M, 2), vector(core.block, a.PULL_N))
    copy(rows(core.block, a.POINT_IN, _LOAD_M, 1), rows(core.block, a.POINT_IN, _LOAD_N, 1))
