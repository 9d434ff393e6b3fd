"""One time step, compiled: implicit Euler or BDF2, breakaway of contacts, and storage of the past."""

from __future__ import annotations

import numpy as np

from worm3d.machine import vectors
from worm3d.machine.compiled import inner
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.friction import RESTING_PENETRATION
from worm3d.physics.kernels import actuator, inertia, joint, medium, node, point, segment
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.solver import arrays as a
from worm3d.solver import fronts, ledger, loads
from worm3d.solver.arrays import Core
from worm3d.solver.block import address, combine, copy, fill, matrix, rows, vector
from worm3d.solver.clamped import solve_clamped
from worm3d.solver.entry import call, kernel, opened, run
from worm3d.solver.evaluate import DIRECTOR, LENGTHS, TANGENT, place
from worm3d.solver.faces import turn_faces
from worm3d.solver.guard import NO_CONVERGENCE, OK, TOO_COARSE, guard
from worm3d.solver.ledger import gravity
from worm3d.solver.newton import solve

_T_REF, _D_REF = segment.SEGMENT_LAYOUT.firsts("t_ref", "d_ref")
_SPAN, _DT, _S_WEIGHTS, _COMMANDED, _COMMANDED_N = segment.SEGMENT_LAYOUT.firsts(
    "span", "dt", "weights", "commanded", "commanded_n"
)
_L_HAT, _A_HAT, _L_N, _A_N = segment.SEGMENT_LAYOUT.firsts("length_hat", "angle_hat", "length_n", "angle_n")
_JOINT_T, _JOINT_D, _J_SPAN, _J_DT = joint.JOINT_LAYOUT.firsts("t_ref", "d_ref", "span", "dt")
_HINGE, _HINGE_N, _WEIGHTS = joint.JOINT_LAYOUT.firsts("hinge", "hinge_n", "weights")
_P_SPAN, _P_DT, _P_RATIO, _DEEP, _OF_SEGMENT = point.POINT_LAYOUT.firsts(
    "span", "dt", "ratio", "deep", "segment_tangent"
)
_ANCHOR, _LIMIT_RATIO, _FRICTION = point.POINT_LAYOUT.firsts("anchor", "limit_ratio", "pull")
_SLIPPED, _NEW_VELOCITY, _NEW_ANCHOR, _NEW_STORED = point.AFTER.firsts("slipped", "velocity", "anchor", "stored")
_N_SPAN, _N_DT, _N_RATIO = node.NODE_LAYOUT.firsts("span", "dt", "ratio")
_OF_LEDGER, _OF_JOINTS_LEDGER, _OF_NODES_LEDGER = (len(each.LEDGER_TERMS) for each in (segment, joint, node))
_GIVEN, _HINGE_STATES = actuator.LEDGER_ROWS, actuator.HINGE_ROWS


@inner
def step(core: Core, dt: float, bdf2: bool) -> int:
    """Advance the worm by a step to the present commands. Return OK or the reason of failure (`worm3d.solver.guard`).

    A failed step leaves the worm unchanged. The terms of the energy ledger are added to the array "terms", and the
    sliding distance of each contact to "slid".

    Parameters
    ----------
    dt : float
        Time step [s].
    bdf2 : bool
        Whether to use BDF2. The past must then contain two instants. They are separated by dt divided by the number
        "ratio".
    """
    return int(call(kernel(core, a.STEP_ENTRY), core.handle, dt, bdf2, 0))


def step_entry(handle: int, dt: float, bdf2: int, _b: int) -> float:
    """`step` as an entry of the table of functions (`worm3d.solver.entry`)."""
    return float(_step(opened(handle), dt, bdf2 != 0))


@inner
def _step(core: Core, dt: float, bdf2: bool) -> int:
    end, span = solve_step(core, dt, bdf2)
    if end == OK:
        commit(core, dt, bdf2, span)
    return end


@inner
def solve_step(core: Core, dt: float, bdf2: bool) -> tuple[int, float]:
    """Solve a step and add its terms to the energy ledger. Return OK or the reason of failure, and `begin`'s span."""
    place_start(core)
    span = begin(core, dt, bdf2)
    clamped = vector(core.block, a.NUMBERS_)[a.CLAMPED] != 0.0
    solved = solve_clamped(core, dt) if clamped else _solve_contact(core)
    end = guard(core) if solved else NO_CONVERGENCE
    if end == OK and not _fine(core):
        end = TOO_COARSE
    if end != OK:
        copy(vector(core.block, a.X), vector(core.block, a.X_N))
        copy(vector(core.block, a.STUCK), vector(core.block, a.STUCK_N))
        if end == TOO_COARSE:
            copy(rows(core.block, a.POINT_IN, _FRICTION, 2), vector(core.block, a.PULL_N))
        else:
            fill(vector(core.block, a.LAST), 0.0)
            fill(vector(core.block, a.CURVE), 0.0)
        return end, span
    fronts.keep(core)
    ledger.prepare(core)
    ledger.add(core, vector(core.block, a.TERMS_))
    if loads.loaded(core):
        loads.finish(core, vector(core.block, a.TERMS_))
    return OK, span


