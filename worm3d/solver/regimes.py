"""Regimes of contacts (open, sliding, sticking). Newton's method keeps a regime until it contradicts the friction law.

The row "pull" of the points contains the predicted friction f of (C5). (Stored states use the name "pull" for it.)
"""

from __future__ import annotations

from worm3d.machine import vectors
from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner, njit
from worm3d.physics.friction import RESTING_PENETRATION
from worm3d.physics.kernels import point, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import Core
from worm3d.solver.block import address, combine, copy, fill, matrix, rows, vector
from worm3d.solver.entry import kernel, run
from worm3d.solver.evaluate import open_at, to_segments
from worm3d.values.arrays import FloatArray

_LOAD_N, _REGIME, _STIFFNESS, _LIMIT_RATIO = point.POINT_LAYOUT.firsts("load_n", "regime", "stiffness", "limit_ratio")
_DQ, _FIRST, _FRICTION = segment.SEGMENT_LAYOUT.first("dq"), *point.POINT_LAYOUT.firsts("first", "pull")
_FORESEEN, _ERROR = point.POINT_LAYOUT.firsts("foreseen", "error")
Y, _, EXCESS, TOUCHING_DEPTH, PREDICTED_FRICTION, _, _, SWING, NEXT, STALE, STATIC_EXCESS, RECENT = range(12)
"""Rows of the array "yielding_out"."""

PRESSED = 1e-3
"""Penetration that determines the load of a landing contact in its first iteration, as a fraction of the segment
length."""


@inner
def set_regimes_from_last_step(core: Core) -> None:
    """Set the regime, friction and load of every contact to the values at the end of the last step."""
    p, stuck = matrix(core.block, a.POINT_IN), vector(core.block, a.STUCK)
    copy(rows(core.block, a.POINT_IN, _FRICTION, 2), vector(core.block, a.PULL_N))
    copy(p[_FORESEEN], p[_LOAD_N])
    for k in range(p.shape[1]):
        touched = p[_LOAD_N, k] > 0.0
        resting = sticking(p[_FRICTION, k])
        p[_REGIME, k] = (resting if stuck[k] > 0.0 else point.SLIDING) if touched else point.OPEN


@inner
def set_regimes_from_law(core: Core) -> None:
    """Set the regime of every contact to the regime that the friction law gives at the last evaluated x."""
    evaluate_yielding(core)
    p, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT)
    copy(p[_REGIME], out[NEXT])
    _take_predicted_friction(core)


@inner
def _take_predicted_friction(core: Core) -> None:
    """Copy predicted friction and load from "yielding_out" to the points."""
    copy(rows(core.block, a.POINT_IN, _FRICTION, 3), rows(core.block, a.YIELDING_OUT, PREDICTED_FRICTION, 3))


@njit
def evaluate_yielding(core: Core) -> None:
    """Fill "yielding_out" for the last evaluated x."""
    fill(rows(core.block, a.POINT_IN, _FIRST, 3), 0.0)
    run(core, a.POINT_YIELDING, a.POINT_IN, a.YIELDING_OUT, matrix(core.block, a.POINT_IN).shape[1])


@inner
def predict_yielding(core: Core, step: FloatArray, error: float) -> None:
    """Fill "yielding_out" for x minus a step, to first order. `error` bounds the error of this prediction [m]."""
    p, moved = matrix(core.block, a.POINT_IN), vector(core.block, a.STEP_CHANGE)
    combine(moved[: len(step)], -1.0, step, 0.0, step)
    to_segments(core, _DQ, address(core.block, a.STEP_CHANGE, 0))
    fill(rows(core.block, a.POINT_IN, _ERROR, 1), error)
    run(core, a.SEGMENT_MOTION, a.FORMED, a.FIRST, core.n)
    look(core, a.POINT_NEAR)
    for first in range(0, p.shape[1], vectors.VECTOR_WIDTH):
        if seen(core, first):
            run(core, a.POINT_YIELDING, a.POINT_IN, a.YIELDING_OUT, vectors.VECTOR_WIDTH, first)
        else:
            for row in range(3):
                here = address(core.block, a.POINT_IN, _FRICTION + row) + 8 * first
                to = address(core.block, a.YIELDING_OUT, PREDICTED_FRICTION + row) + 8 * first
                vectors.move(to, here, vectors.VECTOR_WIDTH)


