"""What the time of a step is spent on.

The parts of a step run in compiled loops, over and over on the same data, so that they can be timed: their times are
lower bounds. The rest of the measured step (caches gone cold, regimes that change, breakaways, iterations of a
fallback) is "other".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from time import perf_counter

import numpy as np
from speed_measures import DT, crawl, us_per_step

from worm3d import Friction
from worm3d.machine.banded import lu_factor, lu_solve
from worm3d.machine.compiled import njit
from worm3d.running.plant import Plant
from worm3d.running.problem import held_mask
from worm3d.solver import arrays as a
from worm3d.solver import fronts, ledger, regimes
from worm3d.solver.actuate import actuate
from worm3d.solver.arrays import Core
from worm3d.solver.block import Block, copy, matrix, vector
from worm3d.solver.entry import reset
from worm3d.solver.evaluate import LOCAL_HESSIAN, NO_HESSIAN, WHOLE_HESSIAN, evaluate, hold
from worm3d.solver.newton import _newton_step
from worm3d.solver.records import record
from worm3d.solver.step import _commit, begin, place_start
from worm3d.values.arrays import FloatArray

Loop = Callable[[int], None]

ROUNDS = 7
"""Number of rounds, in each of which everything is timed once; the fastest counts."""
LOOP_S = 0.01
"""Least duration of a timed loop [s]."""


def measure_shares(segments: int, duration: float) -> dict[str, float]:
    """Return the time of a step of the worm of N segments, and of its parts, which with "other" add up to it [µs].

    All are measured in turns: a machine that is busy for a while then slows all of them down.
    """
    step, result = _MiddleOfStep(segments), crawl(segments, duration)
    loops = step.loops()
    for loop in loops.values():
        step.us(loop)  # compiles it
    us, whole = dict.fromkeys(loops, np.inf), np.inf
    for _ in range(ROUNDS):
        whole = min(whole, us_per_step(crawl(segments, duration)))
        for name, loop in loops.items():
            us[name] = min(us[name], step.us(loop))
    counts = (result.breakaways, result.newton_iterations, result.gradient_evaluations)
    parts = parts_of_step(us, *(float(count.mean()) for count in counts))
    return {**parts, "other": whole - sum(parts.values()), "a step": whole}


def parts_of_step(us: Mapping[str, float], breakaways: float, jacobians: float, residuals: float) -> dict[str, float]:
    """Return the time of each part in a step [µs]; a solve begins with a whole Jacobian, its others cost less.

    Each of the others is assumed to exchange one contact in the middle of the body, which costs about least.

    Parameters
    ----------
    us : mapping
        Time of a pass of each loop [µs].
    breakaways, jacobians, residuals : float
        Number in a step: of solves after the first, of evaluations with a new Jacobian and of those without.
    """
    whole = min(1.0 + breakaways, jacobians)
    exchanged = jacobians - whole
    return {
        "kernels": whole * us["whole"] + exchanged * us["exchanged"] + residuals * us["residual"],
        "linear solver": jacobians * us["factorise"] + residuals * us["solve"],
        "contact regimes": (jacobians + residuals) * us["ahead"] + us["expect"],
        "start and end of a step": us["start"] + us["end"],
        "ledger": us["ledger"],
        "recording": us["record"],
    }


class _MiddleOfStep:
    """A worm of so many segments in the middle of a step, on which loops can be timed."""

    def __init__(self, segments: int) -> None:
        result = crawl(segments, 1.3)  # some contacts stick then, and some slide
        worm, self.state = result.worm, result.state
        mask = held_mask(None, segments, flat=worm.flat, clamped=False)
        self.plant = Plant(worm, result.world, Friction(), result.gravity, mask)
        self.records = self.plant.records(2)

    def loops(self) -> dict[str, Loop]:
        """Return what is timed, by name; each takes the number of passes."""
        core = self.plant.core
        return {
            "whole": partial(evaluate_loop, core, WHOLE_HESSIAN),
            "exchanged": partial(exchange_loop, core),
            "residual": partial(evaluate_loop, core, NO_HESSIAN),
            "factorise": partial(linear_loop, core, True),
            "solve": partial(linear_loop, core, False),
            "ahead": partial(ahead_loop, core),
            "expect": partial(expect_loop, core),
            "start": partial(start_loop, core, np.zeros(5 * core.n), DT),
            "end": partial(end_loop, core),
            "ledger": partial(ledger_loop, core),
            "record": partial(record_loop, core, self.records.block),
        }

    def us(self, loop: Loop) -> float:
        """Return the time of one pass of a loop [µs]."""
        self.plant.set_pose(self.state)
        self.plant.remember(self.state.memory)
        ready(self.plant.core, DT)
        times, seconds = 8, 0.0
        while seconds < LOOP_S:
            times *= 2
            began = perf_counter()
            loop(times)
            seconds = perf_counter() - began
        return 1e6 * seconds / times


@njit
def ready(core: Core, dt: float) -> None:
    """Begin a step by BDF2, go as far as Newton's first direction, and keep the ledger of that."""
    place_start(core)
    begin(core, dt, True)
    regimes.set_regimes_from_last_step(core)
    _newton_step(core, WHOLE_HESSIAN)
    ledger.prepare(core)
    ledger.add(core, vector(core.block, a.TERMS_))


@njit
def evaluate_loop(core: Core, hessian: int, times: int) -> None:
    """Compute potential, gradient and perhaps band: the kernels."""
    for _ in range(times):
        evaluate(core, a.X, True, hessian)


@njit
def exchange_loop(core: Core, times: int) -> None:
    """Compute the residual, and exchange what a contact in the middle of the body contributes to the band."""
    for _ in range(times):
        vector(core.block, a.CHANGED)[core.n // 2] = 1.0
        evaluate(core, a.X, True, LOCAL_HESSIAN)


@njit
def linear_loop(core: Core, factorises: bool, times: int) -> None:
    """Solve for the direction as Newton does, perhaps with new factors."""
    factor, step = matrix(core.block, a.FACTOR), vector(core.block, a.DIRECTION)
    for _ in range(times):
        hold(core, factorises)
        copy(step, vector(core.block, a.GRADIENT))
        if factorises:
            lu_factor(matrix(core.block, a.BANDED_JACOBIAN), factor)
        lu_solve(factor, step)


@njit
def ahead_loop(core: Core, times: int) -> None:
    """Ask what contacts do next, in an iteration; the error is so large that nothing changes."""
    for _ in range(times):
        regimes.predict_yielding(core, vector(core.block, a.DIRECTION), 1e9)
        regimes.change_regimes(core, regimes.lands(core))


@njit
def expect_loop(core: Core, times: int) -> None:
    """Take contacts for what is expected of them before the first iteration."""
    for _ in range(times):
        regimes.set_regimes_from_last_step(core)
        fronts.expect(core)


@njit
def start_loop(core: Core, command: FloatArray, dt: float, times: int) -> None:
    """Do everything before Newton."""
    for _ in range(times):
        actuate(core, command, dt)
        place_start(core)
        begin(core, dt, True)


@njit
def end_loop(core: Core, times: int) -> None:
    """Renew histories, anchors and directors after the step."""
    for _ in range(times):
        _commit(core)


@njit
def ledger_loop(core: Core, times: int) -> None:
    """Keep the energy ledger."""
    for _ in range(times):
        ledger.prepare(core)
        ledger.add(core, vector(core.block, a.TERMS_))


@njit
def record_loop(core: Core, records: Block, times: int) -> None:
    """Write a row of the result."""
    for _ in range(times):
        reset(core)
        record(core, records, 1)
