"""worm3d and its rivals side by side, each at the step where its own distance error is 1 %."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from time import perf_counter

from scenes.bench.crawl import TOLERANCE as NEWTON
from scenes.bench.crawl import crawl
from scenes.bench.rivals import DURATION, REPEATS, TOLERANCE, WARM_UP, Measured, Rival, measure
from scenes.bench.search import NotConvergedError, relative_error
from scenes.bench.task import steps_of

OURS = "worm3d"
STEPS = (0.005, 0.010, 0.015, 0.020, 0.025, 0.030, 0.035, 0.040)
"""That worm3d is tried with [s]."""
ONE_TREE_S = 0.5
"""Simulated by MuJoCo's single tree where the search for its step takes too long [s]."""
REFERENCE = 0.0005
"""Step of worm3d's reference [s]."""


@dataclass(frozen=True)
class Contender:
    """A simulator on the worm of N segments.

    Attributes
    ----------
    name, settings : str
        With version; the configuration in words.
    segments : int
    dt_s : float
        Largest step with an error of at most 1 % [s].
    error : float or None
        Of the distance after 10 s, relative to its own reference; None: unknown.
    us_per_step : float
        [µs].
    real_time_factor : float
        Simulated over computing time, of the steps alone.
    real_time_factor_of_call : float or None
        Of the whole call, for worm3d.
    ratio : float or None
        Of worm3d's real-time factor to this one.
    ratio_of_call : float or None
        With that of worm3d's whole call.
    remark : str
    """

    name: str
    settings: str
    segments: int
    dt_s: float
    error: float | None
    us_per_step: float
    real_time_factor: float
    real_time_factor_of_call: float | None = None
    ratio: float | None = None
    ratio_of_call: float | None = None
    remark: str = ""


def ours(segments: int) -> Contender:
    """Measure worm3d at the largest of `STEPS` up to which all hold the tolerance.

    Raises
    ------
    NotConvergedError
        Not even the smallest does.
    """
    dt, error = largest_that_holds(distance_errors(segments))
    remark = "larger steps not tried" if dt == max(STEPS) else ""
    crawl(segments, WARM_UP, dt)
    calls, walls = zip(*(_timed(segments, dt) for _ in range(REPEATS)), strict=True)
    dt = DURATION / steps_of(DURATION, dt)
    return Contender(
        name=f"{OURS} {metadata.version(OURS)}",
        settings=f"BDF2, every step recorded, ledger on, Newton to {NEWTON:g}",
        segments=segments,
        dt_s=dt,
        error=error,
        us_per_step=1e6 * min(walls) * dt / DURATION,
        real_time_factor=DURATION / min(walls),
        real_time_factor_of_call=DURATION / min(calls),
        remark=remark,
    )


def distance_errors(segments: int) -> dict[float, float]:
    """Return worm3d's error of the distance after 10 s, by time step."""
    reference = crawl(segments, DURATION, REFERENCE, recorded=False).distance
    return {dt: relative_error(crawl(segments, DURATION, dt, recorded=False).distance, reference) for dt in STEPS}


def largest_that_holds(errors: Mapping[float, float], tolerance: float = TOLERANCE) -> tuple[float, float]:
    """Return the largest step, and its error, up to which all hold the tolerance."""
    found: tuple[float, float] | None = None
    for dt in sorted(errors):
        if not errors[dt] <= tolerance:
            break
        found = dt, errors[dt]
    if found is None:
        dt = min(errors)
        raise NotConvergedError(f"worm3d: an error of {errors[dt]:.2g} at dt = {dt:g} s, must be {tolerance:g} or less")
    return found


def _timed(segments: int, dt: float) -> tuple[float, float]:
    """Return the wall time of a call of `simulate`, and of its steps [s]."""
    began = perf_counter()
    result = crawl(segments, DURATION, dt)
    return perf_counter() - began, result.wall_s


def theirs(rival: Rival, own: Contender, remark: str = "") -> Contender | str:
    """Measure a rival against worm3d; a sentence where no step holds the tolerance in the time for the search."""
    try:
        return against(rival, own, measure(rival, own.segments), remark)
    except NotConvergedError as error:
        return f"{rival.name} ({rival.settings(own.segments)}), {own.segments} segments: {error}"


def against(rival: Rival, own: Contender, measured: Measured, remark: str = "") -> Contender:
    """Return a measured rival with worm3d's ratios to it."""
    of_call, factor = own.real_time_factor_of_call, measured.real_time_factor
    return Contender(
        name=rival.name,
        settings=rival.settings(own.segments),
        segments=own.segments,
        dt_s=measured.dt,
        error=measured.error,
        us_per_step=measured.us_per_step,
        real_time_factor=factor,
        ratio=own.real_time_factor / factor,
        ratio_of_call=of_call / factor if of_call is not None else None,
        remark=remark,
    )


def one_tree(own: Contender, best: Contender, seconds: float) -> Iterator[Contender | str]:
    """Measure MuJoCo with the worm as a single kinematic tree, or at the step of its best configuration."""
    from scenes.bench.mujoco_model import Settings
    from scenes.bench.mujoco_worm import MuJoCoWorm

    rival = MuJoCoWorm(Settings(per_tree=own.segments), seconds)
    found = theirs(rival, own, "one tree")
    if isinstance(found, Contender):
        yield found
        return
    factor = rival.real_time_factor(own.segments, best.dt_s, ONE_TREE_S)
    measured = Measured(best.dt_s, float("nan"), 1e6 * best.dt_s / factor, factor)
    yield against(rival, own, measured, "one tree, at the step of the line above")
    yield found


def cannot(rivals: Sequence[Rival]) -> dict[str, tuple[str, ...]]:
    """Return what each rival cannot express of the worm."""
    return {rival.name: tuple(rival.cannot) for rival in rivals}
