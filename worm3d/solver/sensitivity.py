"""Steps with sensitivities: the derivatives of every step with respect to P parameters of the commands, compiled.

The equations (FS1) and (FS2) are in `worm3d.physics.kernels.change`. The changes of the past are kept for each
parameter in the arrays "point_kept", "node_kept", "chamber_kept" and "joint_kept". Before the solution of a step
becomes the past, the exact Jacobian of the solution is factorised once, and each parameter then takes one solve. The
regime of each contact is its regime in the solution. The cost is linear in the number of segments and in P. The steps
themselves equal the steps of a run without sensitivities bit for bit.
"""

from __future__ import annotations

from worm3d.machine import vectors
from worm3d.machine.banded import lu_factor, lu_solve
from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner, njit
from worm3d.machine.later import carray
from worm3d.machine.vectors import BLOCK_SIZE, doubles_at
from worm3d.physics.kernels import change, joint, point, segment
from worm3d.physics.kernels.layout import Layout
from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT
from worm3d.solver import arrays as a
from worm3d.solver.actuate import actuate
from worm3d.solver.arrays import Core
from worm3d.solver.block import address, combine, copy, dot, fill, matrix, rows, vector
from worm3d.solver.entry import kernel, reset
from worm3d.solver.evaluate import WHOLE_HESSIAN, evaluate, exchange, hold, to_joints, to_segments
from worm3d.solver.faces import FACES
from worm3d.solver.guard import NOT_FINITE, OK, actuators_start_finite
from worm3d.solver.step import commit, solve_step
from worm3d.values.arrays import FloatArray
from worm3d.worlds.kernels import WORLD_ROWS

NORMAL_DIFFERENCE = 1e-5
"""Shift of a point, as a fraction of the segment length, with which the world's normals are differentiated. The
truncation error is the square of the shift relative to the radius of curvature, about 1e-9; half and double this value
leave the sensitivities in a bend of a pipe unchanged to 1e-8."""

_Q, _F, _NORMAL, _ENDS, _COMMAND, _FORCE = Layout(change.CHAMBER_FILLED).firsts(*change.CHAMBER_FILLED)
_J_Q, _J_T, _J_D, _J_COMMAND = Layout(change.JOINT_FILLED).firsts(*change.JOINT_FILLED)
_POINT_FILLED, _NODE_FILLED, _CHAMBER_FILLED, _JOINT_FILLED = (
    sum(each.values()) for each in (change.POINT_FILLED, change.NODE_FILLED, change.CHAMBER_FILLED, change.JOINT_FILLED)
)
_TANGENT = change.POINT_FILLED["x"]
_PAST, _VELOCITY, _ANCHOR, _, _NORMAL_N = Layout(change.POINT_PAST).firsts(*change.POINT_PAST)
_LENGTHS = 6
"""Row of the lengths of the chambers among the changes of a segment's past, after tangent and director."""
_RADIUS = segment.SEGMENT_LAYOUT.first("radius")
_REGIME, _LOAD_N, _CURVATURE = point.POINT_LAYOUT.firsts("regime", "load_n", "curvature")
_ANGLES = len(joint.LEDGER_TERMS) + 4
_PARTS = (
    (a.POINT_CHANGE, a.POINT_KEPT, _POINT_FILLED),
    (a.NODE_CHANGE, a.NODE_KEPT, _NODE_FILLED),
    (a.CHAMBER_CHANGE, a.CHAMBER_KEPT, _CHAMBER_FILLED),
    (a.JOINT_CHANGE, a.JOINT_KEPT, _JOINT_FILLED),
)
"""Changes of the inputs, changes of the past of all parameters, and number of changes before those of the past."""


