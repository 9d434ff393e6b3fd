"""Many steps at once, compiled: the commands of the actuators, the steps, and their records."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.machine.codegen import evaluate as evaluate_kernel
from worm3d.machine.compiled import inner, njit
from worm3d.physics.kernels import actuator, joint, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import BLOCK, Core
from worm3d.solver.block import Block, copy, fill, integers, matrix, vector
from worm3d.solver.block import rows as fields
from worm3d.solver.entry import kernel, reset
from worm3d.solver.guard import NOT_FINITE, OK, actuators_start_finite
from worm3d.solver.records import record
from worm3d.solver.step import step
from worm3d.values.arrays import FloatArray

_COMMANDED, _FORCE, _DT, _LENGTH_N = segment.LAYOUT.firsts("commanded", "force", "dt", "length_n")
_HINGE, _JOINT_DT = joint.LAYOUT.firsts("hinge", "dt")
_COMMAND, _COMMAND_N, _GIVEN_N, _FORCE_COMMAND, _FORCE_COMMAND_N, _FORCE_N = actuator.CHAMBER_COMMANDS
_HINGE_COMMAND, _HINGE_COMMAND_N, _HINGE_GIVEN_N = actuator.HINGE_COMMANDS[:3]


@njit
def advance(
    core: Core,
    records: Block,
    counters: NDArray[np.int64],
    commands: FloatArray,
    external: FloatArray,
    first: int,
    every: int,
    dt: float,
    bdf2: bool,
    remembers: bool,
) -> tuple[int, int]:
    """Take a step for every row of commands; return how many were finished, and how the last ended.

    Parameters
    ----------
    records : Block
        Of `worm3d.solver.records`; a row is filled after every `every`-th step.
    counters : ndarray of int, shape (S, 4)
        A row is filled after every step.
    commands : ndarray, shape (K, 5 N)
        Asked of the actuators at the end of each step, as the array "asked".
    external : ndarray, shape (K, 3, N+1) or (0, 3, N+1)
        Forces on the joints at the end of each step [N].
    first : int
        Number of steps before the chunk.
    every : int
        0 records nothing, not even counters: the steps are parts of one.
    dt : float
        [s]
    bdf2 : bool
        Whether the integrator is BDF2.
    remembers : bool
        Whether the past holds two instants dt apart.
    """
    asked, given = vector(core.block, a.ASKED), vector(core.block, a.GIVEN)
    for k in range(len(commands)):
        asked_n, given_n = asked.copy(), given.copy()
        actuate(core, commands[k], dt)
        if len(external) > 0:
            for d in range(3):
                copy(matrix(core.block, a.EXTERNAL)[d], external[k, d])
        if every > 0:
            reset(core)
        end = step(core, dt, bdf2 and (remembers or k > 0)) if actuators_start_finite(core) else NOT_FINITE
        if end != OK:
            copy(asked, asked_n)
            copy(given, given_n)
            return k, end
        if every > 0:
            done = first + k + 1
            for c in range(a.COUNTERS):
                counters[done - 1, c] = integers(core.counters, a.COUNTERS)[c]
            if done % every == 0:
                record(core, records, done // every)
    return len(commands), OK


@njit
def ask(core: Core, command: FloatArray) -> None:
    """Take a command, within the actuators' limits, as that from which their next step begins."""
    given = vector(core.block, a.GIVEN).copy()
    actuate(core, command, 1.0)
    copy(vector(core.block, a.GIVEN), given)


@inner
def actuate(core: Core, command: FloatArray, dt: float) -> None:
    """Start the actuators' step towards a command; what they give is theirs to change again at its end."""
    block, n = core.block, core.n
    asked, given = vector(block, a.ASKED), vector(block, a.GIVEN)
    rows, joints = matrix(block, a.ACTUATED), matrix(block, a.HINGED)
    for i in range(n):
        for side in range(2):
            k = 2 * i + side
            rows[_COMMAND + side, i], rows[_COMMAND_N + side, i] = command[k], asked[k]
            rows[_FORCE_COMMAND + side, i], rows[_FORCE_COMMAND_N + side, i] = command[2 * n + k], asked[2 * n + k]
            rows[_GIVEN_N + side, i], rows[_FORCE_N + side, i] = given[k], given[2 * n + k]
    for i in range(n - 1):
        k = 4 * n + i + 1
        joints[_HINGE_COMMAND, i], joints[_HINGE_COMMAND_N, i] = command[k], asked[k]
        joints[_HINGE_GIVEN_N, i] = given[k]
    fill(fields(block, a.SEGMENT_IN, _DT, 1), dt)
    fill(fields(block, a.JOINT_IN, _JOINT_DT, 1), dt)
    copy(fields(block, a.SEGMENT_IN, _LENGTH_N, 2), fields(block, a.LENGTHS, 0, 2))
    chambers, hinges = matrix(block, a.STARTED_ACTUATORS), matrix(block, a.HINGE_OUT)
    evaluate_kernel(kernel(core, a.ACTUATOR_START), rows, chambers, n)
    evaluate_kernel(kernel(core, a.HINGE_START), joints, hinges, n - 1)
    for i in range(n):
        for side in range(2):
            k = 2 * i + side
            asked[k], asked[2 * n + k] = chambers[side, i], command[2 * n + k]
            rows[_COMMANDED + side, i], rows[_FORCE + side, i] = chambers[2 + side, i], chambers[4 + side, i]
            given[k], given[2 * n + k] = chambers[6 + side, i], chambers[4 + side, i]
    asked[4 * n], given[4 * n] = command[4 * n], command[4 * n]
    for i in range(n - 1):
        k = 4 * n + i + 1
        asked[k], given[k], joints[_HINGE, i] = hinges[0, i], hinges[1, i], hinges[1, i]


@njit
def worst_residual(core: Core) -> tuple[float, int]:
    """Return the norm of the last residual [N] and the joint with its largest entry."""
    gradient, held = vector(core.block, a.GRADIENT), vector(core.block, a.HELD)
    total, worst, most = 0.0, 0, -1.0
    for k in range(len(gradient)):
        if held[k] == 0.0:
            total += gradient[k] ** 2
            if not abs(gradient[k]) <= most:
                worst, most = k, abs(gradient[k])
    return np.sqrt(total), worst // BLOCK