@inner
def commit(core: Core, dt: float, bdf2: bool, span: float) -> None:
    """Make the solution of a step, of which `solve_step` returned the span, the present state."""
    _commit(core)
    if bdf2 and span == dt:  # a strike has changed the velocity suddenly: both past velocities become the new velocity
        for velocity in (a.JOINT_VELOCITY, a.POINT_VELOCITY):
            copy(rows(core.block, velocity, 3, 3), rows(core.block, velocity, 0, 3))


_weights = inner(inertia.weights)


@inner
def _fine(core: Core) -> bool:
    """Return whether the error of a step is allowed.

    The error is estimated as half of the largest distance of a joint from its prediction, per axis. The prediction of a
    joint lies on the parabola through its last three positions. The error of BDF2 is 2/11 of this distance for equal
    steps, and 1/7 to 1/4 of it for any steps.
    """
    numbers = vector(core.block, a.NUMBERS_)
    if numbers[a.ALLOWED] == np.inf:
        return True
    x, x_n = vector(core.block, a.X), vector(core.block, a.X_N)
    last, curve, most = vector(core.block, a.LAST), vector(core.block, a.CURVE), 0.0
    for j in range(0, len(x), BLOCK_SIZE):
        for k in range(j, j + 3):
            most = max(most, abs(x[k] - x_n[k] - last[k] - curve[k]))
    numbers[a.ERROR] = 0.5 * most
    return bool(numbers[a.ERROR] <= numbers[a.ALLOWED])


@inner
def place_start(core: Core) -> None:
    """Make the present state the start of a step, and compute the points at the commands of the last step."""
    x = vector(core.block, a.X)
    for j in range(core.n + 1):
        x[BLOCK_SIZE * j + 3] = 0.0
    copy(vector(core.block, a.X_N), x)
    copy(vector(core.block, a.STUCK_N), vector(core.block, a.STUCK))
    _exchange_commands(core)
    place(core, x)
    turn_faces(core)
    _exchange_commands(core)


@inner
def _exchange_commands(core: Core) -> None:
    """Exchange the commanded rest lengths at the end and at the start of the step.

    The points at the start of a step belong to the rest lengths at the start, on which the outline of a chamber may
    depend (`worm3d.physics.segment_laws`).
    """
    now, before = rows(core.block, a.SEGMENT_IN, _COMMANDED, 2), rows(core.block, a.SEGMENT_IN, _COMMANDED_N, 2)
    for k in range(now.size):
        now[k], before[k] = before[k], now[k]


@inner
def _strikes(core: Core, dt: float) -> bool:
    """Return whether a point strikes the world in this step.

    A point strikes if its velocity would move it deeper into the world than a resting contact penetrates, and farther
    than gravity moves it in the step. BDF2 extrapolates velocities and would throw the point back. With implicit Euler
    the impact is inelastic. A heavily loaded foot that does not move does not strike.
    """
    p, numbers = matrix(core.block, a.POINT_IN), vector(core.block, a.NUMBERS_)
    deep = max(gravity(core) * dt * dt, RESTING_PENETRATION * numbers[a.L0])
    return bool(vectors.greatest(address(core.block, a.POINT_IN, _DEEP), p.shape[1]) > deep)


@inner
def begin(core: Core, dt: float, bdf2: bool) -> float:
    """Fill all other values that are known at the start of a step.

    Return span = beta dt [s]. It is dt for implicit Euler, and in a step in which a point strikes the world. For BDF2
    at equal steps it is 2/3 dt.
    """
    ratio = vector(core.block, a.NUMBERS_)[a.RATIO] if bdf2 else 0.0
    span = dt * (1.0 + ratio) / (1.0 + 2.0 * ratio)
    _begin_points(core, dt, span, ratio)
    if bdf2 and _strikes(core, dt):
        span = dt
        _begin_points(core, dt, span, 0.0)
    if kernel(core, a.MEDIUM_RESISTANCE) != 0:
        _begin_medium(core, dt, ratio)
    _begin_joints(core, dt, span, ratio if span != dt else 0.0)
    _begin_strains(core, dt, span, ratio if span != dt else 0.0)
    if loads.loaded(core):
        loads.begin(core, dt, span, ratio if span != dt else 0.0)
    copy(vector(core.block, a.PULL_N), rows(core.block, a.POINT_IN, _FRICTION, 2))
    x = vector(core.block, a.X)
    combine(x, 1.0, x, 1.0, vector(core.block, a.LAST))
    if fronts.goes_on(core):
        combine(x, 1.0, x, 1.0, vector(core.block, a.CURVE))
    return span


