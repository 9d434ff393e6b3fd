"""Steps as long as an allowed error lets them be, compiled, and rows of the instants between them.

A step that is further from the parabola through the last three places than is allowed (`worm3d.solver.step`) is taken
again, shorter; the next one is as long as the error of the last, which grows with the third power, foretells. Time is
cut into beats, which steps end with: there a run can be looked at, steered, and cut in two. Commands and forces are
given at equal distances, and change linearly between. Rows are interpolated (`worm3d.solver.between`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worm3d.machine.compiled import inner, njit
from worm3d.solver import arrays as a
from worm3d.solver import between
from worm3d.solver.advance import actuate
from worm3d.solver.arrays import Core
from worm3d.solver.block import Block, combine, copy, integers, matrix, vector
from worm3d.solver.entry import reset
from worm3d.solver.guard import COARSE, NO_CONVERGENCE, NOT_FINITE, OK, actuators_start_finite
from worm3d.solver.records import BEFORE
from worm3d.solver.step import step
from worm3d.values.arrays import FloatArray

LAST, NEXT, SINCE, SOLVES = range(4)
"""What a run knows of its steps: the last one, 0 before the first [s], the one that is to be tried next [s], time since
the last whole beat or tick [s], and how many were solved, those taken again included."""
SHORTEST, LONGEST = 1e-5, 2e-2
"""Shortest and longest step [s]: the error of a shorter one is not looked at, but Newton has to converge; a longer one
would pass over what a gait does."""
GIVEN_UP = 64.0
"""Share of the shortest step after which Newton is not tried again."""
GROWTH, SHRINKING, SAFETY = 2.0, 0.2, 0.9
"""Largest and least ratio of a step to the one before, and of its length to the one foretold: BDF2 is stable below a
ratio of 1 + sqrt(2)."""


@njit
def march(
    core: Core,
    records: Block,
    counters: NDArray[np.int64],
    commands: FloatArray,
    external: FloatArray,
    done: int,
    every: int,
    dt: float,
    pace: FloatArray,
    parts: int,
    beat: int,
    begin: int,
) -> tuple[int, int]:
    """Go on by as many ticks as there are commands for; return how many were finished, and how the last step ended.

    Parameters
    ----------
    records, counters, external, every, dt
        As of `worm3d.solver.advance.advance`, with ticks, dt apart, in the place of steps; a row of counters adds up
        those of all steps that end in a tick.
    commands : ndarray, shape (K parts, 5 N)
        Asked of the actuators, `parts` times each tick.
    external : ndarray, shape (K parts + 1, 3, N+1) or (0, 3, N+1)
        Forces on the joints, from the present on [N].
    done : int
        Number of ticks before the chunk.
    pace : ndarray, shape (4,)
        `LAST` and so on; changed.
    beat, begin : int
        Ticks of a beat, and those since a whole one.
    """
    taken, count, asked = 0, len(commands) // parts, vector(core.block, a.ASKED)
    while taken < count:
        ticks = min(beat - (begin + taken) % beat, count - taken)
        span, at, command = ticks * dt, 0.0, asked.copy()
        first, reached = command.copy(), 0
        while reached < ticks:
            h = _length(pace[NEXT], span - at)
            after = span if h == span - at else at + h
            cell = min(int(after / dt * parts), ticks * parts - 1)
            share, row = after / dt * parts - cell, taken * parts + cell
            combine(command, 1.0 - share, first if cell == 0 else commands[row - 1], share, commands[row])
            if len(external) > 0:
                for d in range(3):
                    force = matrix(core.block, a.EXTERNAL)[d]
                    combine(force[: external.shape[2]], 1.0 - share, external[row, d], share, external[row + 1, d])
            reset(core)
            pace[SOLVES] += 1.0
            between.keep(records, BEFORE)
            end = _take(core, command, h, pace)
            for c in range(a.COUNTERS):
                counters[done + taken + reached, c] += integers(core.counters, a.COUNTERS)[c]
            if end == COARSE or (end == NO_CONVERGENCE and pace[NEXT] > SHORTEST / GIVEN_UP):
                continue
            pace[SINCE] = at
            if end != OK:
                return taken + reached, end
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
def _length(wanted: float, left: float) -> float:
    """Return the length of the next step, so that none is much shorter than wanted at the end of a beat."""
    if wanted >= left * (1.0 - 1e-9):
        return left
    return 0.5 * left if 2.0 * wanted > left else wanted


@inner
def _take(core: Core, command: FloatArray, h: float, pace: FloatArray) -> int:
    """Try a step, and choose the length of the next one."""
    numbers, last = vector(core.block, a.NUMBERS_), pace[LAST]
    asked, given = vector(core.block, a.ASKED), vector(core.block, a.GIVEN)
    asked_n, given_n, allowed = asked.copy(), given.copy(), numbers[a.ALLOWED]
    ratio = h / last if last > 0.0 else 0.0
    if h <= SHORTEST:
        numbers[a.ALLOWED] = 1e300
    numbers[a.RATIO] = ratio
    _stretch(core, ratio, 0.5 * ratio * (1.0 + ratio))
    actuate(core, command, h)
    end = step(core, h, ratio > 0.0) if actuators_start_finite(core) else NOT_FINITE
    numbers[a.ALLOWED], numbers[a.RATIO] = allowed, 1.0
    if end == NO_CONVERGENCE:
        pace[NEXT] = 0.25 * h
    else:
        factor = SAFETY * (allowed / max(numbers[a.ERROR], 1e-300)) ** (1.0 / 3.0)
        pace[NEXT] = min(LONGEST, max(SHORTEST, h * min(GROWTH, max(SHRINKING, factor))))
    if end == OK:
        pace[LAST] = h
        _stretch(core, 1.0, 2.0 * ratio / (1.0 + ratio))
    else:
        copy(asked, asked_n)
        copy(given, given_n)
        if ratio > 0.0:
            _stretch(core, 1.0 / ratio, 2.0 / (ratio * (1.0 + ratio)))
    return end


@inner
def _stretch(core: Core, of_last: float, of_curve: float) -> None:
    """Multiply what the next step is expected to move, and how much more than this one."""
    last, curve = vector(core.block, a.LAST), vector(core.block, a.CURVE)
    combine(last, of_last, last, 0.0, last)
    combine(curve, of_curve, curve, 0.0, curve)
