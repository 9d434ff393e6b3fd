"""The section [reference] of a scene: its keys, and the desired speed, path, heading and obstacles made from it.

To add a kind of path, write a class in `control.tracking.paths`, and add a name, its keys and an entry of `MAKERS`
here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, Literal

import numpy as np

import worm3d
from control.parts import OBSTACLE, PATH_KIND
from control.tracking.obstacles import OBSTACLES
from control.tracking.paths import Circle, Line, Path, PlanView, SCurve, SplinePath, WayPoints
from control.tracking.references import Constant, Profile, Sine, Steps
from control.tracking.references import Reference as Task
from scenes.language.parts import PartSection, chosen, keys_of, part_named
from scenes.language.schema import OWN_KINDS, Pair, Section, Tables, part_key, setting
from scenes.models.worlds.build import world_of
from scenes.models.worm.build import start_of, worm_of
from worm3d.values import named
from worm3d.values.arrays import FloatArray

HEADING_KIND, LINE, CIRCLE, S_CURVE, SPLINE, WAY_POINTS = "heading", "line", "circle", "s_curve", "spline", "way_points"
BEGUN = (LINE, CIRCLE, S_CURVE)
"""Kinds of paths that are defined by a start and an initial direction."""


class SpeedStep(Section):
    """Step of the desired speed."""

    at_s: float = setting(unit="s", gt=0, meaning="when")
    speed_m_s: float = setting(unit="m/s", meaning="speed from then on, below 0 backwards")


class HeadingStep(Section):
    """Step of the desired heading."""

    at_s: float = setting(unit="s", gt=0, meaning="when")
    heading_deg: float = setting(unit="deg", meaning="heading from then on")


class Obstacle(PartSection, holds={"kind": OBSTACLE}, keys=partial(chosen, meaning="shape of the obstacle")):
    """Obstacle on the ground that the worm avoids."""


class Point(Section):
    """A point of a path."""

    x_m: float = setting(unit="m", meaning="x")
    y_m: float = setting(unit="m", meaning="y")


ENDING = (LINE, S_CURVE, SPLINE, WAY_POINTS, "pipe", OWN_KINDS)
"""Kinds of paths that may have an end."""
PATHS = (*ENDING, CIRCLE)
REFERENCE_KINDS = (*(kind for kind in PATHS if kind != OWN_KINDS), HEADING_KIND, "none")
KIND = part_key(
    REFERENCE_KINDS,
    meaning="reference to follow: a path, such as the centre line of the pipe, a heading, or nothing",
    aka=("path", "type"),
)


class Reference(PartSection, keys={"kind": KIND}, holds={"kind": PATH_KIND}):
    """Task of the worm: the desired speed, and the path or heading."""

    speed_m_s: float = setting(0.08, unit="m/s", meaning="speed forward, at first; below 0 backwards")
    speed_steps: Tables[SpeedStep] = setting((), meaning="steps of the speed, each a table of at_s and speed_m_s")
    speed_sine_m_s: float = setting(0.0, unit="m/s", ge=0, meaning="amplitude of a sine that is added to the speed")
    speed_sine_period_s: float = setting(20.0, unit="s", gt=0, meaning="its period")
    heading_deg: float = setting(0.0, unit="deg", only=HEADING_KIND, meaning="at first")
    heading_steps: Tables[HeadingStep] = setting(
        (), only=HEADING_KIND, meaning="steps of the heading, each a table of at_s and heading_deg"
    )
    start_m: Pair | None = setting(
        unit="m", only=BEGUN, left_out="the middle of the worm as it starts", meaning="where the path begins: x, y"
    )
    azimuth_deg: float | None = setting(
        unit="deg",
        only=BEGUN,
        left_out="where the worm looks as it starts",
        meaning="direction of the path at the start",
    )
    length_m: float | None = setting(unit="m", gt=0, only=LINE, left_out="without end", meaning="length of the line")
    ends: bool = setting(False, only=ENDING, meaning="whether the worm stops at the end of the path and stays there")
    corridor_m: float | None = setting(
        unit="m", gt=0, only=PATHS, left_out="any", meaning="how far the middle may go to either side of the path"
    )
    obstacles: Tables[Obstacle] = setting(
        (),
        only=PATHS,
        meaning="obstacles, each a table: "
        + "; ".join(f'kind = "{name}" with {", ".join(keys_of(each))}' for name, each in OBSTACLES.items()),
    )
    radius_m: float = setting(
        1.5, unit="m", gt=0, only=(CIRCLE, WAY_POINTS), meaning="radius, or radius of the corners"
    )
    towards: Literal["left", "right"] = setting("left", only=(CIRCLE, S_CURVE), meaning="side of the first turn")
    amplitude_m: float = setting(0.4, unit="m", gt=0, only=S_CURVE, meaning="amplitude of the sine")
    wavelength_m: float = setting(4.0, unit="m", gt=0, only=S_CURVE, meaning="wavelength of the sine")
    points: Tables[Point] = setting(
        (), only=(SPLINE, WAY_POINTS), meaning="points of the path, each a table of x_m and y_m"
    )
    closed: bool = setting(False, only=SPLINE, meaning="whether the curve continues from the last point to the first")


def reference_of(scene: Any) -> Task:
    """Return the task of the worm."""
    return reference_along(scene, path_of(scene))


def reference_along(scene: Any, path: Path | None) -> Task:
    """Return the task of the worm for a given path."""
    asked = scene.reference
    heading = None
    if asked.kind == "heading":
        steps = [(step.at_s, math.radians(step.heading_deg)) for step in asked.heading_steps]
        heading = _profile(math.radians(asked.heading_deg), steps)
    return Task(
        speed_of(asked),
        heading,
        path,
        ends=asked.ends,
        corridor=math.inf if asked.corridor_m is None else asked.corridor_m,
        obstacles=tuple(part_named(OBSTACLE, each.kind, each) for each in asked.obstacles),
        walled=asked.kind == "pipe" and scene.world.kind == "pipe",
    )


def speed_of(asked: Reference) -> Profile:
    """Return the desired speed over time."""
    if asked.speed_sine_m_s > 0.0:
        return Sine(asked.speed_m_s, asked.speed_sine_m_s, asked.speed_sine_period_s)
    return _profile(asked.speed_m_s, [(step.at_s, step.speed_m_s) for step in asked.speed_steps])


def _profile(first: float, steps: list[tuple[float, float]]) -> Profile:
    if not steps:
        return Constant(first)
    times, values = zip(*steps, strict=True)
    return Steps(first, times, values)


def path_of(scene: Any) -> Path | None:
    """Return the path, or None if the reference has no path; raise ValueError if the path is impossible."""
    kind = scene.reference.kind
    if named.is_own(kind):
        path: Path = part_named(PATH_KIND, kind, scene.reference)
        return path
    make = MAKERS.get(kind)
    return None if make is None else make(scene)


def _s_curve(scene: Any) -> Path:
    asked, (start, azimuth) = scene.reference, _begin(scene)
    waves = math.ceil(2.0 * _farthest(scene) / asked.wavelength_m) / 2.0
    return SCurve(asked.amplitude_m, asked.wavelength_m, max(waves, 0.5), start, azimuth, asked.towards)


def _pipe(scene: Any) -> Path:
    world = world_of(scene.world)
    worlds = world.worlds if isinstance(world, worm3d.Union) else (world,)
    pipe = next((each for each in worlds if isinstance(each, worm3d.Pipe)), None)
    if pipe is None:
        raise ValueError(f"kind: got 'pipe' in a world of kind '{scene.world.kind}', must be in one with a pipe")
    return PlanView(pipe.centreline)


MAKERS: dict[str, Callable[[Any], Path]] = {
    "line": lambda scene: Line(*_begin(scene), scene.reference.length_m or math.inf),
    "circle": lambda scene: Circle(scene.reference.radius_m, *_begin(scene), scene.reference.towards),
    "s_curve": _s_curve,
    "spline": lambda scene: SplinePath(_points(scene), scene.reference.closed),
    "way_points": lambda scene: WayPoints(_points(scene), scene.reference.radius_m),
    "pipe": _pipe,
}
"""Function that returns the path of a scene, for each shipped kind of reference with a path."""


def _begin(scene: Any) -> tuple[tuple[float, float], float]:
    """Return the start of a path [m] and its direction there [rad].

    By default the path starts at the middle of the worm, in the direction of the worm.
    """
    asked = scene.reference
    azimuth = scene.start.azimuth_deg if asked.azimuth_deg is None else asked.azimuth_deg
    x, y = middle_of(scene) if asked.start_m is None else asked.start_m
    return (float(x), float(y)), math.radians(azimuth)


def middle_of(scene: Any) -> tuple[float, float]:
    """Return the initial position of the middle of the worm [m]."""
    x, y, _ = start_of(scene, worm_of(scene), world_of(scene.world)).joints[[0, -1]].mean(axis=0)
    return float(x), float(y)


def _points(scene: Any) -> FloatArray:
    return np.array([(point.x_m, point.y_m) for point in scene.reference.points]).reshape(-1, 2)


def _farthest(scene: Any) -> float:
    """Return the largest distance that the worm covers at the desired speed, plus one body length [m]."""
    speeds = speeds_of(scene)
    return float(max(np.cumsum(speeds).max(), 0.0) / len(speeds) * scene.run.duration_s + scene.worm.length_m)


def speeds_of(scene: Any) -> FloatArray:
    """Return the desired speeds during a run, at equally spaced instants [m/s]."""
    return np.asarray(speed_of(scene.reference)(np.linspace(0.0, scene.run.duration_s, 1001)), dtype=float)
