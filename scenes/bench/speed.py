"""How long a step takes, by the number of segments, and how right the distance is at that step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from scenes.bench.crawl import DT, FINER, crawl, us_per_step
from scenes.bench.search import relative_error

LONG = 20
"""Segments from which on the growth is fitted."""


@dataclass(frozen=True)
class Speed:
    """The worm of N segments, recording and ledger on.

    Attributes
    ----------
    segments : int
    duration_s, dt_s : float
        [s].
    us_per_step : float
        Of the fastest run [µs].
    slowest_over_fastest : float
        Of the runs: far from 1 where something else kept the machine busy.
    real_time_factor, real_time_factor_of_call : float
        Simulated over computing time, of the steps alone and of the whole call of `simulate`.
    newton_iterations, gradient_evaluations : float
        Jacobians, and residuals with a Jacobian that is kept, a step.
    fallbacks, halved_steps : int
        In the whole run.
    distance_m, distance_error : float
        [m], relative to that at dt/20.
    """

    segments: int
    duration_s: float
    dt_s: float
    us_per_step: float
    slowest_over_fastest: float
    real_time_factor: float
    real_time_factor_of_call: float
    newton_iterations: float
    gradient_evaluations: float
    fallbacks: int
    halved_steps: int
    distance_m: float
    distance_error: float


@dataclass(frozen=True)
class Growth:
    """Time of a step = us_of_one N^exponent, by least squares in the logarithms.

    Attributes
    ----------
    exponent, us_of_one : float
    segments : tuple of int
        That were taken.
    """

    exponent: float
    us_of_one: float
    segments: tuple[int, ...]


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
        dt_s=result.dt,
        us_per_step=best,
        slowest_over_fastest=max(times) / best,
        real_time_factor=1e6 * result.dt / best,
        real_time_factor_of_call=duration / call,
        newton_iterations=float(result.newton_iterations.mean()),
        gradient_evaluations=float(result.gradient_evaluations.mean()),
        fallbacks=int(result.fallbacks.sum()),
        halved_steps=result.halved_steps,
        distance_m=result.distance,
        distance_error=relative_error(result.distance, exact),
    )


def growth(speeds: Sequence[Speed]) -> Growth:
    """Fit the growth of long worms; of all, where fewer than two are long."""
    long = [speed for speed in speeds if speed.segments >= LONG]
    taken = long if len(long) > 1 else list(speeds)
    sizes, times = (np.log([getattr(s, name) for s in taken]) for name in ("segments", "us_per_step"))
    exponent, constant = np.polyfit(sizes, times, 1)
    return Growth(float(exponent), float(np.exp(constant)), tuple(s.segments for s in taken))
