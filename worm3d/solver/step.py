"""One time step, compiled: implicit Euler or BDF2, contacts that break away, and the histories."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d import vectors
from worm3d.codegen import evaluate as run
from worm3d.compiled import inner
from worm3d.kernels import joint, point, segment
from worm3d.solver import arrays as a
from worm3d.solver import fronts, ledger
from worm3d.solver.arrays import BLOCK, POINTS, Core
from worm3d.solver.block import address, combine, copy, fill, matrix, rows, vector
from worm3d.solver.clamped import solve_clamped
from worm3d.solver.entry import call, count, kernel, opened
from worm3d.solver.evaluate import DIRECTOR, LENGTHS, LOAD, TANGENT, place
from worm3d.solver.faces import turn_faces
from worm3d.solver.guard import NO_CONVERGENCE, OK, guard
from worm3d.solver.newton import solve

FloatArray = NDArray[np.float64]

MAX_BREAKAWAYS = 50
"""Rounds of contacts going from stuck to kinetic within a step; each frees at least one, so it ends anyway."""
_T_REF, _D_REF = segment.LAYOUT.firsts("t_ref", "d_ref")
_SPAN, _DT, _COMMANDED, _COMMANDED_N = segment.LAYOUT.firsts("span", "dt", "commanded", "commanded_n")
_L_HAT, _A_HAT, _L_N, _A_N = segment.LAYOUT.firsts("length_hat", "angle_hat", "length_n", "angle_n")
_JOINT_T, _JOINT_D, _J_SPAN, _J_DT = joint.LAYOUT.firsts("t_ref", "d_ref", "span", "dt")
_HINGE, _HINGE_N, _WEIGHTS, _ANGLES_N = joint.LAYOUT.firsts("hinge", "hinge_n", "weights", "angles_n")
_DISTANCE, _POINT_NORMAL, _GRIP, _X_HAT = point.LAYOUT.firsts("distance", "normal", "grip", "x_hat")
_PULL, _PULL_M, _LOAD_M = point.LAYOUT.firsts("pull", "pull_m", "load_m")
_STIFFNESS, _WEIGHT = point.LAYOUT.firsts("stiffness", "weight")
_INERTIA, _P_DT, _DEPTH_N = point.LAYOUT.firsts("inertia", "dt", "depth_n")
_TANGENTS, _ANCHOR, _HOLD, _CAP = point.LAYOUT.firsts("tangent", "anchor", "hold", "cap")
_OF_SEGMENT = point.LAYOUT.first("segment_tangent")
_LOAD, _LOAD_N, _DISTANCE_N, _STORED_N = point.LAYOUT.firsts("load", "load_n", "distance_n", "stored_n")
_TERMS_OF_SEGMENT = len(segment.LEDGER_TERMS)

IMPACT = 1e-3
"""A point that would get deeper than this fraction of the segment length, and than gravity alone moves it in a step,
strikes the world."""


@inner
def step(core: Core, dt: float, bdf2: bool) -> int:
    """Advance the worm by one step to the given commands; return OK or what became of it (`worm3d.solver.guard`).

    A step that does not end well leaves the worm as it was. The energy ledger is added to "terms", the way that each
    contact has slid to "slid".

    Parameters
    ----------
    dt : float
        [s]
    bdf2 : bool
        Whether to take BDF2: the past holds two instants dt apart.
    """
    return int(call(kernel(core, a.STEP), core.handle, dt, bdf2, 0))


def step_entry(handle: int, dt: float, bdf2: int, _b: int) -> float:
    """`step` as an entry."""
    return float(_step(opened(handle), dt, bdf2 != 0))


@inner
def _step(core: Core, dt: float, bdf2: bool) -> int:
    place_start(core)
    strikes = bdf2 and _strikes(core, dt)
    span = dt * 2.0 / 3.0 if bdf2 and not strikes else dt
    begin(core, dt, span)
    clamped = vector(core.block, a.NUMBERS_)[a.CLAMPED] != 0.0
    solved = solve_clamped(core, dt) if clamped else _solve_contact(core)
    end = guard(core) if solved else NO_CONVERGENCE
    if end != OK:
        copy(vector(core.block, a.X), vector(core.block, a.X_N))
        copy(vector(core.block, a.STUCK), vector(core.block, a.STUCK_N))
        fill(vector(core.block, a.LAST), 0.0)
        fill(vector(core.block, a.CURVE), 0.0)
        return end
    ledger.prepare(core)
    ledger.add(core, dt, span, vector(core.block, a.TERMS_))
    _commit(core, dt, span)
    if strikes:  # the jump of velocity is over: the next step starts from its outcome alone
        for velocity in (a.JOINT_VELOCITY, a.POINT_VELOCITY):
            copy(rows(core.block, velocity, 3, 3), rows(core.block, velocity, 0, 3))
    return OK


@inner
def weights(dt: float, span: float) -> tuple[float, float]:
    """Return the weights of t_n and t_{n-1} in the integrator's backward difference."""
    return (4.0 / 3.0, -1.0 / 3.0) if span != dt else (1.0, 0.0)


