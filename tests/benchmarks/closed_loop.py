"""The closed loop on families of worms, grounds, paths and faults that are drawn by a seed.

    python tests/benchmarks/closed_loop.py [FAMILY ...] [--seed 500] [--count N] [--workers 2]

Every run has `controller.map=default`, so that the controller knows the default worm only. For each family and each way
of control a line has the median and the worst of each figure over the draws, and the sums of counts:

    inner     six unequal chambers on each side (gains 0.6 to 1.1), lags 0.5 to 3 times and springs 0.7 to 1.3 times the
              default ones; line, circle and S-curve at 0.08 m/s
    slopes    such worms up to 4 degrees up and 1.5 across
    lost      such worms; the centre of mass is lost for 20 s, measured once a second, or measured 0.5 s late
    paths     curves, eights, spirals, squares with round corners, at 10 to 95 % of the speed that they allow
    errors    the centre of mass is off by 1 to 10 cm for 0.5 to 5 s
    arrivals  a line or a pipe with an end, and 120 s of rest there
    clean     paths on level ground and slopes up to 2 degrees, on which nothing is wrong
    faults    strains lost or swapped, drift of the centre of mass, heading off, a push, from 8 to 16 s on
    climbs    a slope, and a pipe that rises from it, by tilt, radius and friction

Figures: bias of the speed, and the same over the first six waves after one and a half [%]; waves until the speed of
three waves stays within 5 %; rms offset from the path [body lengths]; work of the actuators [J].
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator

from control.planning.feed_forward import FeedForward
from scenes.models.control.build import identified_of, reference_of
from scenes.models.loading import load_scene
from scenes.records.record import Record
from scenes.running.runner import simulate
from scenes.studies.bench.control_trials import CLASSES
from worm3d.values.arrays import FloatArray

WAVE = 1.25
"""Period of the default worm's wave [s]."""
MPC, WITHOUT, LOS = ("controller.kind=mpc",), ("controller.kind=mpc", "controller.inner_loop=false"), (
    "controller.kind=pi_los",
)  # fmt: skip
WAYS = {"mpc": MPC, "no inner loop": WITHOUT, "line-of-sight": LOS}
Figures = dict[str, float]


class Case(NamedTuple):
    """One draw of a family."""

    scene: str
    overrides: tuple[str, ...]
    speed: float = 0.08
    """Speed asked for [m/s]."""
    begin: float = 0.0
    """Time when its fault begins [s]."""
    kind: str = ""
    """Name of the fault that is to be told; where the draws are of several kinds, which one."""


class Family(NamedTuple):
    """Draws, ways of control, and what is measured."""

    draw: Callable[[int, Generator], Case]
    figures: Callable[[Case, Any, Record], Figures]
    ways: Mapping[str, Sequence[str]]
    count: int


# --- draws


def _worm(seed: int, random: Generator) -> tuple[str, ...]:
    lags = 0.1 * np.exp(random.uniform(np.log(0.5), np.log(3.0), 6))
    springs = 13.0 * random.uniform(0.7, 1.3, 6)
    unequal = "fault.unequal=true", f"fault.unequal_seed={seed}"
    return (*unequal, f"actuator.lag_s={lags.tolist()}", f"worm.spring_N={springs.tolist()}")


def _usual(number: int) -> str:
    return ("path_line", "path_circle", "path_s_curve")[number % 3]


def inner(seed: int, random: Generator) -> Case:
    """Return a worm of unequal, slow and soft chambers."""
    return Case(_usual(seed), (*_worm(seed, random), "run.duration_s=60"))


def slopes(seed: int, random: Generator) -> Case:
    """Return such a worm on a slope, `world.heading_deg` being the azimuth in which it rises."""
    up, across = random.uniform(0.0, 4.0), random.uniform(-1.5, 1.5)
    slope = f"world.slope_deg={np.hypot(up, across):.3f}", f"world.heading_deg={np.rad2deg(np.arctan2(across, up)):.2f}"
    return Case("path_line", (*_worm(seed, random), *slope, "run.duration_s=60"))


LOST = {
    "lost": ("fault.sensor=true", "fault.sensor_begin_s=20", "fault.sensor_duration_s=20"),
    "1 Hz": ("sensor.com_rate_Hz=1",),
    "late": ("sensor.com_delay_s=0.5",),
}


