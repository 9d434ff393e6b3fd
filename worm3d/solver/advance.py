"""Compiled loop over many steps: the commands of the actuators, the steps, and their records.

Time is counted in ticks of equal length. In a run with steps of equal length, a step is a tick. In a run with adaptive
steps, a limit of the error determines the length of each step. The error of a step is the distance from the parabola
through the last three positions (`worm3d.solver.step`). A step with too large an error is repeated with a shorter
length. The error grows with the third power of the length; thus the error of the last step determines the length of the
next step.

Several ticks are a beat. A step always ends at the end of a beat, where a run can be observed, controlled and split
into parts. Commands and forces are defined at equal intervals, and change linearly in between. If steps are adaptive,
rows are interpolated between the ends of steps (`worm3d.solver.between`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.machine.compiled import inner, njit
from worm3d.machine.vectors import BLOCK_SIZE
from worm3d.solver import arrays as a
from worm3d.solver import between
from worm3d.solver.actuate import actuate
from worm3d.solver.arrays import Core
from worm3d.solver.block import Block, combine, copy, integers, matrix, vector
from worm3d.solver.entry import reset
from worm3d.solver.guard import NO_CONVERGENCE, NOT_FINITE, OK, TOO_COARSE, actuators_start_finite
from worm3d.solver.records import BEFORE
from worm3d.solver.step import step
from worm3d.values.arrays import FloatArray

LAST, NEXT, SINCE, SOLVES = range(4)
"""Indices in the array `pace`, which describes the steps of a run. The array contains the length of the last step, 0
before the first step [s]; the length of the next step to try, infinite if a step is a tick [s]; the time since the last
whole beat or tick [s]; and the number of solved steps, including repeated steps."""
MIN_STEP, MAX_STEP = 1e-5, 2e-2
"""Shortest and longest step [s]. At the shortest step the error is not checked, but Newton's method has to converge.
Longer steps than the longest would miss details of a gait."""
GIVEN_UP = 64.0
"""Largest factor by which a step may be shorter than the shortest step if Newton's method does not converge."""
GROWTH, SHRINKING, SAFETY = 2.0, 0.2, 0.9
"""Largest and smallest ratio of a step to the previous step, and the ratio of the chosen length to the length predicted
from the error. BDF2 is stable if steps grow by less than a factor of 1 + sqrt(2)."""


