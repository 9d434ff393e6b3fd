"""Many steps at once, compiled: actuators, steps, records."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.machine.compiled import inner, njit
from worm3d.physics.kernels import joint, segment
from worm3d.solver import arrays as a
from worm3d.solver.arrays import BLOCK, Core
from worm3d.solver.block import Block, copy, integers, matrix, vector
from worm3d.solver.entry import reset
from worm3d.solver.guard import OK
from worm3d.solver.records import record
from worm3d.solver.step import step
from worm3d.values.arrays import FloatArray

_COMMANDED, _FORCE = segment.LAYOUT.firsts("commanded", "force")
_HINGE = joint.LAYOUT.first("hinge")


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
        end = step(core, dt, bdf2 and (remembers or k > 0))
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


@inner
def actuate(core: Core, command: FloatArray, dt: float) -> None:
    """First-order lag, exact for a command that changes linearly over the step; stroke and rate limits."""
    numbers, n = vector(core.block, a.NUMBERS_), core.n
    asked, given = vector(core.block, a.ASKED), vector(core.block, a.GIVEN)
    lag, most = numbers[a.LAG], numbers[a.RATE_LIMIT] * dt
    decay = np.exp(-dt / lag) if lag > 0.0 else 0.0
    for k in range(5 * n):
        target, contracts = command[k], k < 2 * n
        if contracts:
            target = min(max(target, numbers[a.LEAST]), numbers[a.GREATEST])
        new = target
        if lag > 0.0:
            ramp = lag * (target - asked[k]) / dt
            new = target - ramp + (given[k] - asked[k] + ramp) * decay
        if contracts:
            new = min(max(new, given[k] - most), given[k] + most)
        asked[k], given[k] = target, new
    rows, joints = matrix(core.block, a.SEGMENT_IN), matrix(core.block, a.JOINT_IN)
    for i in range(n):
        for side in range(2):
            rows[_COMMANDED + side, i] = numbers[a.L0] * (1.0 - given[2 * i + side])
            rows[_FORCE + side, i] = given[2 * n + 2 * i + side]
    for i in range(n - 1):
        joints[_HINGE, i] = given[4 * n + i + 1]


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
