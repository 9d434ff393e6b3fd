"""Construction of the 3D worm, its world, gait and run from the settings of a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import worm3d
from control.gaits import Gait, RecordedCommands
from control.gaits.reflexive import Reflexive
from control.parts import ACTUATOR, GAIT, HYSTERESIS, LAW_KIND, LOAD_KIND, MEASURE, MEDIUM_KIND, REFLEX, SEGMENT_KIND
from control.sensing.sensors import Channel, Sensors
from planar.linkage import Linkage
from scenes.language.errors import SceneError
from scenes.language.loader import file_named
from scenes.language.parts import class_named, keys_by_parameter, part_named, part_of, values_of
from scenes.models.base import Observer
from scenes.models.checks import in_keys
from scenes.models.sections import gait_from
from scenes.models.sensors import channels_of
from scenes.models.switched import switched_parts
from scenes.models.worlds.build import world_of
from scenes.models.worm.schema import (
    NO_RECORD,
    AimedStart,
    AnyWormScene,
    GaitScene,
    PlanarWormScene,
    Push,
    Start,
    Worm,
)
from scenes.records import measured
from worm3d.measures import MEASURES, Measure
from worm3d.physics.segment_laws.file import INPUT_UNITS
from worm3d.running import run as runs
from worm3d.running.accuracy import begin
from worm3d.running.actuation import Actuation, Sensor
from worm3d.running.problem import Problem
from worm3d.values import named
from worm3d.values.named import Kind, declared

WORM_KEYS = keys_by_parameter(worm3d.Worm, Worm)
"""Key of each parameter of `worm3d.Worm` in the section [worm]."""

PARTS = {
    "actuator": ACTUATOR,
    "hinge_actuator": ACTUATOR,
    "hysteresis": HYSTERESIS,
    "medium": MEDIUM_KIND,
    "load": LOAD_KIND,
    "segment": SEGMENT_KIND,
}
"""Kind of the part that a section of the scene describes, by the name of the section.

The parameter of `worm3d.Worm` for the part has the same name.
"""

Force = Callable[[float], NDArray[np.float64]]

Drive = tuple[Actuation | None, Sensor | None]


def simulate(
    scene: AnyWormScene,
    observer: Observer,
    state: worm3d.State | None = None,
    done: int = 0,
    live: worm3d.Live | None = None,
    drive: Drive | None = None,
) -> worm3d.Result:
    """Simulate the worm of a scene to the end of the scene.

    Parameters
    ----------
    scene
        The scene; its gait drives the worm.
    observer : callable
        Function that is called with the number of finished steps. If it returns False, the run ends.
    state : worm3d.State, optional
        State to continue from; the start of the scene if left out.
    done : int
        Number of steps before `state`.
    live : worm3d.Live, optional
        Page that shows the run in a browser.
    drive : tuple, optional
        A controller and a sensor, which replace the gait.

    Raises
    ------
    SceneError
        If the weight would flatten the worm, or the state does not belong to this worm. The checks of scenes cannot
        detect these errors.
    ValueError
        If the parameters of the worm are invalid.
    """
    try:
        problem = problem_of(scene, state, done, drive)
        # Without a controller, the observer is called about every 50 steps, and only at stored states. A run that
        # ends between two stored states could not be continued without a gap in the record.
        rows = 1 if drive is not None else max(1, 50 // problem.record_every)
        looks = runs.Observer(lambda run: run.done == 0 or observer(run.done), rows * problem.record_every)

        def observers(run: runs.Run) -> list[runs.Observer]:
            return [looks] if live is None else [live.follow(run), looks]

        return begin(problem, observed=observers, checked=[looks])()
    except (worm3d.StateError, worm3d.LimitPointError) as error:
        raise SceneError(in_keys(str(error), WORM_KEYS)) from error


def problem_of(
    scene: AnyWormScene, state: worm3d.State | None = None, done: int = 0, drive: Drive | None = None
) -> Problem:
    """Return the problem that the solver gets for a scene. The parameters are the same as in `simulate`."""
    worm, world, run = worm_of(scene), world_of(scene.world), scene.run
    actuation, sensor = (gait_of(scene), sensor_of(scene)) if drive is None else drive
    return Problem(
        worm=worm,
        world=world,
        ground=friction_of(scene),
        actuation=actuation,
        duration=(run.steps - done) * run.dt_s,
        dt=run.dt_s,
        integrator=run.integrator,
        gravity=gravity_of(scene),
        external_force=force_of(scene.push, worm.segments, run.dt_s),
        state=start_of(scene, worm, world) if state is None else state,
        sensor=sensor,
        record_every=run.record_every,
        settle_first=scene.start.settle,
        tolerance=run.tolerance,
        accuracy=run.accuracy,
    )


def worm_of(scene: AnyWormScene) -> worm3d.Worm:
    """Return the worm described by the section [worm] and the sections of the worm's parts."""
    if isinstance(scene, PlanarWormScene):
        return worm3d.Worm.planar(
            **values_of(Linkage, scene.worm), segment=part_in("segment", SEGMENT_KIND, scene.segment)
        )
    chosen: dict[str, Any] = {name: part_in(name, kind, getattr(scene, name)) for name, kind in PARTS.items()}
    return replace(part_of(worm3d.Worm, scene.worm), **chosen)