def lost(seed: int, random: Generator) -> Case:
    """Return such a worm whose centre of mass is lost, rare or late."""
    kind = tuple(LOST)[seed // 3 % 3]
    return Case(_usual(seed), (*_worm(seed, random), *LOST[kind], "run.duration_s=60"), kind=kind, begin=20.0)


SMOOTH = ("s_curve", "circle", "eight", "spiral", "square", "waypoints")


def paths(seed: int, random: Generator) -> Case:
    """Return a path at a share of the speed at which its sharpest bend can be followed."""
    task = [each for each in CLASSES[SMOOTH[seed % 6]](random, 0.05) if "speed" not in each]
    path = reference_of(load_scene("path_line", [*task, "controller.map=default"]).settings).path
    assert path is not None
    s = np.linspace(0.0, min(path.length, 8.0), 400)
    reach = float(_able().reach(np.abs(path.curvature(s))).min())
    speed = float(np.round(random.uniform(0.1, 0.95) * reach, 4))
    lasts = float(np.clip(0.9 * path.length / speed, 20.0, 90.0))
    return Case("path_line", (*task, f"reference.speed_m_s={speed}", f"run.duration_s={lasts:.0f}"), speed)


def _able() -> FeedForward:
    scene: Any = load_scene("path_line", ["controller.map=default"]).settings
    return FeedForward(identified_of(scene).maps["both"], 1.0)


def errors(seed: int, random: Generator) -> Case:
    """Return a short error of the centre of mass."""
    begin, lasts = random.uniform(8.0, 20.0), random.uniform(0.5, 5.0)
    size, axis = random.uniform(0.01, 0.1) * random.choice([-1.0, 1.0]), random.integers(3)
    speed = float(np.round(random.uniform(0.03, 0.12), 3))
    fault = ("fault.sensor=true", "fault.sensor_mode=off", f"fault.sensor_component={axis}",
             f"fault.sensor_error={size:.4f}", f"fault.sensor_begin_s={begin:.2f}",
             f"fault.sensor_duration_s={lasts:.2f}")  # fmt: skip
    return Case(_usual(seed), (*fault, f"reference.speed_m_s={speed}", "run.duration_s=40"), speed, begin)


REST = 120.0


def arrivals(seed: int, random: Generator) -> Case:
    """Return a way with an end."""
    speed, way = float(np.round(random.uniform(0.05, 0.1), 3)), float(np.round(random.uniform(0.8, 1.6), 2))
    lasts = f"run.duration_s={way / speed + 25.0 + REST:.0f}"
    if seed % 2:
        bend = f"{{bend_deg={random.uniform(10.0, 40.0):.0f}, bend_radius_m=2.0, towards='left'}}"
        world = (
            f"world.pieces=[{{straight_m={0.7 + way:.2f}}}, {bend}]",
            f"world.radius_m={random.uniform(0.12, 0.16):.3f}",
        )
        return Case("velocity_pipe", ("reference.ends=true", *world, f"reference.speed_m_s={speed}", lasts), speed)
    slope = f"world.slope_deg={random.uniform(0.0, 1.5):.2f}", f"world.heading_deg={random.uniform(0.0, 360.0):.0f}"
    end = "reference.ends=true", f"reference.length_m={way}"
    return Case("path_line", (*end, *slope, f"reference.speed_m_s={speed}", lasts), speed)


def clean(seed: int, random: Generator) -> Case:
    """Return a path on which nothing is wrong, at a speed that the path allows."""
    if seed % 10 < len(SMOOTH):
        case = paths(seed, random)
    else:
        speed = float(np.round(random.uniform(0.02, 0.1), 3))
        task = CLASSES[("line", "heading", "stop_and_go", "speed_sine")[seed % 10 - len(SMOOTH)]](random, speed)
        case = Case("path_line", tuple(task), speed)
    up, across = random.uniform(0.0, 2.0), random.uniform(-1.0, 1.0)
    slope = (
        f"world.slope_deg={np.hypot(up, across):.3f}",
        f"world.heading_deg={np.rad2deg(np.arctan2(across, up)):.2f}",
    )
    task = [each for each in case.overrides if not each.startswith("run.duration_s")]
    return Case("path_line", (*task, *(slope if seed % 2 else ()), "run.duration_s=50"), case.speed)


SENSOR = ("fault.sensor=true",)
FAULTS: dict[str, tuple[str, ...]] = {
    "no strains": (*SENSOR, "fault.sensor_channel=strain"),
    "swapped sides": (*SENSOR, "fault.sensor_channel=strain", "fault.sensor_mode=swapped"),
    "push or drift": (*SENSOR, "fault.sensor_mode=drifting"),
    "heading off": ("sensor.heading=true", *SENSOR, "fault.sensor_channel=heading", "fault.sensor_mode=off"),
    "push": (),
}


def faults(seed: int, random: Generator) -> Case:
    """Return a worm that has a fault from 8 to 16 s on."""
    kind, begin = tuple(FAULTS)[seed % 5], float(np.round(random.uniform(8.0, 16.0), 2))
    speed, side = float(np.round(random.uniform(0.04, 0.12), 3)), random.choice([-1.0, 1.0])
    way = random.uniform(0.0, 2.0 * np.pi)
    begins = (f"fault.sensor_begin_s={begin}",) if kind != "push" else (
        "push.joint=3", f"push.force_N=[{0.07 * np.cos(way):.4f}, {0.07 * np.sin(way):.4f}, 0.0]",
        f"push.begin_s={begin}", "push.duration_s=4.0")  # fmt: skip
    size = {"push or drift": 0.02, "heading off": 0.349}.get(kind)
    sized = () if size is None else (f"fault.sensor_error={size * side}",)
    sized += (f"fault.sensor_component={random.integers(2)}",) if kind == "push or drift" else ()
    common = f"reference.speed_m_s={speed}", f"run.duration_s={np.ceil(begin + 6.0):.0f}"
    told = "push or drift" if kind == "push" else kind
    return Case(_usual(seed // 5), (*FAULTS[kind], *begins, *sized, *common), speed, begin, told)


def climbs(seed: int, random: Generator) -> Case:
    """Return a slope, and a pipe that rises from it."""
    radius, bend = random.uniform(0.085, 0.1), random.uniform(5.0, 60.0)
    rise = f"{{bend_deg={bend:.1f}, bend_radius_m=1.0, towards='up'}}"
    narrow = ", ".join(f"{{at_m={at}, radius_m={r:.4f}}}" for at, r in ((0.0, 0.13), (0.15, 0.13), (0.5, radius)))
    world = f"world.pieces=[{{straight_m=0.7}}, {rise}, {{straight_m=1.0}}]", f"world.radii=[{narrow}]"
    rough = random.uniform(0.2, 0.5)
    friction = (
        f"friction.forward={rough:.3f}",
        f"friction.backward={2.5 * rough:.3f}",
        f"friction.lateral={2.5 * rough:.3f}",
    )
    return Case("pipe_climb_controlled", (*world, *friction, "run.duration_s=90"), 0.06)


# --- figures


def _along(scene: Any, run: Record) -> tuple[FloatArray, FloatArray]:
    """Return times, and ways along the path averaged over a wave."""
    path, near, along = reference_of(scene.settings).path, None, []
    assert path is not None
    for place in run["com"][:, :2]:
        near = float(path.project(place, near))
        along.append(near)
    time = np.arange(0.0, run["time"][-1], WAVE / 20.0)
    mean = np.convolve(np.interp(time, run["time"], along), np.full(20, 0.05), "valid")
    return time[: len(mean)] + 9.5 * WAVE / 20.0, mean


def tracked(case: Case, scene: Any, run: Record) -> Figures:
    """Return how a run kept its speed and path."""
    time, mean = _along(scene, run)
    first = float(np.diff(np.interp([1.5 * WAVE, 7.5 * WAVE], time, mean))[0]) / (6.0 * WAVE * case.speed) - 1.0
    off = np.abs((mean[60:] - mean[:-60]) / (3.0 * WAVE * case.speed) - 1.0) > 0.05
    last = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
    bias = float(run.summary["speed_bias_relative"])
    told = [str(row["advice"]) for row in run.summary.faults]
    return {
        "bias %": 100.0 * abs(bias),
        "bias mm/s": 1e3 * abs(bias) * case.speed,
        "first %": 100.0 * abs(first),
        "settled": np.inf if last == len(off) else last / 20.0,
        "offset BL": float(run.summary["cross_track_rms_bl"]),
        "work J": float(run.summary["work_contract_J"]),
        "#fallen": float("on its side" in _kinds(run)),
        "#held": float(any("held still" in each for each in told)),
    }


def _kinds(run: Record) -> list[str]:
    return [str(row["kind"]) for row in run.summary.faults]


def without_place(case: Case, scene: Any, run: Record) -> Figures:
    """Return the speed while the centre of mass is lost, and the offset where it is rare or late."""
    time, mean = _along(scene, run)
    gone = float(np.diff(np.interp([case.begin + WAVE, case.begin + 20.0], time, mean))[0])
    lost = 100.0 * abs(gone / ((20.0 - WAVE) * case.speed) - 1.0)
    name = {"lost": ("speed while lost %", lost)}.get(case.kind)
    key, value = name or (f"offset {case.kind} BL", float(run.summary["cross_track_rms_bl"]))
    return {key: value}


def goes_on(case: Case, scene: Any, run: Record) -> Figures:
    """Return whether a worm still goes at the end."""
    time, mean = _along(scene, run)
    late = float(np.diff(np.interp([time[-1] - 8.0, time[-1]], time, mean))[0]) / (8.0 * case.speed)
    return {"late speed off %": 100.0 * abs(late - 1.0), "#stopped": float(late < 0.5)}


def stays(case: Case, scene: Any, run: Record) -> Figures:
    """Return how far a worm moves in the last 120 s, and whether it has come to its end."""
    late = run["com"][run["time"] > run["time"][-1] - REST]
    moved = float(np.linalg.norm(late - late[0], axis=1).max())
    missed = _end_error(run)
    return {
        "moved BL": moved,
        "end error BL": missed,
        "#moved on": float(moved > 0.05),
        "#not there": float(missed > 0.1),
    }


def _end_error(run: Record) -> float:
    found = run.summary["end_error_bl"]
    return np.inf if found is None else float(found)  # type: ignore[arg-type]


def quiet(case: Case, scene: Any, run: Record) -> Figures:
    """Return what was told of a worm with which nothing is wrong."""
    return {"#faults": float(len(run.summary.faults)), **{f"#{kind}": 1.0 for kind in _kinds(run)}}


def named(case: Case, scene: Any, run: Record) -> Figures:
    """Return whether a fault was named within three waves, and what else was."""
    first = next((row for row in run.summary.faults if row["kind"] == case.kind), None)
    kind = "push" if "push.joint=3" in case.overrides else case.kind
    soon = first is not None and float(first["time_s"]) - case.begin <= 3.0 * WAVE + 0.3
    early = [row for row in run.summary.faults if float(row["time_s"]) < case.begin]
    return {f"#{kind} of": 1.0, f"#{kind} named": float(soon), "#before it": float(len(early))}


def arrived(case: Case, scene: Any, run: Record) -> Figures:
    """Return whether a climber arrived, or says why not."""
    there = np.isfinite(_end_error(run))
    return {"#arrived": float(there), "#silent": float(not there and not run.summary.faults)}


BOTH = {name: WAYS[name] for name in ("mpc", "no inner loop")}
FAMILIES = {
    "inner": Family(inner, tracked, WAYS, 30),
    "slopes": Family(slopes, tracked, WAYS, 30),
    "lost": Family(lost, without_place, BOTH, 27),
    "paths": Family(paths, tracked, {"mpc": MPC, "line-of-sight": LOS}, 30),
    "errors": Family(errors, goes_on, {"mpc": MPC}, 200),
    "arrivals": Family(arrivals, stays, {"mpc": MPC}, 20),
    "clean": Family(clean, quiet, {"mpc": MPC, "line-of-sight": LOS, "open loop": ("controller.kind=open_loop",)}, 30),
    "faults": Family(faults, named, {"mpc": MPC}, 50),
    "climbs": Family(climbs, arrived, {"climber": ()}, 20),
}


def measured(task: tuple[str, int, str]) -> Figures:
    """Return the figures of one run."""
    name, seed, way = task
    family = FAMILIES[name]
    case = family.draw(seed, np.random.default_rng([33, seed]))
    scene = load_scene(case.scene, [*case.overrides, f"seed={seed}", "controller.map=default", *family.ways[way]])
    return family.figures(case, scene, simulate(scene))


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


def lines(names: Sequence[str], seed: int, count: int | None, workers: int) -> Iterator[str]:
    """Yield a line for each family and way of control."""
    with get_context("spawn").Pool(workers) as pool:
        for name in names:
            family = FAMILIES[name]
            for way in family.ways:
                seeds = range(seed, seed + (count or family.count))
                found = pool.map(measured, [(name, each, way) for each in seeds], chunksize=1)
                yield f"{name:9} {way:14} {len(found):3} draws  {line(found)}"


def main() -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("family", nargs="*", default=[], help=f"one of {', '.join(FAMILIES)}; all by default")
    parser.add_argument("--seed", type=int, default=500)
    parser.add_argument("--count", type=int)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    for name in given.family:
        if name not in FAMILIES:
            parser.error(f"FAMILY: got {name!r}, must be one of {', '.join(FAMILIES)}")
    for each in lines(given.family or tuple(FAMILIES), given.seed, given.count, given.workers):
        sys.stdout.write(each + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
