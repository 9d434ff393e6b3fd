"""What `speed.py` measures of whole runs: time of a step, many runs at once, cold start, memory.

All runs are those of the default worm that crawls over a plane by a travelling wave.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import perf_counter, time

import numpy as np

import worm3d
from control.gaits import TravellingWave
from scenes.language.errors import SceneError
from worm3d import Friction, Plane, Result, Status, Worm

DT = 0.01
"""Time step at which speeds are measured [s]."""
FINER = 20
"""Time step of a measured run over that of its reference."""
TOLERANCE = 1e-9
"""Tolerance of Newton's iteration; it changes distances by less than 1e-6 of themselves."""
FLATTENED = 3
"""Greatest number of segments with which the default worm is pressed flat by its own weight."""
STIFFER = 3.0
"""Factor of the chambers' stiffness by which such a worm stands."""
LONG = 20
"""Number of segments from which on the growth of a step's time is fitted."""
SEGMENTS = 6
"""Number of segments of the worms of a batch, and of those in fresh processes."""
PERIODS = (1.6, 2.4)
"""Gait periods of the first and the last worm of a batch [s]."""


class StoppedError(SceneError):
    """A run, or a process, that was to be measured did not reach its end."""

    exit_code = 3


def steps_of(duration: float, dt: float) -> int:
    """Return the number of equal steps of at most dt in `duration`."""
    return max(1, int(np.ceil(duration / dt - 1e-9)))


def relative_error(distance: float, reference: float) -> float:
    """Return |distance - reference|/|reference|; NaN if either run failed."""
    return abs(distance - reference) / abs(reference) if reference else float("nan")


def standing(segments: int) -> Worm:
    """Return the default worm of N segments, with stiffer chambers where it would not stand."""
    worm = Worm(segments=segments)
    return worm if segments > FLATTENED else Worm(segments=segments, k_spring=STIFFER * np.asarray(worm.k_spring))


def crawl(
    segments: int, duration: float, dt: float = DT, *, recorded: bool = True, ground: Friction | None = None
) -> Result:
    """Return a run of whole steps of at most dt, with every step recorded or only start and end.

    Raises
    ------
    StoppedError
        It did not reach its end.
    """
    steps = steps_of(duration, dt)
    result = worm3d.simulate(
        standing(segments),
        Plane(),
        ground,
        TravellingWave(),
        duration=duration,
        dt=duration / steps,
        record_every=1 if recorded else steps,
        tolerance=TOLERANCE,
    )
    if result.status is not Status.DONE:
        raise StoppedError(f"bench: the worm of {segments} segments at dt = {dt:.4g} s: {result.stop.sentence}")
    return result


def us_per_step(result: Result) -> float:
    """Return the wall time of a step [µs]."""
    return 1e6 * result.wall_s / len(result.newton_iterations)


@dataclass(frozen=True)
class Speed:
    """Time of a step of the worm of N segments, with recording and ledger on, in the fastest of some runs."""

    segments: int
    duration_s: float
    us_per_step: float
    slowest_over_fastest: float
    """Far from 1 where something else kept the machine busy."""
    real_time_factor: float
    """Simulated over computing time, of the steps alone."""
    real_time_factor_of_call: float
    """Simulated over computing time, of the whole call of `simulate`."""
    newton_iterations: float
    """Jacobians a step."""
    gradient_evaluations: float
    """Residuals with a Jacobian that is kept, a step."""
    fallbacks: int
    distance_error: float
    """Relative to the distance at dt/20."""


def measure_speed(segments: int, duration: float, repeats: int) -> Speed:
    """Measure the fastest of some runs, after one that warms up."""
    result, call = crawl(segments, duration), np.inf
    times: list[float] = []
    for _ in range(repeats):
        began = perf_counter()
        result = crawl(segments, duration)
        call = min(call, perf_counter() - began)
        times.append(us_per_step(result))
    best = min(times)
    exact = crawl(segments, duration, DT / FINER, recorded=False).distance
    return Speed(
        segments=segments,
        duration_s=duration,
        us_per_step=best,
        slowest_over_fastest=max(times) / best,
        real_time_factor=1e6 * result.dt / best,
        real_time_factor_of_call=duration / call,
        newton_iterations=float(result.newton_iterations.mean()),
        gradient_evaluations=float(result.gradient_evaluations.mean()),
        fallbacks=int(result.fallbacks.sum()),
        distance_error=relative_error(result.distance, exact),
    )