@inner
def look(core: Core, which: int) -> None:
    """Fill the row "stale" by a kernel that marks the points for which a larger kernel has to run."""
    p = matrix(core.block, a.POINT_IN)
    evaluate_kernel(kernel(core, which), p, matrix(core.block, a.YIELDING_OUT)[STALE : STALE + 1], p.shape[1])


@inner
def seen(core: Core, first: int) -> bool:
    """Return whether the row "stale" marks a point in the vector of points that starts at `first`."""
    return bool(vectors.all_equal(address(core.block, a.YIELDING_OUT, STALE) + 8 * first, 0.0) == 0)


@inner
def lands(core: Core) -> bool:
    """Return whether the step, which ignores contacts that are open, would move such a contact deep into the world."""
    p, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT)
    deep = RESTING_PENETRATION * vector(core.block, a.NUMBERS_)[a.L0]
    for first in range(0, p.shape[1], vectors.VECTOR_WIDTH):
        if seen(core, first):
            for k in range(first, first + vectors.VECTOR_WIDTH):
                if out[STALE, k] != 0.0 and p[_REGIME, k] == point.OPEN and out[TOUCHING_DEPTH, k] > deep:
                    return True
    return False


@inner
def change_regimes(core: Core, step_rejected: bool) -> tuple[bool, bool]:
    """Change the regimes that are inconsistent with the friction law.

    Parameters
    ----------
    step_rejected : bool
        Whether the step will not be taken. Stuck contacts then either open or do not change.

    Returns
    -------
    changed : bool
        Whether a contact has another regime now.
    turned : bool
        Whether a sliding contact changed direction, or a stuck contact changed from one sticking regime to the other.
    """
    p, out, changed, turned = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT), False, False
    concerned = vector(core.block, a.CHANGED)
    if not step_rejected:
        _take_predicted_friction(core)
    for first in range(0, p.shape[1], vectors.VECTOR_WIDTH):
        if not seen(core, first):
            continue
        for k in range(first, first + vectors.VECTOR_WIDTH):
            old, new = p[_REGIME, k], out[NEXT, k]
            if out[STALE, k] == 0.0 or (step_rejected and old >= point.STICKING_FORWARD and new != point.OPEN):
                continue
            if old == point.OPEN:
                p[_FRICTION, k], p[_FRICTION + 1, k] = out[PREDICTED_FRICTION, k], out[PREDICTED_FRICTION + 1, k]
                p[_FORESEEN, k] = PRESSED * p[_STIFFNESS, k] * vector(core.block, a.NUMBERS_)[a.L0]
            p[_REGIME, k], concerned[k] = new, 1.0
            if old == new or (old >= point.STICKING_FORWARD and new >= point.STICKING_FORWARD):
                turned = True
            else:
                changed = True
    return changed, turned


@inner
def sticking(y: float) -> float:
    """Return the regime of a stuck contact. `y` is its displacement along the segment, or the friction against it."""
    return point.STICKING_FORWARD if y >= 0.0 else point.STICKING_BACK


@inner
def break_away(core: Core, margin: float) -> bool:
    """Give all stuck contacts at the static limit the kinetic limit, (C6), and return whether there was such a contact.

    Parameters
    ----------
    margin : float
        Nothing breaks away if, for any stuck contact, the distance from the limit is at most `margin` times the last
        change of this distance. 0 if the iterate solves the step.
    """
    p, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT)
    stuck, concerned = vector(core.block, a.STUCK), vector(core.block, a.CHANGED)
    excess, recent, breaks = out[STATIC_EXCESS], out[RECENT], False
    for first in range(0, p.shape[1], vectors.VECTOR_WIDTH):
        if open_at(core, first):
            continue
        for k in range(first, first + vectors.VECTOR_WIDTH):
            if p[_LIMIT_RATIO, k] > 1.0 and p[_REGIME, k] != point.OPEN:
                if margin > 0.0 and abs(excess[k]) <= margin * recent[k]:
                    return False
                breaks = breaks or excess[k] > 0.0
    if not breaks:
        return False
    for k in range(p.shape[1]):
        if p[_LIMIT_RATIO, k] > 1.0 and p[_REGIME, k] != point.OPEN and excess[k] > 0.0:
            for row in (_FRICTION, _FRICTION + 1):
                p[row, k] /= p[_LIMIT_RATIO, k]
            stuck[k], p[_LIMIT_RATIO, k], concerned[k] = 0.0, 1.0, 1.0
    return True