def part_in(name: str, kind: Kind, section: Any) -> Any:
    """Return the part of a section; error messages about a parameter begin with the name of the section."""
    try:
        return part_named(kind, section.kind, section)
    except ValueError as error:
        if str(error).partition(":")[0] in declared(class_named(kind, section.kind)):
            raise ValueError(f"{name}.{error}") from error
        raise


def friction_of(scene: AnyWormScene) -> worm3d.Friction:
    """Return the coefficients of friction and their law."""
    return part_of(worm3d.Friction, scene.friction, law=part_named(LAW_KIND, scene.friction.law, scene.friction))


def gait_of(scene: AnyWormScene) -> Gait | Reflexive | RecordedCommands:
    """Return the gait of a scene, combined with the reflexes of the scene, or the recorded commands.

    Raises
    ------
    ValueError
        The segment law does not have the input that the scene gives, or the file of commands cannot be used.
    """
    assert isinstance(scene, GaitScene)
    reflexes = switched_parts(REFLEX, scene.reflexes)
    if getattr(scene.gait, "file", NO_RECORD) != NO_RECORD:
        if reflexes:
            raise ValueError(f"file: got {scene.gait.file!r}: reflexes change a gait, not recorded commands")
        return recorded_commands(file_named(scene.gait.file))
    gait = gait_from(scene.gait, scene.run.dt_s, **_amplitude(scene))
    return Reflexive(gait, tuple(reflexes)) if reflexes else gait


def _amplitude(scene: GaitScene) -> dict[str, float]:
    """Return the amplitude of a gait that is given as an input of the segment law; empty if it is not."""
    section = scene.gait
    given = {name: getattr(section, f"{name}_{unit}", None) for name, unit in INPUT_UNITS.items()}
    found = [(name, value) for name, value in given.items() if value is not None]
    if not found:
        return {}
    usual, (name, value) = getattr(class_named(GAIT, section.kind), "amplitude", None), found[0]
    if len(found) > 1 or section.amplitude not in (None, usual):
        raise ValueError(f"amplitude: got {section.amplitude:g} and a {name}: give only one amplitude")
    return {"amplitude": float(worm_of(scene).segment.contraction_of(value, name))}


def recorded_commands(path: Path) -> RecordedCommands:
    """Return the commands in a CSV file, whose columns are named as in `scenes.records.columns`.

    Raises
    ------
    SceneError
        The file has no column of a pressure, a cable or a contraction, or a number is missing.
    """
    record = measured.load(path)
    name = next((each for each in ("pressure", "cable", "contraction") if each in record), None)
    units = {**INPUT_UNITS, "contraction": "1"}
    if name is None or record.variable(name).units != units[name]:
        raise SceneError(f"{path}: no column of a command, must have pressure_kPa, cable_N, contraction or similar")
    value = record[name]
    try:
        return RecordedCommands(record["time"], value[..., None] if value.ndim == 2 else value, name)
    except ValueError as error:
        raise SceneError(f"{path}: {error}") from None


def sensor_of(scene: AnyWormScene) -> Sensor | None:
    """Return the sensor of a scene with a gait, or None if the signals are exact or nothing uses them."""
    assert isinstance(scene, GaitScene)
    channels: dict[str, Any] = dict(channels_of(scene.sensor, getattr(gait_of(scene), "senses", ())))
    if all(each == Channel(noise=0.0) for each in channels.values()):
        return None
    return Sensors(seed=scene.seed, **{"strain": None, "com": None, **channels})


def measures_of(scene: AnyWormScene) -> list[Measure]:
    """Return the user's own measures in a scene; raise ValueError if a name does not belong to a measure."""
    entered = {id(each.function): each for each in MEASURES.values() if each.function}
    found = [(name, named.own(name, MEASURE)) for name in scene.measures.parts]
    return [entered.get(id(part)) or part_named(MEASURE, name, getattr(scene.measures, name)) for name, part in found]


def gravity_of(scene: AnyWormScene) -> NDArray[np.float64]:
    """Return the gravitational acceleration, shape (3,) [m/s^2]."""
    g = scene.run.gravity_m_s2
    return np.array([0.0, 0.0, -g] if isinstance(g, float | int) else g)


def start_of(scene: AnyWormScene, worm: worm3d.Worm, world: worm3d.worlds.World | None) -> worm3d.State:
    """Return the initial state of the run."""
    start, azimuth, contraction = scene.start, 0.0, np.zeros((worm.segments, 2))
    if isinstance(start, AimedStart):
        azimuth = math.radians(start.azimuth_deg)
        if isinstance(start, Start) and start.contracted:
            contraction = gait_of(scene).bind(worm)(0.0).contraction
    return worm3d.State.straight(worm, world, (*start.position_m, start.lift_m), azimuth, contraction)


def force_of(push: Push, segments: int, dt: float) -> Force | None:
    """Return a function of the time [s] that returns the push as forces on the joints, shape (N+1, 3) [N].

    Return None if the scene has no push. The force acts in a step if the end of the step is in
    (begin, begin + duration].
    """
    if not any(push.force_N):
        return None
    force = np.zeros((segments + 1, 3))
    force[push.joint] = push.force_N
    begin = push.begin_s + 1e-6 * dt  # so that rounding errors do not move the start of the push to another step
    end = math.inf if push.duration_s is None else begin + push.duration_s
    return lambda t: force if begin < t <= end else np.zeros_like(force)
