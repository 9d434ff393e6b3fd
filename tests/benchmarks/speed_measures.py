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
TOLERANCE = 1e-9
"""Tolerance of Newton's iteration; it changes distances by less than 1e-6 of themselves."""
FLATTENED = 3
"""Greatest number of segments with which the default worm is pressed flat by its own weight. Its chambers are three
times as stiff here."""
SEGMENTS = 6
"""Number of segments of the worms of a batch, and of those in fresh processes."""


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
    return worm if segments > FLATTENED else Worm(segments=segments, k_spring=3.0 * np.asarray(worm.k_spring))


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
    exact = crawl(segments, duration, DT / 20.0, recorded=False).distance
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


def growth(speeds: Sequence[Speed]) -> tuple[float, list[int]]:
    """Return the exponent of the growth of a step's time, and the numbers of segments that it is fitted to.

    The fit is by least squares in the logarithms, to worms of 20 segments and more; to all, where fewer than two are
    so long.
    """
    long = [speed for speed in speeds if speed.segments >= 20]
    taken = long if len(long) > 1 else list(speeds)
    sizes = [speed.segments for speed in taken]
    exponent, _ = np.polyfit(np.log(sizes), np.log([speed.us_per_step for speed in taken]), 1)
    return float(exponent), sizes


@dataclass(frozen=True)
class Throughput:
    """A batch over the gait's period against as many single runs, all of `duration_s`."""

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


def measure_throughput(number: int, duration: float, repeats: int) -> list[Throughput]:
    """Measure batches of a number of runs on one thread and on two, in turns with single runs."""
    gaits = [TravellingWave(period=float(period)) for period in np.linspace(1.6, 2.4, number)]
    calls = [partial(_singles, gaits, duration), *(partial(_batch, gaits, duration, threads) for threads in (1, 2))]
    seconds, results = _fastest_in_turns(calls, repeats)
    distances = [[result.distance for result in found] for found in results]
    steps = sum(len(result.newton_iterations) for result in results[0])
    return [
        Throughput(
            threads=threads,
            duration_s=duration,
            single_s=seconds[0],
            batch_s=seconds[threads],
            worm_steps_per_s=steps / seconds[threads],
            gain=seconds[0] / seconds[threads],
            over_one_thread=seconds[1] / seconds[threads],
            equal=distances[threads] == distances[0],
        )
        for threads in (1, 2)
    ]


def _singles(gaits: list[TravellingWave], duration: float) -> list[Result]:
    worm, given = Worm(segments=SEGMENTS), {"duration": duration, "dt": DT, "tolerance": TOLERANCE}
    return [worm3d.simulate(worm, Plane(), actuation=gait, **given) for gait in gaits]


def _batch(gaits: list[TravellingWave], duration: float, threads: int) -> list[Result]:
    given = {"duration": duration, "dt": DT, "tolerance": TOLERANCE, "threads": threads}
    return worm3d.simulate_batch(Worm(segments=SEGMENTS), Plane(), actuation=gaits, **given)


def _fastest_in_turns(
    calls: Sequence[Callable[[], list[Result]]], repeats: int
) -> tuple[list[float], list[list[Result]]]:
    """Return the least wall time [s] of each call, and what it last returned."""
    best, results = [np.inf] * len(calls), [list[Result]()] * len(calls)
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


def measure_start() -> tuple[float, float, str]:
    """Return the times from the start of Python to the end of the first step, and what the first start says.

    The first time is without compiled code in the cache, the second the fastest of three with it [s].
    """
    with tempfile.TemporaryDirectory() as cache:
        cold, said = _first_step(cache)
        return cold, min(_first_step(cache)[0] for _ in range(3)), said


def measure_memory(steps: int) -> int | None:
    """Return the peak memory after so many steps less that after 1000 [KiB]; None where the system does not tell."""
    return int(_python(RUN + LONG_RUN, str(steps))[0]) if Path("/proc/self/status").exists() else None


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
