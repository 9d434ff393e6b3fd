"""The closed loop on families of worms, grounds, paths and faults that are drawn by a seed.

    python tests/benchmarks/closed_loop.py [FAMILY ...] [--seed 500] [--count N] [--workers 2] [--each]

The controller knows the default worm only (`controller.map=default`), unless a family says otherwise. For each family
and each way of control a line has the median and the worst of each figure over the draws, and the sums of counts; with
`--each` there is also a line for each draw:

    inner      six unequal chambers on each side (gains 0.6 to 1.1), lags 0.5 to 3 times and springs 0.7 to 1.3 times
               the default ones; line, circle and S-curve at 0.08 m/s
    slopes     such worms up to 4 degrees up and 1.5 across
    lost       such worms; the centre of mass is lost for 20 s, measured once a second, or measured 0.5 s late
    paths      curves, eights, spirals, squares with round corners, at 10 to 95 % of the speed that they allow
    errors     the centre of mass is off by 1 to 10 cm for 0.5 to 5 s
    arrivals   a line or a pipe with an end, and 120 s of rest there
    clean      paths on level ground and slopes up to 1.7 degrees, on which nothing is wrong
    faults     strains lost or swapped, drift of the centre of mass, heading off, a push, from 8 to 16 s on
    chambers   a left chamber that stays long from 10 s on
    climbs     a slope, and a pipe that rises from it, by tilt, radius and friction
    pipe       shipped scenes in pipes and variations, with the map of the scene
    shipped    shipped scenes with paths and variations, with the map of the scene
    estimates  worms of other mass, springs, friction and noise: does the estimator know how wrong it is?
    obstacles  a line with an end, an S-curve or a circle among 2 to 5 discs and walls, each of which may be unknown
               until it is near (`obstacle_fields.py`); those without a way are to be refused or to end in a stop

Figures: bias of the speed, and the same over the first six waves after one and a half [%]; waves until the speed of
three waves stays within 5 %; rms offset from the path [body lengths]; work of the actuators [J].

The figures of `estimates` are normalised estimation errors squared over their degrees of freedom: e^T P^-1 e with the
error e and the covariance P of place and heading, against the centre of mass and the chord's azimuth, each averaged
over the wave about that instant, since estimates have no rocking. 1 is right, more is too sure. (Bar-Shalom, Li,
Kirubarajan: Estimation with Applications to Tracking and Navigation, 5.4.2.) Six worms had 0.67 together in the mean,
0.60 to 1.08 for the place, 0.21 to 0.55 for the heading, and innovations of 0.86 to 1.08.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple
from unittest import mock

import families
import numpy as np
from families import Case
from measuring import mapped, options, say
from numpy.random import Generator

from control.estimation.estimate import Estimate
from control.estimation.estimator import Estimator
from scenes.language.errors import SceneError
from scenes.models.control.build import reference_of
from scenes.models.loading import Scene, load_scene
from scenes.records.record import Record
from scenes.running.runner import simulate
from worm3d.values.arrays import FloatArray

WAVE = 1.25
"""Period of the default worm's wave [s]."""
MPC, WITHOUT, LOS, OPEN, SCENES_OWN = "mpc", "no inner loop", "line-of-sight", "open loop", "as shipped"
WAYS: Mapping[str, Sequence[str]] = {
    MPC: ("controller.kind=mpc",),
    WITHOUT: ("controller.kind=mpc", "controller.inner_loop=false"),
    LOS: ("controller.kind=pi_los",),
    OPEN: ("controller.kind=open_loop",),
    SCENES_OWN: (),
}
"""Overrides by the way of control."""
Figures = dict[str, float]


def _along(scene: Scene, run: Record) -> tuple[FloatArray, FloatArray]:
    """Return times, and ways along the path averaged over a wave."""
    path, near, along = reference_of(scene.settings).path, None, []
    assert path is not None
    for place in run["com"][:, :2]:
        near = float(path.project(place, near))
        along.append(near)
    time = np.arange(0.0, run["time"][-1], WAVE / 20.0)
    mean = np.convolve(np.interp(time, run["time"], along), np.full(20, 0.05), "valid")
    return time[: len(mean)] + 9.5 * WAVE / 20.0, mean


def _kinds(run: Record) -> list[str]:
    return [str(row["kind"]) for row in run.summary.faults]