@inner
def _begin_medium(core: Core, dt: float, ratio: float) -> None:
    """Set the resistance of the medium to each joint, (D1), for the predicted shape at the end of the step, (D2)."""
    block, l0 = core.block, vector(core.block, a.NUMBERS_)[a.L0]
    lengths, velocity = matrix(block, a.LENGTHS), matrix(block, a.JOINT_VELOCITY)
    segments, given = matrix(block, a.SEGMENT_IN), matrix(block, a.MEDIUM_IN)
    for i in range(core.n):
        now, before = 0.5 * (lengths[0, i] + lengths[1, i]), 0.5 * (lengths[2, i] + lengths[3, i])
        rate = 0.0
        for d in range(3):
            rate += segments[_T_REF + d, i] * (velocity[d, i + 1] - velocity[d, i])
        bent = ratio * (rate - ratio * (now - before) / dt)  # half of l'' dt
        given[medium.STRAIN, i] = (now + (rate + bent) * dt) / l0 - 1.0
        given[medium.RATE, i] = (rate + 2.0 * bent) / l0
    run(core, a.MEDIUM_RESISTANCE, a.MEDIUM_IN, a.RESISTANCE, core.n)
    resistance, drag = vector(block, a.RESISTANCE), vector(block, a.DRAG)
    fill(drag, 0.0)
    for i in range(core.n):
        drag[i] += 0.5 * resistance[i]
        drag[i + 1] += 0.5 * resistance[i]


@inner
def _begin_joints(core: Core, dt: float, span: float, ratio: float) -> None:
    for row, value in ((_N_DT, dt), (_N_SPAN, span), (_N_RATIO, ratio)):
        fill(rows(core.block, a.NODE_IN, row, 1), value)
    run(core, a.NODE_START, a.NODE_IN, a.NODE_PRESETS, core.n + 1)


@inner
def _begin_strains(core: Core, dt: float, span: float, ratio: float) -> None:
    block, (w0, w1) = core.block, _weights(ratio)
    for row, value in ((_SPAN, span), (_DT, dt), (_S_WEIGHTS, w0), (_S_WEIGHTS + 1, w1)):
        fill(rows(block, a.SEGMENT_IN, row, 1), value)
    for past, hat, old in ((a.LENGTHS, _L_HAT, _L_N), (a.HINGES, _A_HAT, _A_N)):
        combine(rows(block, a.SEGMENT_IN, hat, 2), w0, rows(block, past, 0, 2), w1, rows(block, past, 2, 2))
        copy(rows(block, a.SEGMENT_IN, old, 2), rows(block, past, 0, 2))
    for row, value in ((_J_SPAN, span), (_J_DT, dt), (_WEIGHTS, w0), (_WEIGHTS + 1, w1)):
        fill(rows(block, a.JOINT_IN, row, 1), value)
    for to, source in ((_JOINT_T, _T_REF), (_JOINT_D, _D_REF)):
        for k in range(2):
            for d in range(3):
                here = address(block, a.SEGMENT_IN, source + d) + 8 * k
                vectors.move(address(block, a.JOINT_IN, to + 3 * k + d), here, core.n - 1)
    run(core, a.JOINT_START, a.JOINT_IN, a.JOINT_PRESETS, core.n - 1)


@inner
def _begin_points(core: Core, dt: float, span: float, ratio: float) -> None:
    """Set the contact values that are constant in the step, such as the tangents, and the values for the inertia."""
    lanes = matrix(core.block, a.SEGMENT_SHAPE_OUT).shape[1]
    for row, value in ((_P_DT, dt), (_P_SPAN, span), (_P_RATIO, ratio)):
        fill(rows(core.block, a.POINT_IN, row, 1), value)
    for row in range(6):  # tangent and director follow each other in both arrays
        here = address(core.block, a.SEGMENT_SHAPE_OUT, TANGENT + row)
        to = address(core.block, a.POINT_IN, _OF_SEGMENT + row)
        for i in range(0, lanes, vectors.VECTOR_WIDTH):
            vectors.repeat_8(to + 8 * i, lanes, here + 8 * i)
    run(core, a.POINT_START, a.POINT_IN, a.STARTED, POINTS_PER_SEGMENT * lanes)