@inner
def place_start(core: Core) -> None:
    """Make the present state the start of a step, and put the points there."""
    x = vector(core.block, a.X)
    for j in range(core.n + 1):
        x[BLOCK * j + 3] = 0.0
    copy(vector(core.block, a.X_N), x)
    copy(vector(core.block, a.STUCK_N), vector(core.block, a.STUCK))
    place(core, x)
    turn_faces(core)


@inner
def _strikes(core: Core, dt: float) -> bool:
    """Return whether a point strikes the world in this step: BDF2, which extrapolates velocities, would throw it back.

    Such a step is taken by implicit Euler, whose impact is inelastic.
    """
    p, velocity = matrix(core.block, a.POINT_IN), matrix(core.block, a.POINT_VELOCITY)
    numbers = vector(core.block, a.NUMBERS_)
    gravity = np.sqrt(numbers[a.GRAVITY] ** 2 + numbers[a.GRAVITY + 1] ** 2 + numbers[a.GRAVITY + 2] ** 2)
    deep = max(gravity * dt * dt, IMPACT * numbers[a.L0])
    for k in range(p.shape[1]):
        if p[_STIFFNESS, k] > 0.0:
            approach = 0.0
            for d in range(3):
                approach -= velocity[d, k] * p[_POINT_NORMAL + d, k]
            if approach > 0.0 and approach * dt - p[_DISTANCE, k] > deep:
                return True
    return False


@inner
def begin(core: Core, dt: float, span: float) -> None:
    """Fill everything else that is known at the start of a step."""
    _begin_joints(core, dt, span)
    _begin_strains(core, dt, span)
    _begin_points(core, dt, span)
    _begin_contacts(core)
    x = vector(core.block, a.X)
    combine(x, 1.0, x, 1.0, vector(core.block, a.LAST))
    if fronts.goes_on(core):
        combine(x, 1.0, x, 1.0, vector(core.block, a.CURVE))


@inner
def _begin_joints(core: Core, dt: float, span: float) -> None:
    block, (w0, w1) = core.block, weights(dt, span)
    drag_hat, hat = vector(block, a.JOINT_DRAG_HAT), vector(block, a.JOINT_HAT)
    combine(drag_hat, w0, rows(block, a.JOINTS, 0, 3), w1, rows(block, a.JOINTS, 3, 3))
    combine(hat, w0, rows(block, a.JOINT_VELOCITY, 0, 3), w1, rows(block, a.JOINT_VELOCITY, 3, 3))
    combine(hat, 1.0, drag_hat, span, hat)
    mass, drag = vector(block, a.JOINT_MASS), vector(block, a.DRAG)
    combine(vector(block, a.JOINT_INERTIA), 1.0 / span**2, mass, 0.0, mass)
    combine(vector(block, a.JOINT_DRAG), 1.0 / span, drag, 0.0, drag)


@inner
def _begin_strains(core: Core, dt: float, span: float) -> None:
    block, (w0, w1) = core.block, weights(dt, span)
    fill(rows(block, a.SEGMENT_IN, _SPAN, 1), span)
    fill(rows(block, a.SEGMENT_IN, _DT, 1), dt)
    for past, hat, old in ((a.LENGTHS, _L_HAT, _L_N), (a.HINGES, _A_HAT, _A_N)):
        combine(rows(block, a.SEGMENT_IN, hat, 2), w0, rows(block, past, 0, 2), w1, rows(block, past, 2, 2))
        copy(rows(block, a.SEGMENT_IN, old, 2), rows(block, past, 0, 2))
    for row, value in ((_J_SPAN, span), (_J_DT, dt), (_WEIGHTS, w0), (_WEIGHTS + 1, w1)):
        fill(rows(block, a.JOINT_IN, row, 1), value)
    copy(rows(block, a.JOINT_IN, _ANGLES_N, 8), vector(block, a.JOINT_ANGLES_PAST))
    segments, joints = matrix(block, a.SEGMENT_IN), matrix(block, a.JOINT_IN)
    for k in range(2):
        for d in range(3):
            for i in range(core.n - 1):
                joints[_JOINT_T + 3 * k + d, i] = segments[_T_REF + d, i + k]
                joints[_JOINT_D + 3 * k + d, i] = segments[_D_REF + d, i + k]


