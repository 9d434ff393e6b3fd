"""Newton-Raphson (P1), (P2) with exact derivatives and a line search, compiled.

First it follows the residual with the normal loads of the iterate itself, whose Jacobian is unsymmetric, from the first
guess, and again from the start of the step. Where that does not converge, passes begin that minimise the potential of
the step for given loads (it always descends) and follow from there; after each, the loads are updated.
"""

from __future__ import annotations

import numpy as np

from worm3d.machine import vectors
from worm3d.machine.banded import B, cholesky_solve
from worm3d.machine.banded_lu import lu_factor, lu_solve
from worm3d.machine.compiled import inner
from worm3d.physics.kernels import point
from worm3d.solver import arrays as a
from worm3d.solver import fronts, regimes
from worm3d.solver.arrays import BLOCK, POINTS, Core
from worm3d.solver.block import address, combine, copy, dot, fill, matrix, rows, total, vector
from worm3d.solver.entry import call, count, kernel, opened
from worm3d.solver.evaluate import LOAD, LOCAL, NONE, WHOLE, WITH_KEPT_JOINTS, evaluate, hold
from worm3d.solver.regimes import Y
from worm3d.values.arrays import FloatArray

MAX_DESCENT = 60
MAX_SEARCH = 40
MAX_FOLLOW = 40
RELAXATIONS = np.array([1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.25, 0.25] + 17 * [0.1])
"""Of the update of the loads after each pass that did not converge."""
SLOPE_LEFT = 0.9
"""A line search ends where the slope has fallen to this fraction."""
DESCENT_TOLERANCE = 1e-9
"""Largest coordinate step that ends the descent, as a fraction of the body length."""
WILD = 0.02
"""A step that is longer than the first one and than this fraction of the segment length strays."""
MAX_STRAYS = 2
"""Steps that stray before Newton gives up: where contacts let go all at once the descent finds them sooner."""
MAX_CHANGES = 16
"""Iterations in which contacts change their regime before Newton gives up."""
CONTRACTION = 0.2
"""A Jacobian is kept while steps shrink to this fraction."""
CURVATURE = 10.0
"""A step of size s moves a contact point otherwise than to first order by s^2 times this over the segment length."""
DOUBT = 2.0
"""By which that error is taken to be larger each time that contacts have changed their regime."""
TRUST = 10.0
"""Contacts break away before Newton has converged where every stuck one is further from its limit than this times what
the last step has changed. From 4 to 100 the outcome is the same as after convergence and the cost changes by 0.1 %;
without it a step in which a contact breaks away takes one or two iterations more."""
BREAKS = 25.0
"""Square of the share of the yield limit beyond which what sticks slides at once, where there is no guess to trust."""
SEGMENTS_KEPT = 3e-4
"""The Jacobian is kept, but for contacts that change, until x has moved by this fraction of the segment length."""
JOINTS_KEPT = 1e-2
"""The joints' part of the Jacobian is kept until x has moved by this fraction of the segment length."""
STAGNATION = 1e-12
"""A step below this fraction that no longer shrinks, with new Jacobians, is rounding: converged too."""

NOTHING, TURNED, FREED, CHANGED = range(4)
"""What has become of the contacts: a stuck one turns round, or a slide, one breaks away, or one changes its regime."""

_LOAD, _MU, _REGIME, _BREAKS = point.LAYOUT.firsts("load", "mu", "regime", "breaks")


@inner
def solve(core: Core, again: bool) -> bool:
    """Move x to the state that solves the step; return whether Newton converged.

    On success the kernels' outputs are those of the solution, with its own loads.

    Parameters
    ----------
    again : bool
        Whether x already solves the step as it was before friction on the joints of the clamped worm.
    """
    return bool(call(kernel(core, a.SOLVE), core.handle, 0.0, again, 0) != 0.0)


def solve_entry(handle: int, _value: float, again: int, _b: int) -> float:
    """`solve` as an entry."""
    return 1.0 if _solve(opened(handle), again != 0) else 0.0