def tracked(case: Case, scene: Scene) -> Figures:
    """Return how a run kept its speed and path."""
    run = simulate(scene)
    time, mean = _along(scene, run)
    first = float(np.diff(np.interp([1.5 * WAVE, 7.5 * WAVE], time, mean))[0]) / (6.0 * WAVE * case.speed) - 1.0
    off = np.abs((mean[60:] - mean[:-60]) / (3.0 * WAVE * case.speed) - 1.0) > 0.05
    last = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
    bias = abs(float(run.summary["speed_bias_relative"]))
    return {
        "bias %": 100.0 * bias,
        "bias mm/s": 1e3 * bias * case.speed,
        "first %": 100.0 * abs(first),
        "settled": np.inf if last == len(off) else last / 20.0,
        "offset BL": float(run.summary["cross_track_rms_bl"]),
        "work J": float(run.summary["work_contract_J"]),
        "#fallen": float("on its side" in _kinds(run)),
        "#held": float(any("held still" in str(row["advice"]) for row in run.summary.faults)),
    }


def without_place(case: Case, scene: Scene) -> Figures:
    """Return the speed while the centre of mass is lost, and the offset where it is rare or late."""
    run = simulate(scene)
    if case.kind != "lost":
        return {f"offset {case.kind} BL": float(run.summary["cross_track_rms_bl"])}
    gone = float(np.diff(np.interp([case.begin + WAVE, case.begin + 20.0], *_along(scene, run)))[0])
    return {"speed while lost %": 100.0 * abs(gone / ((20.0 - WAVE) * case.speed) - 1.0)}


def goes_on(case: Case, scene: Scene) -> Figures:
    """Return whether a worm still goes at the end."""
    time, mean = _along(scene, simulate(scene))
    late = float(np.diff(np.interp([time[-1] - 8.0, time[-1]], time, mean))[0]) / (8.0 * case.speed)
    return {"late speed off %": 100.0 * abs(late - 1.0), "#stopped": float(late < 0.5)}


def stays(case: Case, scene: Scene) -> Figures:
    """Return how far a worm moves in the last 120 s, and whether it has come to its end."""
    run = simulate(scene)
    late = run["com"][run["time"] > run["time"][-1] - 120.0]
    moved = float(np.linalg.norm(late - late[0], axis=1).max())
    missed = _end_error(run)
    counts = {"#moved on": float(moved > 0.05), "#not there": float(missed > 0.1)}
    return {"moved BL": moved, "end error BL": missed, **counts}


def _end_error(run: Record) -> float:
    found = run.summary["end_error_bl"]
    return np.inf if found is None else float(found)


def quiet(case: Case, scene: Scene) -> Figures:
    """Return what was told of a worm with which nothing is wrong."""
    kinds = _kinds(simulate(scene))
    return {"#faults": float(len(kinds)), **{f"#{kind}": 1.0 for kind in kinds}}


def named(case: Case, scene: Scene) -> Figures:
    """Return whether a fault was named within three waves, and after what time, and what else was."""
    told = simulate(scene).summary.faults
    times = [float(row["time_s"]) - case.begin for row in told if row["kind"] == case.kind]
    kind = "push" if "push.joint=3" in case.overrides else case.kind
    soon = bool(times) and times[0] <= 3.0 * WAVE + 0.3
    early = sum(float(row["time_s"]) < case.begin for row in told)
    counts = {"#before it": float(early), "#others": float(len(told) - len(times))}
    after = {"after s": times[0]} if times else {}
    return {f"#{kind} of": 1.0, f"#{kind} named": float(soon), **counts, **after}


def arrived(case: Case, scene: Scene) -> Figures:
    """Return whether a climber arrived, or says why not."""
    run = simulate(scene)
    there = np.isfinite(_end_error(run))
    return {"#arrived": float(there), "#silent": float(not there and not run.summary.faults)}


METRICS = (
    *("cross_track_rms_bl", "speed_bias_relative", "speed_error_rms_relative", "heading_error_rms_deg"),
    *("settling_periods", "joining_periods", "end_error_bl", "roll_max_deg"),
)


def summarised(case: Case, scene: Scene) -> Figures:
    """Return magnitudes of metrics of the summary, as far as a run has them."""
    run = simulate(scene)
    found = {name: run.summary.metrics.get(name) for name in METRICS}
    return {name: abs(float(value)) for name, value in found.items() if isinstance(value, int | float)}


def normalised(case: Case, scene: Scene) -> Figures:
    """Return normalised estimation errors squared, over their degrees of freedom."""
    known: dict[float, Estimate] = {}
    estimate = Estimator.estimate

    def noted(self: Estimator, t: float) -> Estimate:
        known[round(t, 6)] = found = estimate(self, t)
        return found

    with mock.patch.object(Estimator, "estimate", noted):
        run = simulate(scene)
    squares = [_squares(each, run) for t, each in known.items() if 6.0 <= t <= run["time"][-1] - 2.0]
    whole, place, heading = np.mean(squares, axis=0)
    nis = float(run.summary.metrics["nis_mean"])
    return {"together": whole / 3.0, "place": place / 2.0, "heading": heading, "innovations": nis / 2.0}


