"""What the time of a step is spent on.

The parts run in compiled loops, over and over on the same data: their times are lower bounds. The rest of the measured
step - caches gone cold, regimes that change, breakaways, iterations of a fallback - is "other".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scenes.bench import loops
from scenes.bench.crawl import DT, crawl, us_per_step
from worm3d import Friction, Result
from worm3d.constraints import held_mask
from worm3d.plant import Plant
from worm3d.solver.arrays import BLOCK
from worm3d.solver.evaluate import NONE, WHOLE
from worm3d.solver.records import Records

Loop = Callable[[int], None]

BEFORE = 1.3
"""Simulated before the step whose parts are timed: some contacts stick, some slide [s]."""
ROUNDS = 7
"""In each of which everything is timed once; of each the fastest counts."""
LOOP_S = 0.01
"""Least length of a loop [s]."""


@dataclass(frozen=True)
class Shares:
    """Parts of a step of the worm of N segments.

    Attributes
    ----------
    segments : int
    us_per_step : float
        Measured [µs].
    us : dict
        By part [µs]; they and "other" add up to the step.
    """

    segments: int
    us_per_step: float
    us: dict[str, float]

    @property
    def fractions(self) -> dict[str, float]:
        """By part, of the measured step."""
        return {name: value / self.us_per_step for name, value in self.us.items()}


@dataclass(frozen=True)
class Counts:
    """How often a step does what.

    Attributes
    ----------
    solves : float
        Newton from the start, and again after contacts broke away.
    jacobians, residuals : float
        Evaluations with and without a new Jacobian.
    """

    solves: float
    jacobians: float
    residuals: float

    @classmethod
    def of(cls, result: Result) -> Counts:
        """Return the means of a run."""
        means = (x.mean() for x in (result.breakaways, result.newton_iterations, result.gradient_evaluations))
        breakaways, jacobians, residuals = map(float, means)
        return cls(1.0 + breakaways, jacobians, residuals)


class Bed:
    """A worm in the middle of a step, on which loops can be timed.

    Parameters
    ----------
    segments : int
    """

    def __init__(self, segments: int) -> None:
        result = crawl(segments, BEFORE)
        worm, self.state = result.worm, result.state
        mask = held_mask(None, segments, flat=worm.flat, clamped=False)
        self.plant = Plant(worm, result.world, Friction(), result.gravity, mask)
        self.core = self.plant.core
        self.command = np.zeros(5 * segments)
        self.records = Records(self.plant.memory_of_core, self.plant.clamped, 2)

    def loops(self) -> dict[str, Loop]:
        """Return what is timed, by name; each takes the number of passes."""
        core, block = self.core, self.records.block
        return {
            "whole": lambda times: loops.evaluate_loop(core, WHOLE, times),
            "exchanged": lambda times: loops.exchange_loop(core, times),
            "residual": lambda times: loops.evaluate_loop(core, NONE, times),
            "factorise": lambda times: loops.linear_loop(core, 0, times),
            "refactorise": lambda times: loops.linear_loop(core, BLOCK * (core.n // 2), times),
            "solve": lambda times: loops.linear_loop(core, -1, times),
            "ahead": lambda times: loops.ahead_loop(core, times),
            "expect": lambda times: loops.expect_loop(core, times),
            "start": lambda times: loops.start_loop(core, self.command, DT, times),
            "end": lambda times: loops.end_loop(core, times),
            "ledger": lambda times: loops.ledger_loop(core, times),
            "record": lambda times: loops.record_loop(core, block, times),
        }

    def us(self, loop: Loop) -> float:
        """Return the time of one pass of a loop [µs]."""
        self.plant.set_pose(self.state)
        self.plant.remember(self.state.memory)
        loops.ready(self.core, DT)
        times = 16
        while (seconds := _seconds(loop, times)) < LOOP_S:
            times *= 2
        return 1e6 * seconds / times


def measure_shares(segments: int, duration: float) -> Shares:
    """Measure a step and its parts in turns: a machine that is busy for a while then slows all of them down."""
    bed, counts = Bed(segments), Counts.of(crawl(segments, duration))
    timed = bed.loops()
    for loop in timed.values():
        bed.us(loop)  # compiles it
    us, whole = dict.fromkeys(timed, np.inf), np.inf
    for _ in range(ROUNDS):
        whole = min(whole, us_per_step(crawl(segments, duration)))
        for name, loop in timed.items():
            us[name] = min(us[name], bed.us(loop))
    parts = parts_of_step(us, counts)
    return Shares(segments, whole, {**parts, "other": whole - sum(parts.values())})


def parts_of_step(us: Mapping[str, float], counts: Counts) -> dict[str, float]:
    """Return the time of each part in a step [µs]: every solve begins with a whole Jacobian, others cost less.

    Of those it is taken that they exchange one contact in the middle of the body, which costs about least.
    """
    iterations, whole = counts.jacobians + counts.residuals, min(counts.solves, counts.jacobians)
    exchanged = counts.jacobians - whole
    return {
        "kernels": whole * us["whole"] + exchanged * us["exchanged"] + counts.residuals * us["residual"],
        "linear solver": whole * us["factorise"] + exchanged * us["refactorise"] + counts.residuals * us["solve"],
        "contact regimes": iterations * us["ahead"] + us["expect"],
        "start and end of a step": us["start"] + us["end"],
        "ledger": us["ledger"],
        "recording": us["record"],
    }


def _seconds(loop: Loop, times: int) -> float:
    began = perf_counter()
    loop(times)
    return perf_counter() - began