@inner
def _solve(core: Core, again: bool) -> bool:
    regime = rows(core.block, a.POINT_IN, _REGIME, 1)
    if again:
        regimes.own(core)
    else:
        regimes.last(core)
    guessed = total(vector(core.block, a.LAST)) != 0.0
    if guessed and not again:
        fronts.expect(core)
    breaks = rows(core.block, a.POINT_IN, _BREAKS, 1)
    fill(breaks, np.inf if guessed or again else BREAKS)
    found = _follow(core)
    if not found and guessed and not again:  # other contacts may hold there than at the start of the step
        copy(vector(core.block, a.X), vector(core.block, a.X_N))
        regimes.last(core)
        fill(breaks, BREAKS)
        found = _follow(core)
    fill(regime, point.FREE)
    if found:
        return True
    count(core, 3)
    x, best = vector(core.block, a.X), vector(core.block, a.BEST)
    load, own = rows(core.block, a.POINT_IN, _LOAD, 1), rows(core.block, a.POINT_OUT, LOAD, 1)
    copy(x, vector(core.block, a.X_N))
    for relaxation in RELAXATIONS:
        if _descend(core):
            copy(best, x)
            evaluate(core, a.X, True, NONE)
            regimes.own(core)
            found = _follow(core)
            fill(regime, point.FREE)
            if found:
                return True
            copy(x, best)
        if not evaluate(core, a.X, False, NONE) < np.inf:
            return False
        combine(load, 1.0 - relaxation, load, relaxation, own)
    return False


@inner
def _follow(core: Core) -> bool:
    """Newton with the loads of the iterate itself, whose Jacobian is unsymmetric; it is kept while it serves.

    The residual is exact. In the Jacobian stand, where it depends on forces, those of the contacts that the step before
    has foreseen: those of the iterate are far off where contacts are stiff, for a step along the curved way on which
    they hold presses them by its square (Magisano, Leonetti, Garcea 2017, Comput. Methods Appl. Mech. Eng. 313, 986).

    Every contact keeps its regime until the step, to first order, leads where the law denies it by more than the step's
    own error: contacts stick within nanometres, and by the law alone the iterates would jump to and fro over that.
    There is no potential to descend: it gives up where regimes go on changing or it does not come closer.
    """
    x, step = vector(core.block, a.X), vector(core.block, a.DIRECTION)
    length, tolerance = vector(core.block, a.NUMBERS_)[a.LENGTH], vector(core.block, a.NUMBERS_)[a.TOLERANCE]
    size, moved, hessian, fresh, changes, doubt, before = np.inf, 0.0, WHOLE, 0, 0, 1.0, NOTHING
    since_joints, since_all, far, strays, left = 0.0, 0.0, 0.0, 0, MAX_FOLLOW
    while left > 0:
        left -= 1
        previous, size = size, _newton_step(core, hessian, moved > 0.0)
        far = max(far, WILD * vector(core.block, a.NUMBERS_)[a.L0]) if far > 0.0 else size
        strays += size > far
        if not size <= 0.1 * length or strays > MAX_STRAYS:
            return False
        news, lands = _news(core, size, doubt)
        renewed = hessian in (WHOLE, WITH_KEPT_JOINTS)
        fresh = fresh + 1 if renewed else 0
        if news == CHANGED:
            changes += 1
            doubt *= DOUBT
            if changes > MAX_CHANGES:
                return False
        elif news == NOTHING and _converged(size / length, previous / length, fresh, tolerance):
            if not regimes.break_away(core, 0.0):
                return True
            news = FREED
        if news == FREED:  # another problem from here on
            count(core, 2)
            changes, doubt, strays, left = 0, 1.0, 0, MAX_FOLLOW
        moved = 0.0 if lands else size
        if not lands:
            copy(vector(core.block, a.TRIAL), step)
            combine(x, 1.0, x, -1.0, step)
        since_joints = moved + (0.0 if hessian == WHOLE else since_joints)
        since_all = moved + (0.0 if renewed else since_all)
        slow = size > CONTRACTION * previous and not _excused(core, hessian, before)
        before = news
        if slow and hessian == WITH_KEPT_JOINTS and news == NOTHING:  # the joints it has kept are too stiff for that
            since_joints = np.inf
        hessian = _renewal(core, since_joints, since_all, slow, news)
    return False


@inner
def _news(core: Core, size: float, doubt: float) -> tuple[int, bool]:
    """Return what becomes of the contacts in a step of this size, and whether an open one lands in it."""
    l0 = vector(core.block, a.NUMBERS_)[a.L0]
    error = doubt * CURVATURE * size * size / l0
    regimes.look_ahead(core, vector(core.block, a.DIRECTION), error)
    lands = regimes.lands(core)
    changed, turned = regimes.change(core, lands)
    if changed:
        return CHANGED, lands
    if not turned and not lands and regimes.break_away(core, TRUST):
        return FREED, lands
    return TURNED if turned else NOTHING, lands