@dataclass(frozen=True)
class Growth:
    """Time of a step = us_of_one N^exponent, by least squares in the logarithms over `segments`."""

    exponent: float
    us_of_one: float
    segments: tuple[int, ...]


def growth(speeds: Sequence[Speed]) -> Growth:
    """Fit the growth of long worms; of all, where fewer than two are long."""
    long = [speed for speed in speeds if speed.segments >= LONG]
    taken = long if len(long) > 1 else list(speeds)
    sizes, times = (np.log([getattr(s, name) for s in taken]) for name in ("segments", "us_per_step"))
    exponent, constant = np.polyfit(sizes, times, 1)
    return Growth(float(exponent), float(np.exp(constant)), tuple(s.segments for s in taken))


@dataclass(frozen=True)
class Throughput:
    """A batch over the gait's period against as many single runs, all of `duration_s`."""

    runs: int
    segments: int
    threads: int
    duration_s: float
    single_s: float
    """Wall time of the single runs, one after the other."""
    batch_s: float
    worm_steps_per_s: float
    gain: float
    """Throughput over that of single runs."""
    over_one_thread: float
    equal: bool
    """Whether the distances are those of the single runs."""


def measure_throughput(
    runs: int, duration: float, repeats: int, threads: Sequence[int] = (1, 2)
) -> tuple[Throughput, ...]:
    """Measure batches on so many threads each, in turns with single runs; 1 comes first."""
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


RUN = f"""
import worm3d
from control.gaits import TravellingWave
def run(steps):
    worm3d.simulate(worm3d.Worm(segments={SEGMENTS}), worm3d.Plane(), actuation=TravellingWave(),
                    duration={DT} * steps, dt={DT}, record_every=steps)
"""
FIRST_STEP = RUN + "run(1)\nimport time\nprint(time.time())\n"
LONG_RUN = """
import sys
def peak():
    with open('/proc/self/status') as lines:
        return next(int(line.split()[1]) for line in lines if line.startswith('VmHWM'))
run(1000)
before = peak()
run(int(sys.argv[1]))
print(peak() - before)
"""


@dataclass(frozen=True)
class Start:
    """Time from the start of Python to the end of the first step, without and with compiled code in the cache."""

    segments: int
    cold_s: float
    warm_s: float
    cold_says_so: bool
    """Whether the cold start tells on standard error what takes so long."""


@dataclass(frozen=True)
class MemoryGrowth:
    """Peak memory of a run with recording off."""

    segments: int
    steps: int
    grown_kib: int | None
    """Peak after the run less the peak after 1000 steps; None where the system does not tell."""


def measure_start(warm_starts: int = 3) -> Start:
    """Start Python with an empty cache, and then some times more, of which the fastest counts."""
    with tempfile.TemporaryDirectory() as cache:
        cold, said = _first_step(cache)
        warm = min(_first_step(cache)[0] for _ in range(warm_starts))
    return Start(SEGMENTS, cold, warm, bool(said.strip()))


def measure_memory(steps: int) -> MemoryGrowth:
    """Run so many steps in a process of their own."""
    known = Path("/proc/self/status").exists()
    return MemoryGrowth(SEGMENTS, steps, int(_python(RUN + LONG_RUN, str(steps))[0]) if known else None)


def _first_step(cache: str) -> tuple[float, str]:
    """Return the seconds to the end of the first step, and what went to standard error."""
    began = time()
    ended, said = _python(FIRST_STEP, XDG_CACHE_HOME=cache)
    return float(ended) - began, said


def _python(code: str, *arguments: str, **environment: str) -> tuple[str, str]:
    """Run code in a Python of its own, and return what it printed."""
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise StoppedError(f"bench: a fresh Python failed: {last}")
    return done.stdout, done.stderr