def _squares(estimate: Estimate, run: Record) -> tuple[float, float, float]:
    """Return e^T P^-1 e of place and heading together, and of each."""
    time, waves = run["time"], run["waves"]
    now = np.interp(estimate.time, time, waves)
    about = np.linspace(*np.interp([now - 0.5, now + 0.5], waves, time), 51)
    true = (*run["com"][:, :2].T, np.unwrap(run["heading"]))
    e = np.array([*estimate.position, estimate.heading])
    e -= [np.interp(about, time, column).mean() for column in true]
    e[2] = np.mod(e[2] + np.pi, 2.0 * np.pi) - np.pi
    P = estimate.covariance[:3, :3]
    return e @ np.linalg.solve(P, e), e[:2] @ np.linalg.solve(P[:2, :2], e[:2]), e[2] ** 2 / P[2, 2]


def clear(case: Case, scene: Scene) -> Figures:
    """Return the overlap of body and obstacles and the offset from the bare path, and stops before obstacles."""
    run = simulate(scene)
    clearance, offset = float(run.summary["body_clearance_min_bl"]), run.summary["cross_track_max_bl"]
    counts = {f"#{case.kind}": 1.0, "#entered": float(clearance < 0.0), "#blocked": float("blocked" in _kinds(run))}
    return {"overlap BL": -clearance, "offset BL": float(offset or 0.0), **counts}


class Family(NamedTuple):
    """Draws, ways of control, and what is measured."""

    draw: Callable[[int, Generator], Case]
    figures: Callable[[Case, Scene], Figures]
    ways: Sequence[str]
    count: int


FAMILIES = {
    "inner": Family(families.inner, tracked, (MPC, WITHOUT, LOS), 30),
    "slopes": Family(families.slopes, tracked, (MPC, WITHOUT, LOS), 30),
    "lost": Family(families.lost, without_place, (MPC, WITHOUT), 27),
    "paths": Family(families.paths, tracked, (MPC, LOS), 30),
    "errors": Family(families.errors, goes_on, (MPC,), 200),
    "arrivals": Family(families.arrivals, stays, (MPC,), 20),
    "clean": Family(families.clean, quiet, (MPC, LOS, OPEN), 30),
    "faults": Family(families.faults, named, (MPC,), 50),
    "chambers": Family(families.chambers, named, (MPC,), 6),
    "climbs": Family(families.climbs, arrived, (SCENES_OWN,), 20),
    "pipe": Family(families.pipe, summarised, (SCENES_OWN,), len(families.PIPES)),
    "shipped": Family(families.shipped, summarised, (MPC, LOS), len(families.SHIPPED)),
    "estimates": Family(families.estimates, normalised, (MPC,), 8),
    "obstacles": Family(families.obstacles, clear, (MPC,), 20),
}


def drawn(name: str, seed: int) -> Case:
    """Return a draw of a family."""
    return FAMILIES[name].draw(seed, np.random.default_rng([33, seed]))


def measured(task: tuple[str, int, str]) -> Figures:
    """Return the figures of one run: of a family, a seed, and a way of control."""
    name, seed, way = task
    case = drawn(name, seed)
    try:
        scene = load_scene(case.scene, [f"seed={seed}", "controller.map=default", *case.overrides, *WAYS[way]])
    except SceneError:
        return {f"#refused {case.kind}": 1.0}
    return FAMILIES[name].figures(case, scene)


def line(found: Sequence[Figures]) -> str:
    """Return median and worst of figures, and sums of counts."""
    names = dict.fromkeys(name for each in found for name in each)
    parts = []
    for name in names:
        values = [each[name] for each in found if name in each]
        if name.startswith("#"):
            parts.append(f"{name[1:]} {sum(values):.0f}")
        else:
            parts.append(f"{name} {np.median(values):.3g} / {np.max(values):.3g}")
    return "  ".join(parts)


def lines(given: Any) -> Iterator[str]:
    """Yield a line for each family and way of control."""
    for name in given.names:
        family = FAMILIES[name]
        for way in family.ways:
            seeds = range(given.seed, given.seed + (given.count or family.count))
            found = []
            for seed, figures in zip(
                seeds, mapped(measured, [(name, k, way) for k in seeds], given.workers), strict=True
            ):
                found.append(figures)
                if given.each:
                    yield f"{name:9} {way:14} {seed:9}  {line([figures])}"
            yield f"{name:9} {way:14} {len(found):3} draws  {line(found)}"


if __name__ == "__main__":
    for each in lines(options(__doc__, FAMILIES, seed=500, count=0, workers=2, each=False)):
        say(each)