@inner
def _begin_points(core: Core, dt: float, span: float) -> None:
    block, (w0, w1) = core.block, weights(dt, span)
    hat, mass = rows(block, a.POINT_IN, _X_HAT, 3), vector(block, a.POINT_MASS)
    combine(hat, w0, rows(block, a.POINT_VELOCITY, 0, 3), w1, rows(block, a.POINT_VELOCITY, 3, 3))
    combine(hat, w0, rows(block, a.POINTS_PAST, 0, 3), span, hat)
    combine(hat, 1.0, hat, w1, rows(block, a.POINTS_PAST, 3, 3))
    combine(rows(block, a.POINT_IN, _INERTIA, 1), 1.0 / span**2, mass, 0.0, mass)
    fill(rows(block, a.POINT_IN, _P_DT, 1), dt)


@inner
def _begin_contacts(core: Core) -> None:
    """Freeze the tangents and what else friction remembers of the start of the step."""
    p, lanes = matrix(core.block, a.POINT_IN), matrix(core.block, a.REST).shape[1]
    for row in range(6):  # tangent and director follow each other in both arrays
        here = address(core.block, a.REST, TANGENT + row)
        for s in range(POINTS):
            vectors.move(address(core.block, a.POINT_IN, _OF_SEGMENT + row) + 8 * s * lanes, here, lanes)
    run(kernel(core, a.POINT_TANGENTS), p, matrix(core.block, a.TANGENTS), p.shape[1])
    for new, old in ((_HOLD, _GRIP), (_DISTANCE_N, _DISTANCE), (_LOAD, _LOAD_N)):
        copy(p[new], p[old])
    copy(p[_STORED_N], vector(core.block, a.STORED))
    copy(vector(core.block, a.PULL_N), rows(core.block, a.POINT_IN, _PULL, 2))
    for k in range(p.shape[1]):
        p[_DEPTH_N, k] = max(0.0, -p[_DISTANCE, k])


@inner
def _solve_contact(core: Core) -> bool:
    """Solve with the static limit where stuck; contacts that yield become kinetic, and again."""
    p, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.AFTER_OUT)
    stuck, ratio = vector(core.block, a.STUCK), vector(core.block, a.NUMBERS_)[a.STATIC_RATIO]
    lanes = p.shape[1] // POINTS
    for attempt in range(MAX_BREAKAWAYS):
        for k in range(p.shape[1]):
            p[_CAP, k] = ratio if stuck[k] > 0.0 else 1.0
        if not solve(core, attempt > 0):
            return False
        if ratio == 1.0:
            return True
        run(kernel(core, a.POINT_SLIP), p, out[:2], p.shape[1])
        yielding = False
        for s in range(POINTS):
            for k in range(s * lanes, s * lanes + core.n):
                if stuck[k] > 0.0 and (out[0, k] != 0.0 or out[1, k] != 0.0):
                    stuck[k] = 0.0
                    yielding = True
        if not yielding:
            return True
        count(core, 2)
    return True


