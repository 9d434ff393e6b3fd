"""Prediction of regimes, friction and loads in a step: the initial guess of Newton's method.

A wave runs along the body, and contacts change one after the other as the fronts of the wave pass. For each contact
that changes, the lead of the neighbour is recorded: the number of steps by which the neighbour changed earlier. If two
successive leads agree, the next contact is expected to change as many steps later. All other contacts continue as in
the last two steps. A wrong guess costs iterations, nothing else.
"""

from __future__ import annotations

from worm3d.machine import vectors
from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner
from worm3d.physics.kernels import point
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.solver import arrays as a
from worm3d.solver import regimes
from worm3d.solver.arrays import Core
from worm3d.solver.block import combine, copy, dot, fill, matrix, rows, vector
from worm3d.solver.entry import kernel

CONTACT_STATE, PREVIOUS, AGE, LEAD, LEAD_CONFIRMED, STEPS_LEFT = range(6)
"""Rows of "fronts".

CONTACT_STATE: state of a contact: a regime, negative if the contact slides towards the tail.
PREVIOUS: the state before. AGE: steps since the state changed.
LEAD: steps by which a neighbour changed earlier, negative for the neighbour behind.
LEAD_CONFIRMED: 1 if the neighbour's own lead was equal.
STEPS_LEFT: steps until a front arrives, 0 if no front is expected.
"""
MAX_LEAD = 20.0
"""Largest number of steps between the changes of neighbouring contacts for which a front is expected."""
SMOOTH = 0.02
"""Largest change of motion that is extrapolated: squared norm of the change over squared norm of the motion."""

_LOAD_N, _LOAD_M, _REGIME = point.POINT_LAYOUT.firsts("load_n", "load_m", "regime")
_PULL, _PULL_M = point.POINT_LAYOUT.firsts("pull", "pull_m")
_FORESEEN, _ERROR, _FIRST, _DT = point.POINT_LAYOUT.firsts("foreseen", "error", "first", "dt")


@inner
def goes_on(core: Core) -> bool:
    """Return whether the change of motion in the last step is small enough to extrapolate."""
    last, curve = vector(core.block, a.LAST), vector(core.block, a.CURVE)
    return bool(dot(curve, curve) < SMOOTH * dot(last, last))


@inner
def expect(core: Core) -> None:
    """Set contacts to the expected regimes; before the call they have the regimes of the last step."""
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
    eta = matrix(core.block, a.FRONTS)[STEPS_LEFT]
    for start in range(0, p.shape[1], vectors.VECTOR_WIDTH):
        if regimes.seen(core, start):
            evaluate_kernel(kernel(core, a.POINT_EXPECTED), p, out[:4], vectors.VECTOR_WIDTH, start)
            for k in range(start, start + vectors.VECTOR_WIDTH):
                for row in range(4):
                    if not eta[k] > 0.0:  # an expected front is trusted
                        p[_PULL + row, k] = out[row, k]
    for k in range(p.shape[1]):
        if eta[k] == 1.0:
            _arrive(core, k)


@inner
def _arrive(core: Core, k: int) -> None:
    """Give a contact the state of the neighbour on the side where the front comes from."""
    p, fronts, pull = matrix(core.block, a.POINT_IN), matrix(core.block, a.FRONTS), matrix(core.block, a.PULL_N)
    for side in (1, -1):
        j, state = k + side, 0.0
        if _passed(core, k, side):
            state = fronts[CONTACT_STATE, j]
        if state == point.OPEN:
            p[_REGIME, k] = point.OPEN
        elif state != 0.0:
            p[_PULL, k], p[_PULL + 1, k] = pull[0, j], pull[1, j]
            p[_REGIME, k] = regimes.sticking(pull[0, j]) if state == point.STICKING_FORWARD else point.SLIDING
            if p[_FORESEEN, k] <= 0.0:
                p[_FORESEEN, k] = p[_LOAD_N, j]