@inner
def _converged(size: float, previous: float, fresh: int, tolerance: float) -> bool:
    """Return whether a step, as a fraction of the body length, is small enough, or one that no longer shrinks."""
    return size < tolerance or (fresh > 1 and size < STAGNATION and size > 0.5 * previous)


@inner
def _excused(core: Core, hessian: int, before: int) -> bool:
    """Return whether a step may be large for contacts that the Jacobian was adapted to.

    Whatever that is where one has changed its regime. In a body of several vectors of segments always: to make all of
    it anew for the sake of a contact costs more than it saves.
    """
    return hessian == LOCAL and (before == CHANGED or core.n > vectors.WIDTH)


@inner
def _renewal(core: Core, since_joints: float, since_all: float, slow: bool, news: int) -> int:
    """Return what of the Jacobian is made anew, after motions since that was done last."""
    l0 = vector(core.block, a.NUMBERS_)[a.L0]
    if since_joints > JOINTS_KEPT * l0:
        return WHOLE
    if slow or since_all > SEGMENTS_KEPT * l0:
        return WITH_KEPT_JOINTS
    return NONE if news == NOTHING else LOCAL


@inner
def _newton_step(core: Core, hessian: int, follows: bool) -> float:
    """Put Newton's step into "direction"; return its size, infinite where there is none.

    Where it follows another one ("trial") with the same Jacobian it is corrected by what that one has shown.
    """
    begin = _first_changed(core) if hessian == LOCAL else 0
    if not np.isfinite(evaluate(core, a.X, True, hessian)):
        return np.inf
    hold(core, hessian != NONE)
    factor, step = matrix(core.block, a.FACTOR), vector(core.block, a.DIRECTION)
    copy(step, vector(core.block, a.GRADIENT))
    if hessian != NONE:
        lu_factor(matrix(core.block, a.BAND), factor, begin)
    lu_solve(factor, step)
    if hessian == NONE and follows:
        _correct(step, vector(core.block, a.TRIAL))
    return float(_size(core, step))


@inner
def _correct(step: FloatArray, before: FloatArray) -> None:
    """Broyden's correction of a step with a kept Jacobian, from the step before."""
    left = dot(before, step) / dot(before, before)
    if abs(left) < CONTRACTION:
        combine(step, 1.0 / (1.0 - left), step, 0.0, step)


@inner
def _first_changed(core: Core) -> int:
    """Return the first row of the band that the contacts' changes concern."""
    changed, lanes = vector(core.block, a.CHANGED), matrix(core.block, a.POINT_IN).shape[1] // POINTS
    for i in range(core.n):
        for s in range(POINTS):
            if changed[s * lanes + i] != 0.0:
                return BLOCK * i
    return 0


@inner
def _size(core: Core, step: FloatArray) -> float:
    """Return the largest entry of a step, rolls and bends turned into metres."""
    largest, lever = 0.0, vector(core.block, a.NUMBERS_)[a.LEVER]
    for k in range(len(step)):
        value = abs(step[k]) * (lever if k % BLOCK > 2 else 1.0)
        if not value <= largest:  # a NaN too
            largest = value
    return largest


@inner
def _descend(core: Core) -> bool:
    x, direction = vector(core.block, a.X), vector(core.block, a.DIRECTION)
    tolerance = DESCENT_TOLERANCE * vector(core.block, a.NUMBERS_)[a.LENGTH]
    for _ in range(MAX_DESCENT):
        phi = evaluate(core, a.X, False, WHOLE)
        if not np.isfinite(phi):
            return False
        hold(core, True)
        if not _descent_direction(core):
            return False
        if not _search(core, phi):
            return True  # no descent left above rounding
        copy(x, vector(core.block, a.BEST))
        if _size(core, direction) < tolerance:
            return True
    return False


