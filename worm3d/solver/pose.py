"""Poses, compiled: a worm is placed with its past, and settles on its world."""

from __future__ import annotations

import numpy as np

from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner, njit
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.physics.kernels import GREATEST_CONTRACTION, actuator, joint, point, segment
from worm3d.solver import arrays as a
from worm3d.solver.actuate import actuate
from worm3d.solver.arrays import Core
from worm3d.solver.block import address, copy, fill, matrix, rows, vector
from worm3d.solver.entry import call, kernel, opened, run
from worm3d.solver.evaluate import find_distances, place, to_segments
from worm3d.solver.faces import turn_faces
from worm3d.solver.guard import NOT_FINITE, OK, actuators_start_finite
from worm3d.solver.step import step, straighten
from worm3d.values.arrays import FloatArray

_T_REF, _D_REF, _RIM, _Q, _DQ = segment.SEGMENT_LAYOUT.firsts("t_ref", "d_ref", "rim", "q", "dq")
_COMMANDED, _COMMANDED_N = segment.SEGMENT_LAYOUT.firsts("commanded", "commanded_n")
_J_Q, _J_T, _J_D, _HINGE = joint.JOINT_LAYOUT.firsts("q", "t_ref", "d_ref", "hinge")
_X, _ANCHOR, _LOAD_N, _PULL, _FIRST = point.POINT_LAYOUT.firsts("x", "anchor", "load_n", "pull", "first")
_COMMAND = actuator.CHAMBER_COMMANDS[0]
_TERMS = len(segment.LEDGER_TERMS)
_HISTORIES = np.array([list(a.ARRAYS).index(name) for name, row in a.ARRAYS.items() if row.history])
PLACINGS = 3
"""Number of iterations for the contact points of the faces, which depend on the world's normal at these points."""


def put_entry(handle: int, _value: float, stops: int, _b: int) -> float:
    """Put the worm at x, with the actuators at rest at the commanded contraction. An entry (`worm3d.solver.entry`).

    The directors are in the inputs of the segments, and the rates of the coordinates are in "trial". There is no stored
    friction, and the past equals the present. If `stops` is not 0, the worm keeps its present pose and is at rest. The
    anchors move to the points, and the loads are kept.
    """
    core = opened(handle)
    if stops == 0:
        _put(core, vector(core.block, a.TRIAL))
    else:
        load = rows(core.block, a.POINT_IN, _LOAD_N, 1)
        copy(vector(core.block, a.Y_START)[: load.size], load)
        _stop(core)
        copy(load, vector(core.block, a.Y_START)[: load.size])
    return 0.0


