"""What a batch could gain if its vectors were filled by the segments of several worms.

Now one worm fills 6 of 8 lanes in the kernels, and eliminates and decides alone. With W worms of 6 segments in a row

* a kernel takes, per worm, what it takes on 6 W segments in a row (timed on a worm of so many);
* the linear solver has a worm in each lane (a prototype is timed: `scenes.bench.lane_elimination`);
* of all other compiled work a worm costs the W-th part, as if every loop and decision were perfect in lanes;
* what the loops that are timed leave of a step, "other", shrinks as the rest does.

Worms do not need the same iterations. Either all take those of the slowest ("lock-step"), or each begins its next
step when it has finished ("own pace"): a new Jacobian and its factors are then made for all as soon as one needs them,
and so are the start and the end of a step. "No waiting" has neither loss: nothing can be faster. The counts are those
of the batch's own runs. Moving numbers into lanes and out of them costs nothing here: no gain can be greater.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import worm3d
from control.gaits import TravellingWave
from scenes.bench import loops
from scenes.bench.crawl import DT
from scenes.bench.lane_elimination import elimination, side_by_side
from scenes.bench.shares import ROUNDS, Bed, Counts, Loop, parts_of_step
from scenes.bench.throughput import PERIODS, SEGMENTS, Throughput, measure_throughput
from worm3d import Plane, Result, Worm
from worm3d.machine.banded import B
from worm3d.plant import kernels
from worm3d.solver.arrays import WORLD_ROWS

WORMS = (2, 4, 8)
"""Side by side."""

PLACED = ("segment_shape", "world")
RESIDUAL = (*PLACED, "point_force", "joint_gradient", "segment_gradient")
KERNELS_OF: Mapping[str, tuple[str, ...]] = {
    "whole": (*PLACED, "point_stiffness", "joint_hessian", "segment_hessian"),
    "exchanged": RESIDUAL,
    "residual": RESIDUAL,
    "ahead": ("segment_motion", "point_yielding"),
    "expect": ("point_expected",),
    "start": ("segment_shape", "world", "segment_rims", "segment_shape", "point_start", "node_start", "joint_start"),
    "end": (),
    "ledger": ("segment_ledger", "point_after", "node_after", "joint_ledger"),
    "record": ("point_momenta", "node_momenta"),
}
"""That each loop of `scenes.bench.shares` runs in all lanes."""


@dataclass(frozen=True)
class Bound:
    """The least that a step of one of W worms costs.

    Attributes
    ----------
    scheme : str
    worms : int
        Side by side.
    us : dict
        By part [µs].
    step_gain, batch_gain : float
        Of a step over that of a worm alone, and of the whole batch over single runs.
    """

    scheme: str
    worms: int
    us: dict[str, float]
    step_gain: float
    batch_gain: float


@dataclass(frozen=True)
class LaneStudy:
    """What was measured, and the bounds.

    Attributes
    ----------
    throughput : Throughput
        Of the batch as it is.
    stepping_s : float
        Of its wall time, what its compiled steps take [s].
    counts : dict
        Counts of a step alone (1) and in lock-step of W worms.
    now : dict
        A step of a worm alone by part [µs].
    loops_us : dict
        Each loop as it is (1) and with W worms in its lanes [µs].
    bounds : tuple of Bound
    """

    throughput: Throughput
    stepping_s: float
    counts: dict[int, Counts]
    now: dict[str, float]
    loops_us: dict[int, dict[str, float]]
    bounds: tuple[Bound, ...]

    def allowed(self, gain: float) -> float:
        """Return what a step may cost, over what it costs now, for a batch of such a gain."""
        outside = self.throughput.batch_s - self.stepping_s
        return (self.throughput.single_s / gain - outside) / self.stepping_s


def measure_lanes(runs: int, duration: float, repeats: int) -> LaneStudy:
    """Measure a batch, its parts with W worms in the lanes, and what it could gain; `runs` divides by all W."""
    (throughput,) = measure_throughput(runs, duration, repeats, threads=(1,))
    results = _batch(runs, duration)
    stepping = min(sum(result.wall_s for result in found) for found in (results, _batch(runs, duration)))
    steps = sum(len(result.newton_iterations) for result in results)
    counts = {worms: in_lock_step(results, worms) for worms in (1, *WORMS)}
    us = loops_in_lanes()
    step = 1e6 * stepping / steps
    now = parts_of_step(us[1], counts[1])
    now["other"] = max(0.0, step - sum(now.values()))
    outside = throughput.batch_s - stepping
    bounds = [
        _bound(scheme, worms, found, now, throughput.single_s, outside, steps)
        for worms in WORMS
        for scheme, found in _schemes(us[worms], counts, worms).items()
    ]
    return LaneStudy(throughput, stepping, counts, now, us, tuple(bounds))


def _batch(runs: int, duration: float) -> list[Result]:
    gaits = [TravellingWave(period=float(period)) for period in np.linspace(*PERIODS, runs)]
    return worm3d.simulate_batch(Worm(segments=SEGMENTS), Plane(), actuation=gaits, duration=duration, dt=DT)


def in_lock_step(results: Sequence[Result], worms: int) -> Counts:
    """Return the means of what every worm of a group does if all do in each step what one of them needs."""

    def greatest(counts: list[NDArray[np.int64]]) -> float:
        return float(np.stack(counts).reshape(len(results) // worms, worms, -1).max(axis=1).mean())

    jacobians = greatest([result.newton_iterations for result in results])
    iterations = greatest([result.newton_iterations + result.gradient_evaluations for result in results])
    solves = 1.0 + greatest([result.breakaways for result in results])
    return Counts(solves, jacobians, iterations - jacobians)


def _schemes(us: Mapping[str, float], counts: Mapping[int, Counts], worms: int) -> dict[str, dict[str, float]]:
    """Return the parts of a step [µs] in each scheme."""
    return {
        "no waiting": parts_of_step(us, counts[1]),
        "lock-step": parts_of_step(us, counts[worms]),
        "own pace": _own_pace(us, counts[1], worms),
    }


def _own_pace(us: Mapping[str, float], counts: Counts, worms: int) -> dict[str, float]:
    """Every iteration does for all what one of the worms needs, the start and end of a step too."""
    iterations = counts.jacobians + counts.residuals
    turns, jacobians = (
        iterations * (1.0 - (1.0 - part / iterations) ** worms) for part in (counts.solves, counts.jacobians)
    )
    found = parts_of_step(us, Counts(turns, jacobians, iterations - jacobians))
    for part in ("start and end of a step", "ledger", "recording"):
        found[part] *= turns
    found["contact regimes"] += (turns - 1.0) * us["expect"]
    return found


def _bound(
    scheme: str,
    worms: int,
    found: Mapping[str, float],
    now: Mapping[str, float],
    single_s: float,
    outside_s: float,
    steps: int,
) -> Bound:
    known = sum(value for part, value in now.items() if part != "other")
    us = {**found, "other": now["other"] * sum(found.values()) / known}
    stepping = 1e-6 * steps * sum(us.values())
    return Bound(scheme, worms, us, sum(now.values()) / sum(us.values()), single_s / (outside_s + stepping))


def loops_in_lanes() -> dict[int, dict[str, float]]:
    """Return the time of each loop for one worm, alone (1) and as one of W, in turns [µs]."""
    beds = {worms: Bed(SEGMENTS * worms) for worms in (1, *WORMS)}
    names = dict.fromkeys(name for run in KERNELS_OF.values() for name in run)
    timed = {worms: {name: kernel_loop(bed, name) for name in names} for worms, bed in beds.items()}
    for worms in WORMS:
        timed[worms] |= eliminations(beds[1], worms)
    timed[1] |= beds[1].loops()
    us = {worms: dict.fromkeys(found, np.inf) for worms, found in timed.items()}
    for _ in range(ROUNDS):
        for worms, found in timed.items():
            for name, loop in found.items():
                us[worms][name] = min(us[worms][name], beds[worms].us(loop) / worms)
    return {1: us[1], **{worms: _filled(us[1], us[worms], worms) for worms in WORMS}}


def _filled(alone: Mapping[str, float], side: Mapping[str, float], worms: int) -> dict[str, float]:
    """Return the loops with W worms in the lanes, of their kernels' times and of those of a worm alone [µs]."""
    us = {"factorise": side["factorise"], "solve": side["solve"]}
    us["refactorise"] = side["factorise"] * alone["refactorise"] / alone["factorise"]
    for name, run in KERNELS_OF.items():
        rest = max(0.0, alone[name] - sum(alone[kernel] for kernel in run))
        us[name] = sum(side[kernel] for kernel in run) + rest / worms
    return us


