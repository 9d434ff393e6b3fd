"""Newton-Raphson iteration (P1), (P2) with exact derivatives, compiled.

Newton's method first solves the equations of the step with the normal loads of each iterate. The Jacobian is then
unsymmetric. The iteration starts from a guess of the motion. If it does not converge, it starts again from the state at
the start of the step. If this fails too, the fallback begins. Each pass of the fallback minimises the potential of the
step for given loads (`worm3d.solver.descent`), runs Newton's method from the minimum, and then updates the loads.
"""

from __future__ import annotations

import numpy as np

from worm3d.machine import vectors
from worm3d.machine.banded import lu_factor, lu_solve
from worm3d.machine.compiled import inner
from worm3d.physics.kernels import point
from worm3d.solver import arrays as a
from worm3d.solver import fronts, loads, regimes
from worm3d.solver.arrays import Core
from worm3d.solver.block import combine, copy, fill, matrix, rows, total, vector
from worm3d.solver.descent import MAX_ITERATIONS, SMALL_STEP, descend, largest
from worm3d.solver.entry import call, count, kernel, opened
from worm3d.solver.evaluate import (
    LOAD_ROW,
    LOCAL_HESSIAN,
    NO_HESSIAN,
    WHOLE_HESSIAN,
    evaluate,
    hold,
)

RELAXATIONS = np.array([1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.25, 0.25] + 17 * [0.1])
"""Relaxation factor for the update of the normal loads after each pass of the fallback."""
DIVERGED = 0.1
"""Largest Newton step, as a fraction of the body length. A larger step ends the iteration."""
STRAY_STEP = 0.02
"""Newton step that never counts as straying, as a fraction of the segment length. A step strays if it is larger than
this limit and larger than the first step."""
MAX_STRAYS = 2
"""Number of straying steps after which Newton's method still continues. When many contacts release at once, the descent
finds the solution sooner."""
CONTRACTION = 0.2
"""Largest ratio of a step to the previous step for which the Jacobian is kept."""
CURVATURE = 10.0
"""Estimated error of the first-order motion of a contact point in a step of size s, divided by s^2/l0."""
DOUBT = 2.0
"""Factor by which the estimated error grows with each earlier iteration in which contacts changed regime."""
EARLY_RELEASE_MARGIN = 10.0
"""Condition for contacts to break away before Newton's method has converged: the distance of every stuck contact from
the static limit must be at least this number times the last change of the distance. The outcome is the same as after
convergence."""
SLIDE_AT_ONCE = 25.0
"""Square of the ratio of eta(y) to the yield limit beyond which a stuck contact slides at once if there is no
guess."""
KEPT_JACOBIAN_MOTION = 3e-4
"""Largest change of x, as a fraction of the segment length, for which the Jacobian is kept. Only the contributions of
changed contacts are then replaced."""
STAGNATION = 1e-12
"""Newton step, as a fraction of the body length, below which a step that no longer shrinks counts as rounding."""

NO_EVENT, CONTACT_TURNED, CONTACT_FREED, CONTACT_CHANGED = range(4)
"""What happened to the contacts in an iteration: nothing, a sliding or stuck contact turned, a contact broke away, or a
contact changed regime."""

_LOAD, _REGIME, _BREAKS = point.POINT_LAYOUT.firsts("load", "regime", "breaks")


@inner
def solve(core: Core, again: bool) -> bool:
    """Move x to the solution of the step, and return whether Newton's method converged.

    On success the outputs of the kernels belong to the solution, with the loads of the solution.

    Parameters
    ----------
    again : bool
        True in the second solve of a step of the clamped worm. x then solves the step without friction on the joints,
        and the friction is now added.
    """
    return bool(call(kernel(core, a.SOLVE), core.handle, 0.0, again, 0) != 0.0)


def solve_entry(handle: int, _value: float, again: int, _b: int) -> float:
    """`solve` as an entry of the table of functions (`worm3d.solver.entry`)."""
    return 1.0 if _solve(opened(handle), again != 0) else 0.0


@inner
def _solve(core: Core, again: bool) -> bool:
    regime = rows(core.block, a.POINT_IN, _REGIME, 1)
    if again:
        regimes.set_regimes_from_law(core)
    else:
        regimes.set_regimes_from_last_step(core)
    guessed = total(vector(core.block, a.LAST)) != 0.0
    if guessed and not again:
        fronts.expect(core)
    breaks = rows(core.block, a.POINT_IN, _BREAKS, 1)
    fill(breaks, np.inf if guessed or again else SLIDE_AT_ONCE)
    found = _follow(core)
    if not found and loads.loaded(core):
        loads.release(core)
    if not found and guessed and not again:  # at the guess other contacts may stick than at the start of the step
        copy(vector(core.block, a.X), vector(core.block, a.X_N))
        regimes.set_regimes_from_last_step(core)
        fill(breaks, SLIDE_AT_ONCE)
        found = _follow(core)
    fill(regime, point.FREE)
    if found:
        return True
    count(core, 3)
    x, best = vector(core.block, a.X), vector(core.block, a.BEST)
    load, own = rows(core.block, a.POINT_IN, _LOAD, 1), rows(core.block, a.POINT_OUT, LOAD_ROW, 1)
    copy(x, vector(core.block, a.X_N))
    for relaxation in RELAXATIONS:
        if descend(core):
            copy(best, x)
            evaluate(core, a.X, True, NO_HESSIAN)
            regimes.set_regimes_from_law(core)
            found = _follow(core)
            fill(regime, point.FREE)
            if found:
                return True
            copy(x, best)
        if not evaluate(core, a.X, False, NO_HESSIAN) < np.inf:
            return False
        combine(load, 1.0 - relaxation, load, relaxation, own)
    return False