@inner
def _put(core: Core, rate: FloatArray) -> None:
    block, n = core.block, core.n
    for i in range(n):
        _orient(core, i)
    fill(rows(block, a.SEGMENT_IN, _RIM, 4), 0.0)
    to_segments(core, _Q, address(block, a.X, 0))
    _rest_actuators(core)  # the points may depend on the commanded rest lengths, which may depend on q
    for _ in range(PLACINGS):
        _place(core)
        turn_faces(core)
    _place(core)
    _set_rates(core, rate)
    run(core, a.SEGMENT_LEDGER, a.FORMED, a.SEGMENT_LEDGER_, n)
    evaluate_kernel(kernel(core, a.JOINT_ANGLES), matrix(block, a.JOINT_IN), matrix(block, a.JOINT_OUT)[:4], n - 1)
    copy(rows(block, a.POINTS_PAST, 0, 3), rows(block, a.POINT_IN, _X, 3))
    copy(rows(block, a.POINT_VELOCITY, 0, 3), rows(block, a.POINT_IN, _FIRST, 3))
    copy(rows(block, a.LENGTHS, 0, 2), rows(block, a.SEGMENT_SHAPE_OUT, 0, 2))
    copy(rows(block, a.HINGES, 0, 2), rows(block, a.SEGMENT_LEDGER_, _TERMS, 2))
    copy(rows(block, a.JOINT_ANGLES_PAST, 0, 4), rows(block, a.JOINT_OUT, 0, 4))
    for k in _HISTORIES:
        history = vector(block, k)
        copy(history[history.size // 2 :], history[: history.size // 2])
    copy(rows(block, a.POINT_IN, _ANCHOR, 3), rows(block, a.POINT_IN, _X, 3))
    fill(rows(block, a.POINT_IN, _LOAD_N, 1), 0.0)
    fill(rows(block, a.POINT_IN, _PULL, 2), 0.0)
    fill(vector(block, a.STUCK), 1.0)
    for k in (a.ANCHOR_ENERGY, a.JOINT_LOAD, a.LAST, a.CURVE):
        fill(vector(block, k), 0.0)


@inner
def _orient(core: Core, i: int) -> None:
    """Set the tangent of segment i, set its roll to 0, and make its director a unit vector normal to the tangent."""
    x, segments = vector(core.block, a.X), matrix(core.block, a.SEGMENT_IN)
    x[BLOCK_SIZE * i + 3] = 0.0
    square = 0.0
    for d in range(3):
        segments[_T_REF + d, i] = x[BLOCK_SIZE * (i + 1) + d] - x[BLOCK_SIZE * i + d]
        square += segments[_T_REF + d, i] ** 2
    for d in range(3):
        segments[_T_REF + d, i] /= np.sqrt(square)
    straighten(core, i)


@inner
def _set_rates(core: Core, rate: FloatArray) -> None:
    """Set the positions and velocities of the joints, and the rates of all coordinates (0 if held)."""
    block, x, held = core.block, vector(core.block, a.X), vector(core.block, a.HELD)
    joints, velocity = matrix(block, a.JOINTS), matrix(block, a.JOINT_VELOCITY)
    segments = matrix(block, a.SEGMENT_IN)
    for j in range(core.n + 1):
        for d in range(BLOCK_SIZE):
            if held[BLOCK_SIZE * j + d] != 0.0:
                rate[BLOCK_SIZE * j + d] = 0.0
        for d in range(3):
            joints[d, j], velocity[d, j] = x[BLOCK_SIZE * j + d], rate[BLOCK_SIZE * j + d]
    for r in range(segment.COORDINATES):
        for i in range(core.n):
            segments[_DQ + r, i] = rate[BLOCK_SIZE * i + r]


@inner
def _place(core: Core) -> None:
    """Compute points, angles and distances at x."""
    block, x = core.block, vector(core.block, a.X)
    segments, joints = matrix(block, a.SEGMENT_IN), matrix(block, a.JOINT_IN)
    for i in range(core.n - 1):
        for r in range(joint.COORDINATES):
            joints[_J_Q + r, i] = x[BLOCK_SIZE * i + r]
        for d in range(3):
            joints[_J_T + d, i], joints[_J_T + 3 + d, i] = segments[_T_REF + d, i], segments[_T_REF + d, i + 1]
            joints[_J_D + d, i], joints[_J_D + 3 + d, i] = segments[_D_REF + d, i], segments[_D_REF + d, i + 1]
    if not place(core, x):  # compute distances also for a shape that no step accepts
        find_distances(core)


@inner
def _rest_actuators(core: Core) -> None:
    """Put the actuators at rest at the commanded contraction, with no forces and with hinge commands of 0."""
    block, n = core.block, core.n
    asked, segments = vector(block, a.ACTUATOR_COMMANDS), matrix(block, a.SEGMENT_IN)
    given, actuated, out = asked[: 2 * n], matrix(block, a.ACTUATED), matrix(block, a.ACTUATOR_OUT)
    fill(asked[2 * n :], 0.0)
    copy(vector(block, a.GIVEN), asked)
    fill(rows(block, a.JOINT_IN, _HINGE, 2), 0.0)
    fill(vector(block, a.HINGE_PAST), 0.0)
    own = kernel(core, a.ACTUATOR_REST)
    for i in range(n):
        for side in range(2):
            segments[_COMMANDED + side, i] = vector(block, a.NUMBERS_)[a.L0] * (1.0 - given[2 * i + side])
            if own != 0:
                actuated[_COMMAND + side, i] = given[2 * i + side]
    if own != 0:
        past = vector(block, a.ACTUATOR_PAST)
        states = past.size // (2 * out.shape[1])
        evaluate_kernel(own, actuated, out[: 2 + states], n)
        for i in range(n):
            segments[_COMMANDED, i], segments[_COMMANDED + 1, i] = out[0, i], out[1, i]
        copy(past[: past.size // 2], rows(block, a.ACTUATOR_OUT, 2, states))
    copy(rows(block, a.SEGMENT_IN, _COMMANDED_N, 2), rows(block, a.SEGMENT_IN, _COMMANDED, 2))


@inner
def _stop(core: Core) -> None:
    block, x, joints = core.block, vector(core.block, a.X), matrix(core.block, a.JOINTS)
    asked, given = vector(block, a.ACTUATOR_COMMANDS), vector(block, a.GIVEN)
    for j in range(core.n + 1):
        for d in range(3):
            x[BLOCK_SIZE * j + d] = joints[d, j]
    for k in range(2 * core.n):
        asked[k] = min(given[k], GREATEST_CONTRACTION)
    fill(vector(block, a.TRIAL), 0.0)
    _put(core, vector(block, a.TRIAL))


@njit
def settle(
    core: Core, command: FloatArray, dt: float, most: int, slides: bool, rest: float, far: float
) -> tuple[int, float, float]:
    """Take steps of implicit Euler until the worm rests. Return the status of the last step, and two motions.

    The motions are the largest motion of a joint in the last step and since the start, along any axis [m]. They are
    infinite if no step succeeded.

    Parameters
    ----------
    command : ndarray, shape (5 N,)
        Commands in the order of the array "asked".
    dt : float
        Time step [s].
    most : int
        Maximum number of steps.
    slides : bool
        Whether the worm slides without friction. Velocities are then set to zero after each step.
    rest : float
        Motion in a step below which the worm rests [m].
    far : float
        Motion since the start above which nothing holds the worm, so that settling ends [m].
    """
    joints = rows(core.block, a.JOINTS, 0, 3)
    start, before, moved, away = joints.copy(), joints.copy(), np.inf, np.inf
    for _ in range(most):
        copy(before, joints)
        actuate(core, command, dt)
        end = step(core, dt, False) if actuators_start_finite(core) else NOT_FINITE
        if end != OK:
            return end, moved, away
        moved, away = _way(joints, before), _way(joints, start)
        if slides:
            call(kernel(core, a.PUT), core.handle, 0.0, 1, 0)
        if moved < rest or away > far:
            break
    return OK, moved, away


@inner
def _way(x: FloatArray, y: FloatArray) -> float:
    """Return the largest absolute difference between the entries of two vectors."""
    found = 0.0
    for k in range(len(x)):
        found = max(found, abs(x[k] - y[k]))
    return found