@njit
def follow(
    core: Core, commands: FloatArray, changes: FloatArray, out: FloatArray, dt: float, bdf2: bool, begun: bool
) -> tuple[int, int]:
    """Take K steps with sensitivities. Return the number of finished steps and the status of the last step.

    Parameters
    ----------
    commands : ndarray, shape (K, 5 N)
        Commands to the actuators at the ends of the steps, in the order of the array "asked".
    changes : ndarray, shape (K, P, 5 N)
        Derivatives of the commands.
    out : ndarray, shape (K + 1, 1 + P, 3 (N+1) + 3 + 2 N)
        Overwritten from row 0 (the present state) on: x, y, z of all joints, of the centre of mass, and the lengths of
        the left and right chambers [m]; first their values, then their derivatives.
    dt : float
        Time step [s].
    bdf2 : bool
        Whether the integrator is BDF2.
    begun : bool
        Whether the past contains a step of the same length, so that the first step can use BDF2.
    """
    asked, given = vector(core.block, a.ACTUATOR_COMMANDS), vector(core.block, a.GIVEN)
    count = changes.shape[1]
    _write(core, out[0])
    for k in range(len(commands)):
        reset(core)
        asked_n, given_n = asked.copy(), given.copy()
        actuate(core, commands[k], dt)
        second_order, end, span = bdf2 and (begun or k > 0), NOT_FINITE, dt
        if actuators_start_finite(core):
            end, span = solve_step(core, dt, second_order)
        if end != OK:
            copy(asked, asked_n)
            copy(given, given_n)
            return k, end
        _factorise(core)
        for p in range(count):
            _sense(core, p, changes[k, p])
            if second_order and span == dt:  # as `commit` does after a strike
                _forget_velocities(core, p)
        _restore(core)
        commit(core, dt, second_order, span)
        _write(core, out[k + 1])
    return len(commands), OK


@inner
def _factorise(core: Core) -> None:
    """Factorise the exact Jacobian at the solution."""
    p = matrix(core.block, a.POINT_IN)
    for k in range(p.shape[1]):
        p[_REGIME, k] = point.FREE if p[_LOAD_N, k] > 0.0 else point.OPEN
    evaluate(core, a.X, True, WHOLE_HESSIAN)
    _differentiate_normals(core)
    copy(vector(core.block, a.CHANGED), p[_LOAD_N])
    exchange(core)
    fill(vector(core.block, a.CHANGED), 0.0)
    hold(core, True)
    lu_factor(matrix(core.block, a.BANDED_JACOBIAN), matrix(core.block, a.FACTOR))


@inner
def _differentiate_normals(core: Core) -> None:
    """Set the curvature of the world at each point to the exact one, by differences of the normals.

    The curvature that a world gives may lack the parts that would make Newton's matrix indefinite.
    """
    p, given, out = matrix(core.block, a.POINT_IN), matrix(core.block, a.WORLD_IN), matrix(core.block, a.POINT_ANEW)
    size, lanes = NORMAL_DIFFERENCE * vector(core.block, a.NUMBERS_)[a.L0], p.shape[1]
    fill(rows(core.block, a.POINT_IN, _CURVATURE, 6), 0.0)
    for axis in range(3):
        first = _CURVATURE + (0, 3, 5)[axis]
        for sign in (1.0, -1.0):
            for k in range(lanes):
                given[axis, k] = p[axis, k] + sign * size
            evaluate_kernel(kernel(core, a.WORLD), given, out[:WORLD_ROWS], lanes)
            for d in range(axis, 3):
                combine(p[first + d - axis], 1.0, p[first + d - axis], sign / (2.0 * size), out[1 + d])
        copy(given[axis], p[axis])


@inner
def _restore(core: Core) -> None:
    """Restore what `commit` and the next step expect."""
    fill(rows(core.block, a.POINT_IN, _REGIME, 1), point.FREE)
    angles = matrix(core.block, a.JOINT_OUT)[:_ANGLES]
    evaluate_kernel(kernel(core, a.JOINT_LEDGER), matrix(core.block, a.JOINT_IN), angles, core.n - 1)


@inner
def _view(at: int, first: int, count: int) -> FloatArray:
    """Return the numbers at an address as a matrix."""
    found: FloatArray = carray(doubles_at(at), (first, count))
    return found


