"""Many worms at once against as many single runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter

import numpy as np

import worm3d
from control.gaits import TravellingWave
from scenes.bench.crawl import DT, TOLERANCE
from worm3d import Plane, Result, Worm

SEGMENTS = 6
PERIODS = (1.6, 2.4)
"""Of the first and the last worm's gait [s]."""


@dataclass(frozen=True)
class Throughput:
    """A sweep over the gait's period.

    Attributes
    ----------
    runs, segments, threads : int
    duration_s : float
        Of each run [s].
    single_s, batch_s : float
        Wall time of single runs one after the other, and of the batch [s].
    worm_steps_per_s : float
        Of the batch.
    gain : float
        Throughput over that of single runs.
    over_one_thread : float
        Throughput over that of the batch on the first number of threads, 1.
    equal : bool
        Whether the distances are those of the single runs.
    """

    runs: int
    segments: int
    threads: int
    duration_s: float
    single_s: float
    batch_s: float
    worm_steps_per_s: float
    gain: float
    over_one_thread: float
    equal: bool


def measure_throughput(
    runs: int, duration: float, repeats: int, threads: Sequence[int] = (1, 2)
) -> tuple[Throughput, ...]:
    """Measure batches on so many threads each; 1 comes first."""
    gaits = [TravellingWave(period=float(period)) for period in np.linspace(*PERIODS, runs)]
    batches = (partial(_batch, gaits, duration, count) for count in threads)
    times, results = _fastest_in_turns([partial(_singles, gaits, duration), *batches], repeats)
    distances = [[result.distance for result in found] for found in results]
    steps = sum(len(result.newton_iterations) for result in results[0])
    return tuple(
        Throughput(
            runs=runs,
            segments=SEGMENTS,
            threads=count,
            duration_s=duration,
            single_s=times[0],
            batch_s=seconds,
            worm_steps_per_s=steps / seconds,
            gain=times[0] / seconds,
            over_one_thread=times[1] / seconds,
            equal=own == distances[0],
        )
        for count, seconds, own in zip(threads, times[1:], distances[1:], strict=True)
    )


def _singles(gaits: list[TravellingWave], duration: float) -> list[Result]:
    worm = Worm(segments=SEGMENTS)
    return [
        worm3d.simulate(worm, Plane(), actuation=gait, duration=duration, dt=DT, tolerance=TOLERANCE) for gait in gaits
    ]


def _batch(gaits: list[TravellingWave], duration: float, threads: int) -> list[Result]:
    worm = Worm(segments=SEGMENTS)
    return worm3d.simulate_batch(
        worm, Plane(), actuation=gaits, duration=duration, dt=DT, tolerance=TOLERANCE, threads=threads
    )


def _fastest_in_turns(
    calls: Sequence[Callable[[], list[Result]]], repeats: int
) -> tuple[list[float], list[list[Result]]]:
    """Return the least wall time [s] of each call, and what it last returned."""
    best: list[float] = [float("inf")] * len(calls)
    results: list[list[Result]] = [[] for _ in calls]
    for _ in range(repeats):
        for k, call in enumerate(calls):
            began = perf_counter()
            results[k] = call()
            best[k] = min(best[k], perf_counter() - began)
    return best, results