@inner
def _commit(core: Core, dt: float, span: float) -> None:
    """Shift the histories, move the anchors, carry the directors along."""
    x, w0_w1 = vector(core.block, a.X), weights(dt, span)
    joints, joint_velocity = matrix(core.block, a.JOINTS), matrix(core.block, a.JOINT_VELOCITY)
    for j in range(core.n + 1):
        for d in range(3):
            _shift(joints, joint_velocity, d, j, x[BLOCK * j + d], w0_w1, span)
    points, point_velocity = matrix(core.block, a.POINTS_PAST), matrix(core.block, a.POINT_VELOCITY)
    new = matrix(core.block, a.POINT_IN)
    for d in range(3):
        for k in range(points.shape[1]):
            _shift(points, point_velocity, d, k, new[d, k], w0_w1, span)
    joint_in, joint_out = matrix(core.block, a.JOINT_IN), matrix(core.block, a.JOINT_OUT)
    run(kernel(core, a.JOINT_ANGLES), joint_in, joint_out[:4], core.n - 1)
    _remember(core, a.LENGTHS, rows(core.block, a.REST, LENGTHS, 2))
    _remember(core, a.HINGES, rows(core.block, a.SEGMENT_OUT, _TERMS_OF_SEGMENT, 2))
    _remember(core, a.JOINT_ANGLES_PAST, rows(core.block, a.JOINT_OUT, 0, 4))
    _keep_contact_forces(core)
    _keep_past(core)
    _move_anchors(core)
    fronts.note(core)
    _carry_directors(core)
    last, curve = vector(core.block, a.LAST), vector(core.block, a.CURVE)
    combine(curve, 0.0, curve, -1.0, last)
    combine(last, 1.0, x, -1.0, vector(core.block, a.X_N))
    combine(curve, 1.0, curve, 1.0, last)
    copy(rows(core.block, a.SEGMENT_IN, _COMMANDED_N, 2), rows(core.block, a.SEGMENT_IN, _COMMANDED, 2))
    copy(joint_in[_HINGE_N], joint_in[_HINGE])


@inner
def _shift(x: FloatArray, v: FloatArray, d: int, k: int, new: float, w: tuple[float, float], span: float) -> None:
    velocity = (new - w[0] * x[d, k] - w[1] * x[3 + d, k]) / span
    x[3 + d, k], x[d, k], v[3 + d, k], v[d, k] = x[d, k], new, v[d, k], velocity


@inner
def _remember(core: Core, k: int, new: FloatArray) -> None:
    past, size = vector(core.block, k), len(new)
    copy(past[size:], past[:size])
    copy(past[:size], new)


@inner
def _keep_contact_forces(core: Core) -> None:
    """Take the forces of the world from the points' gradients: what is left without inertia and weight."""
    p, out, force = matrix(core.block, a.POINT_IN), matrix(core.block, a.POINT_OUT), matrix(core.block, a.CONTACT_FORCE)
    for d in range(3):
        for k in range(p.shape[1]):
            force[d, k] = p[_INERTIA, k] * (p[d, k] - p[_X_HAT + d, k]) - p[_WEIGHT + d, k] - out[d, k]


@inner
def _keep_past(core: Core) -> None:
    """Keep friction and loads of the start of the step, from which their trend is seen."""
    copy(rows(core.block, a.POINT_IN, _PULL_M, 2), vector(core.block, a.PULL_N))
    copy(rows(core.block, a.POINT_IN, _LOAD_M, 1), rows(core.block, a.POINT_IN, _LOAD_N, 1))


@inner
def _move_anchors(core: Core) -> None:
    p, after = matrix(core.block, a.POINT_IN), matrix(core.block, a.AFTER_OUT)
    loads, stuck = matrix(core.block, a.POINT_OUT)[LOAD], vector(core.block, a.STUCK)
    stored, lanes = vector(core.block, a.STORED), p.shape[1] // POINTS
    slid = matrix(core.block, a.SLID)
    for s in range(POINTS):
        for i in range(core.n):
            k = s * lanes + i
            along, across, touches = after[0, k], after[1, k], loads[k] > 0.0
            for d in range(3):
                if touches:
                    p[_ANCHOR + d, k] += along * p[_TANGENTS + d, k] + across * p[_TANGENTS + 3 + d, k]
                else:
                    p[_ANCHOR + d, k] = p[d, k]
            slid[s, i] += np.sqrt(along * along + across * across)
            stored[k] = after[2, k] if touches else 0.0
            stuck[k] = 1.0 if not touches or (along == 0.0 and across == 0.0) else 0.0
            p[_LOAD_N, k] = loads[k]


@inner
def _carry_directors(core: Core) -> None:
    """Make tangents and directors of the end of the step those that the next one starts from, orthonormal again."""
    rest, segments = matrix(core.block, a.REST), matrix(core.block, a.SEGMENT_IN)
    for i in range(core.n):
        along, square = 0.0, 0.0
        for d in range(3):
            along += rest[TANGENT + d, i] * rest[DIRECTOR + d, i]
        for d in range(3):
            segments[_T_REF + d, i] = rest[TANGENT + d, i]
            segments[_D_REF + d, i] = rest[DIRECTOR + d, i] - along * rest[TANGENT + d, i]
            square += segments[_D_REF + d, i] ** 2
        for d in range(3):
            segments[_D_REF + d, i] /= np.sqrt(square)