@inner
def _passed(core: Core, k: int, side: int) -> bool:
    """Return whether a front has passed the neighbour on a side of a contact, towards the contact."""
    fronts, j = matrix(core.block, a.FRONTS), k + side
    if not 0 <= k % (fronts.shape[1] // POINTS_PER_SEGMENT) + side < core.n:
        return False
    changed = fronts[CONTACT_STATE, j] != fronts[CONTACT_STATE, k] and fronts[PREVIOUS, j] == fronts[CONTACT_STATE, k]
    return bool(changed and side * fronts[LEAD, j] > 0.0)


@inner
def keep(core: Core) -> None:
    """Store friction and loads at the start of the step; the next step derives the trend from these values."""
    copy(rows(core.block, a.POINT_IN, _PULL_M, 2), vector(core.block, a.PULL_N))
    copy(rows(core.block, a.POINT_IN, _LOAD_M, 1), rows(core.block, a.POINT_IN, _LOAD_N, 1))


@inner
def note(core: Core) -> None:
    """Record, at the end of a step, the contacts that have changed state and the expected fronts."""
    fronts, found = matrix(core.block, a.FRONTS), matrix(core.block, a.Y_START)
    age, eta, lanes, changed = fronts[AGE], fronts[STEPS_LEFT], fronts.shape[1] // POINTS_PER_SEGMENT, 0
    for k in range(len(age)):
        age[k] += 1.0
        eta[k] = max(0.0, eta[k] - 1.0)
    for s in range(POINTS_PER_SEGMENT):
        for k in range(s * lanes, s * lanes + core.n):
            if _state(core, k) != fronts[CONTACT_STATE, k]:
                found[0, changed] = k
                changed += 1
    for m in range(changed):
        found[1, m], found[2, m] = _lead(core, int(found[0, m]))
    for m in range(changed):
        k = int(found[0, m])
        fronts[PREVIOUS, k], fronts[CONTACT_STATE, k], age[k], eta[k] = (
            fronts[CONTACT_STATE, k],
            _state(core, k),
            0.0,
            0.0,
        )
        fronts[LEAD, k], fronts[LEAD_CONFIRMED, k] = found[1, m], found[2, m]
    for m in range(changed):
        for k in range(max(0, int(found[0, m]) - 1), min(len(eta), int(found[0, m]) + 2)):
            eta[k] = _awaited(core, k)


@inner
def _state(core: Core, k: int) -> float:
    """Return the state of a contact at the end of a step."""
    p = matrix(core.block, a.POINT_IN)
    if p[_LOAD_N, k] <= 0.0:
        return point.OPEN
    if vector(core.block, a.STUCK)[k] > 0.0:
        return point.STICKING_FORWARD
    return point.SLIDING if p[_PULL, k] >= 0.0 else -point.SLIDING


@inner
def _lead(core: Core, k: int) -> tuple[float, float]:
    """Return the rows LEAD and LEAD_CONFIRMED of a contact that changes in this step."""
    fronts, state, found = matrix(core.block, a.FRONTS), _state(core, k), (0.0, 0.0)
    i = k % (fronts.shape[1] // POINTS_PER_SEGMENT)
    for side in (1, -1):
        j = k + side
        if (
            0 <= i + side < core.n
            and fronts[CONTACT_STATE, j] == state
            and fronts[PREVIOUS, j] == fronts[CONTACT_STATE, k]
        ):
            steps = fronts[AGE, j]
            if steps <= MAX_LEAD:
                found = side * steps, 1.0 if abs(fronts[LEAD, j]) == steps else 0.0
    return found


@inner
def _awaited(core: Core, k: int) -> float:
    """Return the number of steps until a steady front arrives at a contact, 0 if there is none."""
    fronts, steps = matrix(core.block, a.FRONTS), 0.0
    for side in (1, -1):
        if _passed(core, k, side) and fronts[LEAD_CONFIRMED, k + side] != 0.0:
            steps = max(steps, side * fronts[LEAD, k + side] - fronts[AGE, k + side])
    return steps
