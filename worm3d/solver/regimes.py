"""Regimes of the contacts (open, sliding, sticking), which Newton's method keeps until the law denies them."""

from __future__ import annotations

from worm3d.machine.codegen import evaluate as run
from worm3d.machine.compiled import inner, njit
from worm3d.physics.kernels import point, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import BLOCK, Core
from worm3d.solver.block import copy, fill, matrix, rows, vector
from worm3d.solver.entry import kernel
from worm3d.values.arrays import FloatArray

_LOAD_N, _REGIME, _STIFFNESS, _CAP = point.LAYOUT.firsts("load_n", "regime", "stiffness", "cap")
_DQ, _FIRST, _PULL = segment.LAYOUT.first("dq"), *point.LAYOUT.firsts("first", "pull")
_FORESEEN, _ERROR = point.LAYOUT.firsts("foreseen", "error")
Y, EXCESS, TOUCHING, PULL, SWING, NEXT, STALE, REACH, RECENT = 0, 2, 3, 4, 7, 8, 9, 10, 11
"""Rows of "yielding_out"."""

SHALLOW = 1e-5
"""Penetration of a landing contact, as a fraction of the segment length, up to which a step is taken."""

PRESSED = 1e-3
"""Penetration, as a fraction of the segment length, that gives a landing contact its load until a step foresees it."""


@inner
def last(core: Core) -> None:
    """Take every contact for what it was in the last step."""
    p, stuck = matrix(core.block, a.POINT_IN), vector(core.block, a.STUCK)
    copy(rows(core.block, a.POINT_IN, _PULL, 2), vector(core.block, a.PULL_N))
    copy(p[_FORESEEN], p[_LOAD_N])
    for k in range(p.shape[1]):
        touched = p[_LOAD_N, k] > 0.0
        resting = sticking(p[_PULL, k])
        p[_REGIME, k] = (resting if stuck[k] > 0.0 else point.SLIDING) if touched else point.OPEN


@inner
def own(core: Core) -> None:
    """Take every contact for what the law says at the last evaluation."""
    look(core)
    p, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT)
    copy(p[_REGIME], out[NEXT])
    pull(core)


@inner
def pull(core: Core) -> None:
    """Take over the friction that the last look foresees."""
    copy(rows(core.block, a.POINT_IN, _PULL, 3), rows(core.block, a.YIELDING_OUT, PULL, 3))


@njit
def look(core: Core) -> None:
    """Fill "yielding_out" for the place of the last evaluation."""
    fill(rows(core.block, a.POINT_IN, _FIRST, 3), 0.0)
    p = matrix(core.block, a.POINT_IN)
    run(kernel(core, a.POINT_YIELDING), p, matrix(core.block, a.YIELDING_OUT), p.shape[1])


@inner
def look_ahead(core: Core, step: FloatArray, error: float) -> None:
    """Fill "yielding_out" for x less a step, to first order; `error` is what that may be off by [m]."""
    p, segments = matrix(core.block, a.POINT_IN), matrix(core.block, a.SEGMENT_IN)
    for r in range(segment.COORDINATES):
        for i in range(core.n):
            segments[_DQ + r, i] = -step[BLOCK * i + r]
    fill(rows(core.block, a.POINT_IN, _ERROR, 1), error)
    run(kernel(core, a.SEGMENT_MOTION), segments, matrix(core.block, a.FIRST), core.n)
    run(kernel(core, a.POINT_YIELDING), p, matrix(core.block, a.YIELDING_OUT), p.shape[1])


@inner
def lands(core: Core) -> bool:
    """Return whether the step, which knows nothing of an open contact, would drive it deep into the world."""
    p, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT)
    deep = SHALLOW * vector(core.block, a.NUMBERS_)[a.L0]
    for k in range(p.shape[1]):
        if out[STALE, k] != 0.0 and p[_REGIME, k] == point.OPEN and out[TOUCHING, k] > deep:
            return True
    return False


@inner
def change(core: Core, lands: bool) -> tuple[bool, bool]:
    """Change the regimes that the law denies; return whether one has changed, and whether a contact has turned.

    Parameters
    ----------
    lands : bool
        Whether the step will not be taken: stuck contacts then stay as they are.
    """
    p, out, changed, turned = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT), False, False
    concerned = vector(core.block, a.CHANGED)
    if not lands:
        pull(core)
    for k in range(p.shape[1]):
        if out[STALE, k] == 0.0:
            continue
        old, new = p[_REGIME, k], out[NEXT, k]
        if lands and old >= point.STICKING and new != point.OPEN:
            continue
        if old == point.OPEN:
            p[_PULL, k], p[_PULL + 1, k] = out[PULL, k], out[PULL + 1, k]
            p[_FORESEEN, k] = PRESSED * p[_STIFFNESS, k] * vector(core.block, a.NUMBERS_)[a.L0]
        p[_REGIME, k], concerned[k] = new, 1.0
        if old == new or (old >= point.STICKING and new >= point.STICKING):
            turned = True
        else:
            changed = True
    return changed, turned


@inner
def sticking(y: float) -> float:
    """Return the regime of a stuck contact with this displacement, or force against it, along the segment."""
    return point.STICKING if y >= 0.0 else point.STICKING_BACK


@inner
def break_away(core: Core, margin: float) -> bool:
    """Let all stuck contacts at their static limit slide with the kinetic one (C6); return whether there was one.

    Parameters
    ----------
    margin : float
        Nothing breaks away while a stuck contact is no further from its limit than this times what the last iteration
        has changed; 0 where the iterate solves the step.
    """
    p, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT)
    stuck, concerned = vector(core.block, a.STUCK), vector(core.block, a.CHANGED)
    reach, recent, breaks = out[REACH], out[RECENT], False
    for k in range(p.shape[1]):
        if p[_CAP, k] > 1.0 and p[_REGIME, k] != point.OPEN:
            if margin > 0.0 and abs(reach[k]) <= margin * recent[k]:
                return False
            breaks = breaks or reach[k] > 0.0
    if not breaks:
        return False
    for k in range(p.shape[1]):
        if p[_CAP, k] > 1.0 and p[_REGIME, k] != point.OPEN and reach[k] > 0.0:
            for row in (_PULL, _PULL + 1):
                p[row, k] /= p[_CAP, k]
            stuck[k], p[_CAP, k], concerned[k] = 0.0, 1.0, 1.0
    return True