@inner
def _solve_contact(core: Core) -> bool:
    """Solve the step. Stuck contacts have the static limit until they break away; return whether this succeeded."""
    limit_ratio, stuck = rows(core.block, a.POINT_IN, _LIMIT_RATIO, 1), vector(core.block, a.STUCK)
    static_ratio = vector(core.block, a.NUMBERS_)[a.STATIC_RATIO]
    for k in range(len(limit_ratio)):
        limit_ratio[k] = static_ratio if stuck[k] > 0.0 else 1.0
    return solve(core, False)


@inner
def _commit(core: Core) -> None:
    """Store the solution: shift the past, move the anchors, and update the directors."""
    block, x = core.block, vector(core.block, a.X)
    _remember(core, a.JOINTS, address(block, a.NODE_IN, 0))
    _remember(core, a.JOINT_VELOCITY, address(block, a.NODE_OUT, _OF_NODES_LEDGER))
    _remember(core, a.POINTS_PAST, address(block, a.POINT_IN, 0))
    _remember(core, a.POINT_VELOCITY, address(block, a.AFTER_OUT, _NEW_VELOCITY))
    _remember(core, a.LENGTHS, address(block, a.SEGMENT_SHAPE_OUT, LENGTHS))
    _remember(core, a.HINGES, address(block, a.SEGMENT_LEDGER_, _OF_LEDGER))
    _remember(core, a.JOINT_ANGLES_PAST, address(block, a.JOINT_OUT, _OF_JOINTS_LEDGER))
    _move_anchors(core)
    _carry_directors(core)
    last, curve = vector(block, a.LAST), vector(block, a.CURVE)
    combine(curve, 0.0, curve, -1.0, last)
    combine(last, 1.0, x, -1.0, vector(block, a.X_N))
    combine(curve, 1.0, curve, 1.0, last)
    copy(rows(block, a.SEGMENT_IN, _COMMANDED_N, 2), rows(block, a.SEGMENT_IN, _COMMANDED, 2))
    copy(rows(block, a.JOINT_IN, _HINGE_N, 1), rows(block, a.JOINT_IN, _HINGE, 1))
    _commit_actuators(core)


@inner
def _commit_actuators(core: Core) -> None:
    """Store the outputs and the states of the actuators at the end of the step."""
    block, given = core.block, vector(core.block, a.GIVEN)
    if kernel(core, a.ACTUATOR_END) != 0:
        out = matrix(block, a.ACTUATOR_OUT)
        for i in range(core.n):
            for side in range(2):
                given[2 * i + side] = out[_GIVEN + side, i]
        _remember(core, a.ACTUATOR_PAST, address(block, a.ACTUATOR_OUT, _GIVEN + 2))
    if vector(block, a.HINGE_PAST).size > 0:
        _remember(core, a.HINGE_PAST, address(block, a.HINGE_OUT, _HINGE_STATES))


@inner
def _remember(core: Core, k: int, new: int) -> None:
    """Shift array k, which holds two instants. The present becomes the past, and the values at `new` the present."""
    present, size = address(core.block, k, 0), vector(core.block, k).size // 2
    vectors.move(present + 8 * size, present, size)
    vectors.move(present, new, size)


@inner
def _move_anchors(core: Core) -> None:
    """Copy the anchors with their energy, and add their slip, from the outputs of point_after."""
    block, slid = core.block, vector(core.block, a.SLID)
    anchors, lanes = address(block, a.POINT_IN, _ANCHOR), slid.size
    vectors.move(anchors, address(block, a.AFTER_OUT, _NEW_ANCHOR), 3 * lanes)
    vectors.move(address(block, a.ANCHOR_ENERGY, 0), address(block, a.AFTER_OUT, _NEW_STORED), lanes)
    combine(slid, 1.0, slid, 1.0, rows(block, a.AFTER_OUT, _SLIPPED, 1))


@inner
def _carry_directors(core: Core) -> None:
    """Make the tangents and directors at the end of the step the references of the next step, orthonormal again."""
    rest, segments = matrix(core.block, a.SEGMENT_SHAPE_OUT), matrix(core.block, a.SEGMENT_IN)
    for i in range(core.n):
        for d in range(3):
            segments[_T_REF + d, i], segments[_D_REF + d, i] = rest[TANGENT + d, i], rest[DIRECTOR + d, i]
        straighten(core, i)


@inner
def straighten(core: Core, i: int) -> None:
    """Make the reference director of segment i a unit vector normal to the reference tangent."""
    segments, along, square = matrix(core.block, a.SEGMENT_IN), 0.0, 0.0
    for d in range(3):
        along += segments[_D_REF + d, i] * segments[_T_REF + d, i]
    for d in range(3):
        segments[_D_REF + d, i] -= along * segments[_T_REF + d, i]
        square += segments[_D_REF + d, i] ** 2
    for d in range(3):
        segments[_D_REF + d, i] /= np.sqrt(square)