@inner
def _descent_direction(core: Core) -> bool:
    """Solve with the Hessian, shifted until it is positive definite."""
    direction, gradient = vector(core.block, a.DIRECTION), vector(core.block, a.GRADIENT)
    band, factor = matrix(core.block, a.BAND), matrix(core.block, a.FACTOR)
    square = vector(core.block, a.NUMBERS_)[a.LEVER] ** 2
    scale, shift = 0.0, 0.0
    for k in range(len(direction)):
        if k % BLOCK < 3:
            scale = max(scale, abs(band[k, B]))
    while shift < 1e6 * scale:
        vectors.move(address(core.block, a.FACTOR, 0), address(core.block, a.BAND, 0), factor.size)
        if shift > 0.0:
            for k in range(len(direction)):
                factor[k, B] += shift * (square if k % BLOCK > 2 else 1.0)
        combine(direction, -1.0, gradient, 0.0, gradient)
        if cholesky_solve(factor, direction) and np.isfinite(total(direction)):
            return True
        shift = max(10.0 * shift, 1e-9 * scale)
    return False


@inner
def _search(core: Core, phi: float) -> bool:
    """Put into "best" a point further down the direction; False if there is none above rounding.

    Friction's slope jumps within the tiny displacement in which a contact sticks; halving alone takes ages to find
    that place: where contacts come to rest on the way is tried first.
    """
    x, gradient = vector(core.block, a.X), vector(core.block, a.GRADIENT)
    direction, trial = vector(core.block, a.DIRECTION), vector(core.block, a.TRIAL)
    slope = dot(gradient, direction)
    low, high, step, found, kinks = 0.0, 1.0, 1.0, False, -1
    for _ in range(MAX_SEARCH):
        combine(trial, 1.0, x, step, direction)
        value = evaluate(core, a.TRIAL, False, NONE)
        rise = dot(gradient, direction) if np.isfinite(value) else np.inf
        lower = value <= phi + 1e-4 * step * slope + 1e-14 * abs(phi)
        if lower:
            copy(vector(core.block, a.BEST), trial)
            found = True
            if rise <= SLOPE_LEFT * abs(slope):
                return True
        if lower and rise <= 0.0:
            low = step
        else:
            high = step
        if kinks < 0:
            kinks = _resting_points(core)
        step = _between(vector(core.block, a.KINKS)[:kinks], low, high)
    return found


@inner
def _between(kinks: FloatArray, low: float, high: float) -> float:
    """Return the middle one of the kinks between two steps, or half-way."""
    inside, middle = 0, 0
    for kink in kinks:
        if low < kink < high:
            inside += 1
    for kink in kinks:  # sorted
        if low < kink < high:
            if middle == inside // 2:
                return float(kink)
            middle += 1
    return 0.5 * (low + high)


@inner
def _sort(values: FloatArray) -> None:
    """Sort a few values in place; Numba's own sort takes seconds to compile."""
    for i in range(1, len(values)):
        value, k = values[i], i
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value


@inner
def _resting_points(core: Core) -> int:
    """Find the step lengths in (0, 1), sorted, at which sliding contacts come closest to rest, to first order."""
    x, trial = vector(core.block, a.X), vector(core.block, a.TRIAL)
    point_in, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT)
    start, kinks = matrix(core.block, a.Y_START), vector(core.block, a.KINKS)
    if not _slides(core, a.X):
        return 0
    copy(vector(core.block, a.Y_START), rows(core.block, a.YIELDING_OUT, Y, 3))
    combine(trial, 1.0, x, 1.0, vector(core.block, a.DIRECTION))
    if not _slides(core, a.TRIAL):
        return 0
    lanes, found = point_in.shape[1] // POINTS, 0
    for s in range(POINTS):
        for k in range(s * lanes, s * lanes + core.n):
            if not (point_in[_LOAD, k] > 0.0 and start[2, k] > 0.0):  # start: y and the excess
                continue
            y_x, y_l = start[0, k], start[1, k]
            d_x, d_l = out[Y, k] - y_x, out[Y + 1, k] - y_l
            along, across = point_in[_MU if y_x > 0.0 else _MU + 1, k] ** 2, point_in[_MU + 2, k] ** 2
            curve = along * d_x * d_x + across * d_l * d_l
            closest = -(along * y_x * d_x + across * y_l * d_l) / curve if curve > 0.0 else 0.0
            if 0.0 < closest < 1.0:
                kinks[found] = closest
                found += 1
    _sort(kinks[:found])
    return found


@inner
def _slides(core: Core, which: int) -> bool:
    """Run the kernel that says which contacts slide at x."""
    if not evaluate(core, which, False, NONE) < np.inf:
        return False
    regimes.look(core)
    return True
