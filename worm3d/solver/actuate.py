"""Commands of the actuators at the start of a step, compiled."""

from __future__ import annotations

from worm3d.machine.compiled import inner, njit
from worm3d.physics.kernels import actuator, joint, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import Core
from worm3d.solver.block import copy, fill, matrix, vector
from worm3d.solver.block import rows as fields
from worm3d.solver.entry import run
from worm3d.values.arrays import FloatArray

_COMMANDED, _FORCE, _DT, _LENGTH_N = segment.SEGMENT_LAYOUT.firsts("commanded", "force", "dt", "length_n")
_HINGE, _JOINT_DT = joint.JOINT_LAYOUT.firsts("hinge", "dt")
_COMMAND, _COMMAND_N, _GIVEN_N, _FORCE_COMMAND, _FORCE_COMMAND_N, _FORCE_N = actuator.CHAMBER_COMMANDS
_HINGE_COMMAND, _HINGE_COMMAND_N, _HINGE_GIVEN_N = actuator.HINGE_COMMANDS[:3]


@njit
def ask(core: Core, command: FloatArray) -> None:
    """Limit a command as the actuators do, and store it as the command at the start of the next step."""
    given = vector(core.block, a.GIVEN).copy()
    actuate(core, command, 1.0)
    copy(vector(core.block, a.GIVEN), given)


@inner
def actuate(core: Core, command: FloatArray, dt: float) -> None:
    """Start the actuators' step towards a command. Their outputs may change again at the end of the step."""
    block, n = core.block, core.n
    asked, given = vector(block, a.ACTUATOR_COMMANDS), vector(block, a.GIVEN)
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
    run(core, a.ACTUATOR_START, a.ACTUATED, a.STARTED_ACTUATORS, n)
    run(core, a.HINGE_START, a.HINGED, a.HINGE_OUT, n - 1)
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