def kernel_loop(bed: Bed, name: str) -> Loop:
    """Return the loop of a kernel on the worm's own inputs; its outputs are thrown away."""
    plant, of = bed.plant, name.partition("_")[0]
    inputs = plant.arrays[f"{of}_in"]
    count = {"segment": plant.n, "joint": plant.n - 1, "node": plant.n + 1}.get(of) or inputs.shape[1]
    made = kernels().get(name)
    address, size = (made.address, made.rows_out) if made else (plant.world_kernel.address, WORLD_ROWS)
    outputs = np.zeros((size, inputs.shape[1]))
    return lambda times: loops.kernel_loop(address, inputs, outputs, count, times)


def eliminations(bed: Bed, worms: int) -> dict[str, Loop]:
    """Return the loops of so many systems side by side, each the one of a worm in the middle of a step."""
    bed.us(bed.loops()["factorise"])
    band, size = bed.plant.arrays["band"], bed.plant.arrays["x"].size
    bands = side_by_side([band] * worms)
    b, x = np.ones((size, worms)), np.zeros((size + 2 * B, worms))
    solve, factors = elimination(worms), np.zeros_like(bands)
    solve(bands, b, x, factors, True, 1)
    return {
        "factorise": lambda times: solve(bands, b, x, factors, True, times),
        "solve": lambda times: solve(bands, b, x, factors, False, times),
    }