@inner
def _sense(core: Core, p: int, command: FloatArray) -> None:
    """Compute the changes of the solution and of the next past for parameter p."""
    block, n = core.block, core.n
    _fill(core, p, command)
    chambers, points = matrix(block, a.CHAMBER_SENSED), matrix(block, a.POINT_SENSED)
    x = _view(address(block, a.POINT_CHANGE, 0), 3 * POINTS_PER_SEGMENT, chambers.shape[1])
    f = _view(address(block, a.CHAMBER_CHANGE, _F), 3, points.shape[1])
    _turn_faces(core)
    evaluate_kernel(kernel(core, a.CHAMBER_POINTS), chambers, x, n)
    evaluate_kernel(kernel(core, a.POINT_RESIDUAL), points, f, points.shape[1])
    _solve(core)
    evaluate_kernel(kernel(core, a.CHAMBER_POINTS), chambers, x, n)
    _next(core, a.POINT_NEXT, a.POINT_SENSED, 0, p, points.shape[1])
    _next(core, a.NODE_NEXT, a.NODE_SENSED, 1, p, n + 1)
    _next(core, a.CHAMBER_NEXT, a.CHAMBER_SENSED, 2, p, n)
    _next(core, a.JOINT_NEXT, a.JOINT_SENSED, 3, p, n - 1)


@inner
def _next(core: Core, which: int, sensed: int, part: int, p: int, count: int) -> None:
    """Run the kernel of the changes of the next past."""
    changes, kept, filled = _PARTS[part]
    size = matrix(core.block, changes).shape[0] - filled
    out = matrix(core.block, kept)[p * size : (p + 1) * size]
    evaluate_kernel(kernel(core, which), matrix(core.block, sensed), out, count)


@inner
def _fill(core: Core, p: int, command: FloatArray) -> None:
    """Fill the changes of all inputs that are known before the solution: of the past and of the commands."""
    block, n = core.block, core.n
    for changes, kept, filled in _PARTS:
        size, lanes = matrix(block, changes).shape[0] - filled, matrix(block, changes).shape[1]
        vectors.move(address(block, changes, filled), address(block, kept, p * size), size * lanes)
    chambers, joints = matrix(block, a.CHAMBER_CHANGE), matrix(block, a.JOINT_CHANGE)
    lanes, past = chambers.shape[1], _CHAMBER_FILLED
    fill(rows(block, a.CHAMBER_CHANGE, _Q, segment.COORDINATES), 0.0)
    for i in range(n):
        for side in range(2):
            chambers[_COMMAND + side, i] = command[2 * i + side]
            chambers[_FORCE + side, i] = command[2 * n + 2 * i + side]
    for i in range(n - 1):
        joints[_J_COMMAND, i] = command[4 * n + i + 1]
    for row in range(6):  # tangent and director follow each other in both arrays
        for i in range(0, lanes, vectors.VECTOR_WIDTH):
            to = address(block, a.POINT_CHANGE, _TANGENT + row)
            vectors.repeat_8(to + 8 * i, lanes, address(block, a.CHAMBER_CHANGE, past + row) + 8 * i)
    for k in range(2):
        for d in range(3):
            for to, row in ((_J_T, 0), (_J_D, 3)):
                here = address(block, a.CHAMBER_CHANGE, past + row + d) + 8 * k
                vectors.move(address(block, a.JOINT_CHANGE, to + 3 * k + d), here, n - 1)
            normal = address(block, a.POINT_CHANGE, _POINT_FILLED + _NORMAL_N + d) + 8 * (FACES + k) * lanes
            vectors.move(address(block, a.CHAMBER_CHANGE, _NORMAL + 3 * k + d), normal, n)
            end = address(block, a.NODE_CHANGE, _NODE_FILLED + d) + 8 * k
            vectors.move(address(block, a.CHAMBER_CHANGE, _ENDS + 3 * k + d), end, n)


@inner
def _turn_faces(core: Core) -> None:
    """Shift the changes of past and anchor of the end faces to the points that the step has chosen on the rims."""
    block, n = core.block, core.n
    segments, points = matrix(block, a.SEGMENT_IN), matrix(block, a.POINT_CHANGE)
    lanes, out = segments.shape[1], matrix(block, a.SEGMENT_OUT)[:6]
    if segments[_RADIUS, 0] == 0.0 and segments[_RADIUS + 1, n - 1] == 0.0:
        return
    evaluate_kernel(kernel(core, a.CHAMBER_FACES), matrix(block, a.CHAMBER_SENSED), out, n)
    for face in range(2):
        i = 0 if face == 0 else n - 1
        k = (FACES + face) * lanes + i
        for d in range(3):
            turned = out[3 * face + d, i] - points[_POINT_FILLED + d, k]
            for row in (_PAST, _PAST + 3, _ANCHOR):
                points[_POINT_FILLED + row + d, k] += turned