@njit
def advance(
    core: Core,
    records: Block,
    counters: NDArray[np.int64],
    commands: FloatArray,
    external: FloatArray,
    done: int,
    every: int,
    dt: float,
    bdf2: bool,
    pace: FloatArray,
    beats: tuple[int, int, int],
) -> tuple[int, int]:
    """Advance by one tick per `parts` commands. Return the number of finished ticks and the status of the last step.

    Parameters
    ----------
    records : Block
        Block of `worm3d.solver.records`; a row is filled after every `every`-th tick.
    counters : ndarray of int, shape (S, 4)
        The counters of all steps that end in a tick are added to the row of this tick.
    commands : ndarray, shape (K parts, 5 N)
        Commands to the actuators, `parts` per tick, in the order of the array "asked".
    external : ndarray, shape (K parts + 1, 3, N+1) or (0, 3, N+1)
        Forces on the joints, starting at the present instant [N].
    done : int
        Number of ticks before this call.
    every : int
        Number of ticks per recorded row.
    dt : float
        Length of a tick [s].
    bdf2 : bool
        Whether the integrator is BDF2.
    pace : ndarray, shape (4,)
        Numbers at `LAST`, `NEXT`, `SINCE` and `SOLVES`; changed by this function.
    beats : tuple of int
        Number `parts` of commands per tick, number of ticks per beat, and ticks since the last whole beat.
    """
    parts, beat, begin = beats
    taken, count, asked = 0, len(commands) // parts, vector(core.block, a.ACTUATOR_COMMANDS)
    adapts, first, command = pace[NEXT] < np.inf, asked.copy(), asked.copy()
    while taken < count:
        ticks = min(beat - (begin + taken) % beat, count - taken)
        span, at, reached = ticks * dt, 0.0, 0
        copy(first, asked)
        while reached < ticks:
            h = _length(pace[NEXT], span - at)
            after = span if h == span - at else at + h
            cell = min(int(after / dt * parts), ticks * parts - 1)
            share, row = after / dt * parts - cell, taken * parts + cell
            _between(command, first if cell == 0 else commands[row - 1], share, commands[row])
            if len(external) > 0:
                for d in range(3):
                    force = matrix(core.block, a.EXTERNAL)[d]
                    _between(force[: external.shape[2]], external[row, d], share, external[row + 1, d])
            reset(core)
            pace[SOLVES] += 1.0
            between.keep(records, BEFORE)
            end = _adapted(core, command, h, pace) if adapts else _take(core, command, h, bdf2 and pace[LAST] > 0.0)
            for c in range(a.COUNTERS):
                counters[done + taken + reached, c] += integers(core.counters, a.COUNTERS)[c]
            if adapts and (end == TOO_COARSE or (end == NO_CONVERGENCE and pace[NEXT] > MIN_STEP / GIVEN_UP)):
                continue
            pace[SINCE] = at
            if end != OK:
                return taken + reached, end
            pace[LAST] = h
            while reached < ticks and (reached + 1) * dt <= after * (1.0 + 1e-12):
                reached += 1
                k = done + taken + reached
                if k % every == 0:
                    between.write(core, records, k // every, (reached * dt - at) / h, h)
            at = after
        taken += ticks
        pace[SINCE] = 0.0
    return taken, OK


@inner
def _between(to: FloatArray, before: FloatArray, share: float, after: FloatArray) -> None:
    """Interpolate linearly between `before` and `after`; `share` is the elapsed fraction of the time between them."""
    if share == 1.0:
        copy(to, after)
    else:
        combine(to, 1.0 - share, before, share, after)


@inner
def _length(wanted: float, left: float) -> float:
    """Return the length of the next step. No step at the end of a beat becomes much shorter than `wanted`."""
    if wanted >= left * (1.0 - 1e-9):
        return left
    return 0.5 * left if 2.0 * wanted > left else wanted


@inner
def _take(core: Core, command: FloatArray, h: float, bdf2: bool) -> int:
    """Take a step and return its status. A failed step leaves the actuators unchanged."""
    asked, given = vector(core.block, a.ACTUATOR_COMMANDS), vector(core.block, a.GIVEN)
    asked_n, given_n = asked.copy(), given.copy()
    actuate(core, command, h)
    end = step(core, h, bdf2) if actuators_start_finite(core) else NOT_FINITE
    if end != OK:
        copy(asked, asked_n)
        copy(given, given_n)
    return int(end)


@inner
def _adapted(core: Core, command: FloatArray, h: float, pace: FloatArray) -> int:
    """Try a step, store the length of the next step in `pace`, and return the status of the step."""
    numbers, last = vector(core.block, a.NUMBERS_), pace[LAST]
    allowed, ratio = numbers[a.ALLOWED], h / last if last > 0.0 else 0.0
    if h <= MIN_STEP:
        numbers[a.ALLOWED] = 1e300
    numbers[a.RATIO] = ratio
    _stretch(core, ratio, 0.5 * ratio * (1.0 + ratio))
    end = _take(core, command, h, ratio > 0.0)
    numbers[a.ALLOWED], numbers[a.RATIO] = allowed, 1.0
    if end == NO_CONVERGENCE:
        pace[NEXT] = 0.25 * h
    else:
        factor = SAFETY * (allowed / max(numbers[a.ERROR], 1e-300)) ** (1.0 / 3.0)
        pace[NEXT] = min(MAX_STEP, max(MIN_STEP, h * min(GROWTH, max(SHRINKING, factor))))
    if end == OK:
        _stretch(core, 1.0, 2.0 * ratio / (1.0 + ratio))
    elif ratio > 0.0:
        _stretch(core, 1.0 / ratio, 2.0 / (ratio * (1.0 + ratio)))
    return end


@inner
def _stretch(core: Core, of_last: float, of_curve: float) -> None:
    """Scale the expected motion of the next step and the expected change of this motion by two factors."""
    last, curve = vector(core.block, a.LAST), vector(core.block, a.CURVE)
    combine(last, of_last, last, 0.0, last)
    combine(curve, of_curve, curve, 0.0, curve)


@njit
def worst_residual(core: Core) -> tuple[float, int]:
    """Return the norm of the last residual [N], and the joint with the largest component of the residual."""
    gradient, held = vector(core.block, a.GRADIENT), vector(core.block, a.HELD)
    total, worst, most = 0.0, 0, -1.0
    for k in range(len(gradient)):
        if held[k] == 0.0:
            total += gradient[k] ** 2
            if not abs(gradient[k]) <= most:
                worst, most = k, abs(gradient[k])
    return np.sqrt(total), worst // BLOCK_SIZE
