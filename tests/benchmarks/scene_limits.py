"""Where the scenes of slopes, pipes and terrain stop working: the parameter at which each fails, measured.

    python tests/benchmarks/scene_limits.py

prints the table of `.docs/evidence/validation.md`. From the scene's own value each parameter goes on in equal steps
until the worm fails: it cannot start or end its run, or makes less than `WAY` body lengths a wave, or (bends,
narrowings, tunnels) its tail has not come as far as it should.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from measuring import options, say

import worm3d
from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.models.worm.build import simulate
from scenes.models.worm.schema import WormScene

WAY = 0.06
"""Body lengths a wave, the bar for climbing a vertical pipe."""

Overrides = list[str]


@dataclass(frozen=True)
class Limit:
    """A scene, the parameter that is changed, and by how much at a time."""

    scene: str
    name: str
    begin: float
    step: float
    overrides: Callable[[float], Overrides]
    arrives: Callable[[float], float] | None = None
    """Where the tail has to be in the end, along the pipe [m]."""


def passes(limit: Limit, value: float) -> bool:
    """Return whether the worm does it."""
    try:
        settings = load_scene(limit.scene, limit.overrides(value)).settings
        assert isinstance(settings, WormScene)
        run = simulate(settings, lambda done: True)
    except (SceneError, ValueError):  # it does not even fit
        return False
    if run.status is not worm3d.Status.DONE:
        return False
    if limit.arrives is not None:
        return bool(pipe_of(run).along(run.joints[-1, 0]) >= limit.arrives(value))
    assert run.period is not None
    waves = run.time[-1] / run.period
    return bool(run.distance >= WAY * waves * run.worm.length)


def pipe_of(run: worm3d.Result) -> worm3d.Pipe:
    """Return the pipe that a worm was in, or climbed into."""
    pipe = run.world.worlds[1] if isinstance(run.world, worm3d.Union) else run.world
    assert isinstance(pipe, worm3d.Pipe)
    return pipe


def measured(limit: Limit) -> tuple[float, float | None]:
    """Return the last value that passes, and the first that does not (None: it passes as far as was tried)."""
    last = np.nan
    for k in range(60):
        value = round(limit.begin + k * limit.step, 10)
        if not passes(limit, value):
            return last, value
        last = value
    return last, None


def _key(name: str) -> Callable[[float], Overrides]:
    return lambda value: [f"{name}={value}"]


def _friction(value: float) -> Overrides:
    return [f"friction.backward={value}", f"friction.lateral={value}", f"friction.forward={0.375 * value}"]


def _bend(value: float) -> Overrides:
    bend = f'{{straight_m = 1.0}}, {{bend_deg = 90.0, bend_radius_m = {value}, towards = "left"}}, {{straight_m = 1.5}}'
    return [f"world.pieces=[{bend}]", "run.duration_s=90"]


def _narrowing(value: float) -> Overrides:
    narrow = 0.11 * (1.0 - value / 100.0)
    return [f"world.radii=[{{at_m=1.2, radius_m=0.11}}, {{at_m=1.5, radius_m={narrow}}}]", "run.duration_s=120"]


LIMITS = (
    Limit("slope_5", "slope [deg]", 5.0, 0.5, _key("world.slope_deg")),
    Limit("slope_15", "slope [deg]", 15.0, 1.0, _key("world.slope_deg")),
    Limit("pipe_straight", "tilt [deg]", 0.0, 1.0, _key("world.tilt_deg")),
    Limit("pipe_straight", "radius [m], down", 0.12, -0.0025, _key("world.radius_m")),
    Limit("pipe_bend", "bend radius [m], down", 0.48, -0.03, _bend, lambda r: 1.0 + r * np.pi / 2.0),
    Limit("pipe_narrowing", "narrowing [%]", 20.0, 1.0, _narrowing, lambda value: 1.5),
    Limit("pipe_vertical", "friction, down (forward 0.375 of it)", 0.8, -0.02, _friction),
    Limit("pipe_vertical", "radius [m], up", 0.092, 0.001, _key("world.radius_m")),
    Limit("pipe_vertical", "radius [m], down", 0.092, -0.001, _key("world.radius_m")),
    Limit("pipe_vertical", "mass [kg]", 0.1, 0.1, _key("worm.mass_kg")),
    Limit("slope_into_pipe", "slope [deg]", 10.0, 1.0, _key("world.slope_deg"), lambda value: 0.0),
    Limit("rubble", "stones [m]", 0.03, 0.005, _key("world.height_m")),
    Limit("mesh_tunnel", "amplitude, down", 0.2, -0.01, _key("gait.amplitude")),
)


def table(limits: tuple[Limit, ...] = LIMITS) -> Iterator[str]:
    """Yield the lines of the table."""
    yield "| scene | parameter | works to | fails at |"
    yield "|---|---|---|---|"
    for limit in limits:
        last, first = measured(limit)
        yield f"| `{limit.scene}` | {limit.name} | {last:g} | {'not found' if first is None else f'{first:g}'} |"


if __name__ == "__main__":
    options(__doc__)
    for line in table():
        say(line)
