"""Minimisation of the potential of a step for given normal loads, which is the fallback of Newton's method.

The Hessian is shifted until it is positive definite. A line search lowers the potential in every iteration, so that the
iterates cannot cycle.
"""

from __future__ import annotations

import numpy as np

from worm3d.machine import vectors
from worm3d.machine.banded import B, cholesky_solve
from worm3d.machine.compiled import inner
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.kernels import point
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.solver import arrays as a
from worm3d.solver import regimes
from worm3d.solver.arrays import Core
from worm3d.solver.block import address, combine, copy, dot, matrix, rows, total, vector
from worm3d.solver.evaluate import NO_HESSIAN, WHOLE_HESSIAN, evaluate, hold
from worm3d.solver.regimes import Y
from worm3d.values.arrays import FloatArray

MAX_ITERATIONS = 40
"""Maximum number of iterations of a descent, of trial points in a line search, and of Newton's iterations. Newton's
iterations are counted from the last breakaway of contacts."""
SMALL_STEP = 1e-9
"""Size of a step that ends a descent, as a fraction of the body length. After a Newton step below this size, contacts
are not examined again until the method has converged, if nothing has happened to them."""
SUFFICIENT = 1e-4
"""Minimum decrease of the potential at a trial point, as a fraction of the first-order decrease (Armijo's rule)."""
POTENTIAL_ROUNDING = 1e-14
"""Relative increase of the potential that counts as rounding."""

_LOAD, _MU = point.POINT_LAYOUT.firsts("load", "mu")


@inner
def descend(core: Core) -> bool:
    """Move x to the minimum of the potential for the given normal loads, and return whether a minimum was found."""
    x, direction = vector(core.block, a.X), vector(core.block, a.DIRECTION)
    tolerance = SMALL_STEP * vector(core.block, a.NUMBERS_)[a.BODY_LENGTH]
    for _ in range(MAX_ITERATIONS):
        phi = evaluate(core, a.X, False, WHOLE_HESSIAN)
        if not np.isfinite(phi):
            return False
        hold(core, True)
        if not _descent_direction(core):
            return False
        if not _search(core, phi):
            return True  # no descent left above rounding
        copy(x, vector(core.block, a.BEST))
        if largest(core, direction) < tolerance:
            return True
    return False


@inner
def _descent_direction(core: Core) -> bool:
    """Compute the direction from the Hessian, shifted until positive definite, and return whether this was possible."""
    direction, gradient = vector(core.block, a.DIRECTION), vector(core.block, a.GRADIENT)
    band, factor = matrix(core.block, a.BANDED_JACOBIAN), matrix(core.block, a.FACTOR)
    square = vector(core.block, a.NUMBERS_)[a.LEVER] ** 2
    scale, shift = 0.0, 0.0
    for k in range(len(direction)):
        if k % BLOCK_SIZE < 3:
            scale = max(scale, abs(band[k, B]))
    while shift < 1e6 * scale:
        vectors.move(address(core.block, a.FACTOR, 0), address(core.block, a.BANDED_JACOBIAN, 0), factor.size)
        if shift > 0.0:
            for k in range(len(direction)):
                factor[k, B] += shift * (square if k % BLOCK_SIZE > 2 else 1.0)
        combine(direction, -1.0, gradient, 0.0, gradient)
        if cholesky_solve(factor, direction) and np.isfinite(total(direction)):
            return True
        shift = max(10.0 * shift, 1e-9 * scale)
    return False


@inner
def _search(core: Core, phi: float) -> bool:
    """Put a lower point along the direction into "best"; return False if there is no decrease above rounding.

    Where a contact comes to rest, the slope of the potential changes within the tiny displacement in which a contact
    sticks. Halving the step would approach this place slowly. Therefore the search first tries the steps at which
    contacts come to rest.
    """
    x, gradient = vector(core.block, a.X), vector(core.block, a.GRADIENT)
    direction, trial = vector(core.block, a.DIRECTION), vector(core.block, a.TRIAL)
    slope, step, kinks = dot(gradient, direction), 1.0, -1
    for _ in range(MAX_ITERATIONS):
        combine(trial, 1.0, x, step, direction)
        value = evaluate(core, a.TRIAL, False, NO_HESSIAN)
        if value <= phi + SUFFICIENT * step * slope + POTENTIAL_ROUNDING * abs(phi):
            copy(vector(core.block, a.BEST), trial)
            return True
        if kinks < 0:
            kinks = _resting_points(core)
        step = _shorter(vector(core.block, a.KINKS)[:kinks], step)
    return False


@inner
def _shorter(kinks: FloatArray, step: float) -> float:
    """Return the middle one of the sorted kinks below a step, or half of the step if there is no such kink."""
    below = 0
    for kink in kinks:
        if kink < step:
            below += 1
    return float(kinks[below // 2]) if below > 0 else 0.5 * step


@inner
def _sort(values: FloatArray) -> None:
    """Sort a few values in place. Numba's own sort would take seconds to compile."""
    for i in range(1, len(values)):
        value, k = values[i], i
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value


@inner
def _resting_points(core: Core) -> int:
    """Store the sorted step lengths in (0, 1) at which sliding contacts come closest to rest, to first order.

    The function returns the number of these step lengths, which are in the array "kinks".
    """
    x, trial = vector(core.block, a.X), vector(core.block, a.TRIAL)
    point_in, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.YIELDING_OUT)
    start, kinks = matrix(core.block, a.Y_START), vector(core.block, a.KINKS)
    if not _slides(core, a.X):
        return 0
    copy(vector(core.block, a.Y_START), rows(core.block, a.YIELDING_OUT, Y, 3))
    combine(trial, 1.0, x, 1.0, vector(core.block, a.DIRECTION))
    if not _slides(core, a.TRIAL):
        return 0
    lanes, found = point_in.shape[1] // POINTS_PER_SEGMENT, 0
    for s in range(POINTS_PER_SEGMENT):
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
    """Run the kernel that determines which contacts slide at x; return False if the shape at x is impossible."""
    if not evaluate(core, which, False, NO_HESSIAN) < np.inf:
        return False
    regimes.evaluate_yielding(core)
    return True


@inner
def largest(core: Core, step: FloatArray) -> float:
    """Return the largest absolute entry of a step. Rolls and bends are converted to metres."""
    lever = vector(core.block, a.NUMBERS_)[a.LEVER]
    return float(vectors.largest(step.ctypes.data, len(step), lever))
