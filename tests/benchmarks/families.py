"""Families of worms, grounds, paths and faults for `closed_loop.py`: each function returns the draw of a seed."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import obstacle_fields
from numpy.random import Generator

from control.planning.feed_forward import FeedForward
from scenes.models.control.build import identified_of, reference_of
from scenes.models.loading import load_scene
from scenes.studies.bench.control_trials import task_of
from worm3d import Friction, Worm


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


def _worm(seed: int, random: Generator) -> tuple[str, ...]:
    lags = 0.1 * np.exp(random.uniform(np.log(0.5), np.log(3.0), 6))
    springs = 13.0 * random.uniform(0.7, 1.3, 6)
    unequal = "fault.unequal=true", f"fault.unequal_seed={seed}"
    return (*unequal, f"actuator.lag_s={lags.tolist()}", f"worm.spring_N={springs.tolist()}")


def _usual(number: int) -> str:
    return ("path_line", "path_circle", "path_s_curve")[number % 3]


def _slope(random: Generator, up: float, across: float) -> tuple[str, ...]:
    """Return a slope of up to so many degrees; `world.heading_deg` is the azimuth in which it rises."""
    rise, tilt = random.uniform(0.0, up), random.uniform(-across, across)
    azimuth = np.rad2deg(np.arctan2(tilt, rise))
    return f"world.slope_deg={np.hypot(rise, tilt):.3f}", f"world.heading_deg={azimuth:.2f}"


def inner(seed: int, random: Generator) -> Case:
    """Return a worm of unequal, slow and soft chambers."""
    return Case(_usual(seed), (*_worm(seed, random), "run.duration_s=60"))


def slopes(seed: int, random: Generator) -> Case:
    """Return such a worm on a slope."""
    slope = _slope(random, 4.0, 1.5)
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
    task = [each for each in task_of(SMOOTH[seed % 6], random, 0.05) if "speed" not in each]
    path = reference_of(load_scene("path_line", [*task, "controller.map=default"]).settings).path
    assert path is not None
    s = np.linspace(0.0, min(path.length, 8.0), 400)
    reach = float(_able().reach(np.abs(path.curvature(s))).min())
    speed = float(np.round(random.uniform(0.1, 0.95) * reach, 4))
    lasts = float(np.clip(0.9 * path.length / speed, 20.0, 90.0))
    return Case("path_line", (*task, f"reference.speed_m_s={speed}", f"run.duration_s={lasts:.0f}"), speed)


@cache
def _able() -> FeedForward:
    scene: Any = load_scene("path_line", ["controller.map=default"]).settings
    return FeedForward(identified_of(scene).maps["both"], 1.0)


def errors(seed: int, random: Generator) -> Case:
    """Return a short error of the centre of mass."""
    begin, lasts = random.uniform(8.0, 20.0), random.uniform(0.5, 5.0)
    size, axis = random.uniform(0.01, 0.1) * random.choice([-1.0, 1.0]), random.integers(3)
    speed = float(np.round(random.uniform(0.03, 0.12), 3))
    fault = "fault.sensor=true", "fault.sensor_mode=off", f"fault.sensor_component={axis}"
    fault += (
        f"fault.sensor_error={size:.4f}",
        f"fault.sensor_begin_s={begin:.2f}",
        f"fault.sensor_duration_s={lasts:.2f}",
    )
    return Case(_usual(seed), (*fault, f"reference.speed_m_s={speed}", "run.duration_s=40"), speed, begin)


def arrivals(seed: int, random: Generator) -> Case:
    """Return a way with an end, and 120 s of rest there."""
    speed, way = float(np.round(random.uniform(0.05, 0.1), 3)), float(np.round(random.uniform(0.8, 1.6), 2))
    common = f"reference.speed_m_s={speed}", f"run.duration_s={way / speed + 25.0 + 120.0:.0f}", "reference.ends=true"
    if seed % 2:
        bend = f"{{bend_deg={random.uniform(10.0, 40.0):.0f}, bend_radius_m=2.0, towards='left'}}"
        pipe = (
            f"world.pieces=[{{straight_m={0.7 + way:.2f}}}, {bend}]",
            f"world.radius_m={random.uniform(0.12, 0.16):.3f}",
        )
        return Case("velocity_pipe", (*pipe, *common), speed)
    slope = f"world.slope_deg={random.uniform(0.0, 1.5):.2f}", f"world.heading_deg={random.uniform(0.0, 360.0):.0f}"
    return Case("path_line", (f"reference.length_m={way}", *slope, *common), speed)


def clean(seed: int, random: Generator) -> Case:
    """Return a path on which nothing is wrong, at a speed that the path allows.

    The ground slopes by at most 1.7 degrees. On a steeper slope the default worm slides forward by itself, because its
    coefficient of friction is 0.03.
    """
    if seed % 10 < len(SMOOTH):
        case = paths(seed, random)
    else:
        speed = float(np.round(random.uniform(0.02, 0.1), 3))
        task = task_of(("line", "heading", "stop_and_go", "speed_sine")[seed % 10 - len(SMOOTH)], random, speed)
        case = Case("path_line", tuple(task), speed)
    slope = _slope(random, 1.5, 0.7)
    kept = [each for each in case.overrides if not each.startswith("run.duration_s")]
    return Case("path_line", (*kept, *(slope if seed % 2 else ()), "run.duration_s=50"), case.speed)


FAULTS: dict[str, tuple[str, ...]] = {
    "no strains": ("fault.sensor=true", "fault.sensor_channel=strain"),
    "swapped sides": ("fault.sensor=true", "fault.sensor_channel=strain", "fault.sensor_mode=swapped"),
    "push or drift": ("fault.sensor=true", "fault.sensor_mode=drifting"),
    "heading off": (
        "fault.sensor=true",
        "fault.sensor_channel=heading",
        "fault.sensor_mode=off",
        "sensor.heading=true",
    ),
    "push": ("push.joint=3", "push.duration_s=4.0"),
}


def faults(seed: int, random: Generator) -> Case:
    """Return a worm that has a fault from 8 to 16 s on."""
    kind, begin = tuple(FAULTS)[seed % 5], float(np.round(random.uniform(8.0, 16.0), 2))
    speed, side = float(np.round(random.uniform(0.04, 0.12), 3)), random.choice([-1.0, 1.0])
    way = random.uniform(0.0, 2.0 * np.pi)
    given = [*FAULTS[kind], f"reference.speed_m_s={speed}", f"run.duration_s={np.ceil(begin + 6.0):.0f}"]
    if kind == "push":
        given += [f"push.force_N=[{0.07 * np.cos(way):.4f}, {0.07 * np.sin(way):.4f}, 0.0]", f"push.begin_s={begin}"]
    else:
        given += [f"fault.sensor_begin_s={begin}"]
    if kind == "push or drift":
        given += [f"fault.sensor_error={0.02 * side}", f"fault.sensor_component={random.integers(2)}"]
    if kind == "heading off":
        given += [f"fault.sensor_error={0.349 * side}"]
    told = "push or drift" if kind == "push" else kind
    return Case(_usual(seed // 5), tuple(given), speed, begin, told)


def chambers(seed: int, random: Generator) -> Case:
    """Return a worm on a line, one of whose left chambers stays long from 10 s on."""
    segment = seed % 6
    dead = "fault.chamber=true", f"fault.chamber_segment={segment}", "fault.chamber_begin_s=10", "run.duration_s=15"
    return Case("path_line", dead, begin=10.0, kind=f"chamber {segment} left")


def climbs(seed: int, random: Generator) -> Case:
    """Return a slope, and a pipe that rises from it."""
    radius, bend = random.uniform(0.085, 0.1), random.uniform(5.0, 60.0)
    rise = f"{{bend_deg={bend:.1f}, bend_radius_m=1.0, towards='up'}}"
    world = f"world.pieces=[{{straight_m=0.7}}, {rise}, {{straight_m=1.0}}]", _narrow(f"{radius:.4f}")
    friction = _friction(random.uniform(0.2, 0.5), 2.5)
    return Case("pipe_climb_controlled", (*world, *friction, "run.duration_s=90"), 0.06)


def _narrow(radius: str) -> str:
    return f"world.radii=[{{at_m=0.0, radius_m=0.13}}, {{at_m=0.15, radius_m=0.13}}, {{at_m=0.5, radius_m={radius}}}]"


def _friction(forward: float, ratio: float) -> tuple[str, ...]:
    other = f"{ratio * forward:.3f}"
    return f"friction.forward={forward:.3f}", f"friction.backward={other}", f"friction.lateral={other}"


RISING_BEND = (
    "world.pieces=[{straight_m=1.0}, {bend_deg=4.0, bend_radius_m=8.0, towards='up'}, "
    "{bend_deg=45.0, bend_radius_m=2.0, towards='left'}, {straight_m=3.0}]"
)
PIPES: dict[str, tuple[str, ...]] = {
    "velocity_pipe": (),
    "velocity_pipe, rising bend": (RISING_BEND,),
    "pipe_climb_controlled": (),
    "pipe_climb_controlled, slope 6 deg": ("world.slope_deg=6",),
    "pipe_climb_controlled, slope 10 deg": ("world.slope_deg=10",),
    "pipe_climb_controlled, radius 83 mm": (_narrow("0.083"), "run.duration_s=90"),
    "pipe_climb_controlled, radius 101 mm": (_narrow("0.101"),),
    "pipe_climb_controlled, friction 0.8": _friction(0.24, 0.8 / 0.3),
    "pipe_climb_controlled, friction 1.2": _friction(0.36, 0.8 / 0.3),
}


def pipe(seed: int, random: Generator) -> Case:
    """Return a shipped scene in a pipe, or a variation."""
    return _one_of(PIPES, seed)


# The line passes 0.2 m to the right of the worm's middle at (0.5, 0), 0.5 rad to the right of where the worm looks.
APART = ("reference.start_m=[0.40411, -0.17552]", "reference.azimuth_deg=-28.648", "run.duration_s=30")
SIDE_SLOPE = ("world.slope_deg=2", "world.heading_deg=90")
CORNER = "reference.points=[{x_m=0.5, y_m=0.0}, {x_m=2.0, y_m=0.0}, {x_m=2.0, y_m=3.0}]"
SHIPPED: dict[str, tuple[str, ...]] = {
    "path_line": (),
    "path_line, uphill": ("world.slope_deg=3.0",),
    "path_line, apart": APART,
    "path_line, side slope": SIDE_SLOPE,
    "path_line, side slope, heading": (*SIDE_SLOPE, "sensor.heading=true"),
    "velocity_step": (),
    "path_circle": ("reference.radius_m=1.5",),
    "path_circle, sharp": ("reference.radius_m=0.4",),
    "path_circle, slope": ("reference.radius_m=0.5", "world.slope_deg=4", "start.azimuth_deg=-90", "run.duration_s=20"),
    "path_s_curve": (),
    "path_s_curve, slow": ("reference.speed_m_s=0.02",),
    "path_s_curve, fast": ("reference.speed_m_s=0.14",),
    "path_s_curve, noise": ("sensor.com_noise_m=0.03",),
    "path_s_curve, planner out": ("fault.planner=true", "fault.planner_begin_s=20", "fault.planner_duration_s=8"),
    "path_waypoints, corner": (CORNER, "reference.radius_m=0.02", "run.duration_s=45"),
    "disturbance_push": (),
}


def shipped(seed: int, random: Generator) -> Case:
    """Return a shipped scene with a task, or a variation."""
    return _one_of(SHIPPED, seed)


def _one_of(scenes: dict[str, tuple[str, ...]], seed: int) -> Case:
    name = tuple(scenes)[seed % len(scenes)]
    return Case(name.partition(",")[0], (*scenes[name], "controller.map=own"))


def estimates(seed: int, random: Generator) -> Case:
    """Return a worm on an S-curve with its own mass (+-20 %), springs and friction (+-30 %), and noise."""
    worm, ground = Worm(), Friction()
    usual = {"worm.spring_N": float(np.mean(worm.k_spring)), "friction.forward": ground.forward}
    usual |= {"friction.backward": ground.backward, "friction.lateral": ground.lateral}
    changed = [f"{key}={value * random.uniform(0.7, 1.3):.5g}" for key, value in usual.items()]
    mass = f"worm.mass_kg={worm.mass * random.uniform(0.8, 1.2):.5g}"
    noise = f"sensor.com_noise_m={np.exp(random.uniform(np.log(0.002), np.log(0.02))):.5g}"
    return Case("path_s_curve", (*changed, mass, noise, "controller.map=nearby", "run.duration_s=30"))


def obstacles(seed: int, random: Generator) -> Case:
    """Return a field of obstacles; whether it has a way is its kind."""
    field = obstacle_fields.field(seed)
    kind = "with a way" if obstacle_fields.solvable(field) else "without a way"
    return Case(field.scene, tuple(field.overrides), kind=kind)