@inner
def _solve(core: Core) -> None:
    """Solve (FS1), and fill the changes of the coordinates."""
    block, n, moved = core.block, core.n, vector(core.block, a.STEP_CHANGE)
    chambers, joints = matrix(block, a.SEGMENT_OUT)[: segment.COORDINATES], matrix(block, a.JOINT_OUT)[: joint.ROW]
    nodes, changes = matrix(block, a.MOMENTA_OUT)[:3], matrix(block, a.NODE_CHANGE)
    evaluate_kernel(kernel(core, a.CHAMBER_RESIDUAL), matrix(block, a.CHAMBER_SENSED), chambers, n)
    evaluate_kernel(kernel(core, a.JOINT_RESIDUAL), matrix(block, a.JOINT_SENSED), joints, n - 1)
    evaluate_kernel(kernel(core, a.NODE_RESIDUAL), matrix(block, a.NODE_SENSED), nodes, n + 1)
    right, held = vector(block, a.DIRECTION), vector(block, a.HELD)
    fill(right, 0.0)
    for out, count, size in ((nodes, n + 1, 3), (chambers, n, segment.COORDINATES), (joints, n - 1, joint.COORDINATES)):
        for r in range(size):
            for i in range(count):
                right[BLOCK_SIZE * i + r] += out[r, i]
    for k in range(len(right)):
        right[k] = 0.0 if held[k] != 0.0 else right[k]
    lu_solve(matrix(block, a.FACTOR), right)
    combine(moved[: len(right)], -1.0, right, 0.0, right)
    to_segments(core, matrix(block, a.ACTUATED).shape[0] + _Q, address(block, a.STEP_CHANGE, 0))
    to_joints(core, matrix(block, a.HINGED).shape[0] + _J_Q, address(block, a.STEP_CHANGE, 0))
    for j in range(n + 1):
        for d in range(3):
            changes[d, j] = moved[BLOCK_SIZE * j + d]


@inner
def _forget_velocities(core: Core, p: int) -> None:
    """Set the changes of both past velocities to the changes of the new velocity, as `commit` does after a strike."""
    for changes, kept, filled in _PARTS[:2]:
        first = p * (matrix(core.block, changes).shape[0] - filled) + _VELOCITY
        copy(rows(core.block, kept, first + 3, 3), rows(core.block, kept, first, 3))


@inner
def _write(core: Core, out: FloatArray) -> None:
    """Write the present state and its changes, as in `follow`."""
    block = core.block
    _write_row(core, out[0], a.JOINTS, 0, a.POINTS_PAST, 0, a.LENGTHS, 0)
    size = [matrix(block, changes).shape[0] - filled for changes, _, filled in _PARTS]
    for p in range(out.shape[0] - 1):
        chamber = p * size[2] + _LENGTHS
        _write_row(core, out[1 + p], a.NODE_KEPT, p * size[1], a.POINT_KEPT, p * size[0], a.CHAMBER_KEPT, chamber)


@inner
def _write_row(
    core: Core, out: FloatArray, nodes: int, node: int, points: int, point_row: int, chambers: int, chamber: int
) -> None:
    block, n, com = core.block, core.n, 3 * (core.n + 1)
    joints, lengths = matrix(block, nodes), matrix(block, chambers)
    for d in range(3):
        for j in range(n + 1):
            out[3 * j + d] = joints[node + d, j]
        total = dot(vector(block, a.JOINT_MASS), rows(block, nodes, node + d, 1))
        total += dot(vector(block, a.POINT_MASS), rows(block, points, point_row + d, 1))
        out[com + d] = total / vector(block, a.NUMBERS_)[a.MASS]
    for i in range(n):
        for side in range(2):
            out[com + 3 + 2 * i + side] = lengths[chamber + side, i]