@inner
def _follow(core: Core) -> bool:
    """Run Newton's method with the loads of each iterate. The unsymmetric Jacobian is kept while it is useful.

    The residual is exact. Where the Jacobian depends on contact forces, it uses the forces predicted by the previous
    Newton step, because the forces of the iterate are far off at stiff contacts. A Newton step follows the tangent of a
    curved path, and thus changes the penetration by about the square of the step size. A stiff contact turns this
    change into a large load (Magisano, Leonetti, Garcea 2017, Comput. Methods Appl. Mech. Eng. 313, 986).

    Every contact keeps its regime until the step, to first order, makes the regime inconsistent with the friction law
    by more than the error of the step. Contacts stick within nanometres. Without this tolerance, the iterates would
    jump between the regimes. There is no potential whose decrease would show progress; the iteration ends if the
    iterates do not come closer to the solution.
    """
    x, step, numbers = vector(core.block, a.X), vector(core.block, a.DIRECTION), vector(core.block, a.NUMBERS_)
    l0, length, tolerance = numbers[a.L0], numbers[a.BODY_LENGTH], numbers[a.NEWTON_TOLERANCE]
    size, hessian, fresh, doubt, before = np.inf, WHOLE_HESSIAN, 0, 1.0, NO_EVENT
    since, far, strays, left = 0.0, 0.0, 0, MAX_ITERATIONS
    while left > 0:
        left -= 1
        previous, size = size, _newton_step(core, hessian)
        far = max(far, STRAY_STEP * l0) if far > 0.0 else size
        strays += size > far
        if not size <= DIVERGED * length or strays > MAX_STRAYS:
            return False
        fresh = fresh + 1 if hessian == WHOLE_HESSIAN else 0
        done = _converged(size / length, previous / length, fresh, tolerance)
        quiet = before == NO_EVENT and hessian == NO_HESSIAN and not done and size < SMALL_STEP * length
        news, lands = (NO_EVENT, False) if quiet else _news(core, size, doubt)
        turned = loads.loaded(core) and not lands and loads.turn(core, step)
        if news == CONTACT_CHANGED:
            doubt *= DOUBT
        elif news == NO_EVENT and done and not turned:
            if not regimes.break_away(core, 0.0):
                return True
            news = CONTACT_FREED
        if news == CONTACT_FREED:  # another problem from here on
            count(core, 2)
            doubt, strays, left = 1.0, 0, MAX_ITERATIONS
        since = 0.0 if hessian == WHOLE_HESSIAN else since
        if not lands:
            combine(x, 1.0, x, -1.0, step)
            since += size
        slow = size > CONTRACTION * previous and not _excused(core, hessian, before)
        before = news
        if slow or turned or since > KEPT_JACOBIAN_MOTION * l0:
            hessian = WHOLE_HESSIAN
        else:
            hessian = NO_HESSIAN if news == NO_EVENT else LOCAL_HESSIAN
    return False


@inner
def _news(core: Core, size: float, doubt: float) -> tuple[int, bool]:
    """Return what happened to the contacts in a step of this size, and whether an open contact lands in this step."""
    l0 = vector(core.block, a.NUMBERS_)[a.L0]
    error = doubt * CURVATURE * size * size / l0
    regimes.predict_yielding(core, vector(core.block, a.DIRECTION), error)
    lands = regimes.lands(core)
    changed, turned = regimes.change_regimes(core, step_rejected=lands)
    if changed:
        return CONTACT_CHANGED, lands
    if not turned and not lands and regimes.break_away(core, EARLY_RELEASE_MARGIN):
        return CONTACT_FREED, lands
    return CONTACT_TURNED if turned else NO_EVENT, lands


@inner
def _converged(size: float, previous: float, fresh: int, tolerance: float) -> bool:
    """Return whether a step, as a fraction of the body length, is small enough, or consists of rounding only."""
    return size < tolerance or (fresh > 1 and size < STAGNATION and size > 0.5 * previous)


@inner
def _excused(core: Core, hessian: int, before: int) -> bool:
    """Return whether a large step is acceptable after the Jacobian was adapted to changed contacts.

    It is acceptable after a change of regime. In a body with several vectors of segments it is always acceptable,
    because a new Jacobian for one contact costs more than it saves.
    """
    return hessian == LOCAL_HESSIAN and (before == CONTACT_CHANGED or core.n > vectors.VECTOR_WIDTH)


@inner
def _newton_step(core: Core, hessian: int) -> float:
    """Put Newton's step into the array "direction", and return its size, which is infinite if there is no step."""
    if not np.isfinite(evaluate(core, a.X, True, hessian)):
        return np.inf
    hold(core, hessian != NO_HESSIAN)
    factor, step = matrix(core.block, a.FACTOR), vector(core.block, a.DIRECTION)
    copy(step, vector(core.block, a.GRADIENT))
    if hessian != NO_HESSIAN:
        lu_factor(matrix(core.block, a.BANDED_JACOBIAN), factor)
    lu_solve(factor, step)
    return float(largest(core, step))
