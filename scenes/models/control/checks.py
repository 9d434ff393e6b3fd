"""Checks that involve several keys of a scene with a controller."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from control import controllers
from control.faults.injected import INJECTED
from control.sensing.sensors import QUANTITIES
from control.tracking.detour import Body
from control.tracking.guide import led
from scenes.language.checks import Check, Found, of_this_kind
from scenes.language.schema import Section, keys_in
from scenes.models.checks import building
from scenes.models.control.build import faults_of, parts_of
from scenes.models.control.reference import middle_of, reference_of
from scenes.models.control.schema import ControlScene, Faults, Sensor
from scenes.models.sensors import own_channels
from scenes.models.switched import switched_checks
from scenes.models.worm.build import PARTS, worm_of
from scenes.models.worm.checks import SPATIAL_CHECKS, scene_with, start_check
from worm3d.values.named import is_own


def _there_is_such_a_path(*sections: Section) -> Found:
    try:
        scene = scene_with(ControlScene, ("reference", "world", "worm", "start", "run"), sections)
        reference = reference_of(scene)
    except ValueError as error:
        return str(error)
    body = Body.of(worm_of(scene))
    for k, (asked, obstacle) in enumerate(zip(scene.reference.obstacles, reference.obstacles, strict=True)):
        for key, known in keys_in(type(asked)).items():
            strange = of_this_kind(getattr(asked, key), asked.kind, by="kind", known=known)
            if strange:
                return f"obstacles[{k}].{key}: {strange}"
        azimuth = np.array(math.radians(scene.start.azimuth_deg))
        if body.clearance([obstacle], np.array(middle_of(scene)), azimuth) < 0.0:
            return f"obstacles[{k}]: got one in which the worm begins: move it, or start.x_m"
    try:
        led(reference, body)
    except ValueError as error:
        return str(error)
    return None


def _faults(*sections: Section) -> None:
    """Raise ValueError if the worm or the controller of a scene cannot have one of the injected faults."""
    scene = scene_with(ControlScene, FAULTY, sections)
    known = [name for name in QUANTITIES if any(key.startswith(f"{name}_") for key in keys_in(Sensor))]
    known += own_channels(scene.sensor).values()
    for channel in (getattr(fault, "channel", known[0]) for fault in faults_of(scene)):
        if channel not in known:  # a user's own channel registered by another scene
            raise ValueError(f"channel: got {channel!r}, must be one of {', '.join(known)}")
    plans = getattr(controllers.controller(scene.controller.kind), "plans", False)
    if any(fault.of_plans for fault in faults_of(scene)) and not plans:
        raise ValueError("planner: got true: this controller plans nothing")


def _worm_has_it(asked: bool, *sections: Section, name: str) -> Found:
    if not asked or QUANTITIES[name].exists(worm_of(scene_with(ControlScene, ("worm", *PARTS), sections))):
        return None
    return f"got true: this worm has no {QUANTITIES[name].meaning}"


def _is_sensed(kind: str, asked: bool, *, name: str) -> Found:
    """Return an error for a controller that needs a sensor which the scene does not switch on."""
    if asked or name not in getattr(controllers.controller(kind), "senses", ()):
        return None
    return {
        "controller.kind": f"got '{kind}': it needs a sensor of its own: set sensor.{name} = true",
        f"sensor.{name}": f"got false: the controller '{kind}' needs it: set it to true",
    }


def _steps_in_turn(steps: Sequence[Mapping[str, Any]], duration_s: float, *, key: str) -> Found:
    times = [step["at_s"] for step in steps]
    if any(later <= sooner for sooner, later in pairwise(times)):
        return f"got steps at {', '.join(f'{t:g}' for t in times)} s: each must be later than the one before"
    if not times or times[-1] < duration_s:
        return None
    last = f"{times[-1]:g} s"
    mend = f"let the run last longer, or leave out steps ({key} = [] leaves out all)"
    return {
        key: f"got a step at {last}: must be before the end of the run (run.duration_s = {duration_s:g} s); {mend}",
        "run.duration_s": f"got {duration_s:g} s: must be more than {last}, when the last of {key} comes; {mend}",
    }


def _faults_begin_in_the_run(faults: Any, duration_s: float) -> Found:
    begins = {f"fault.{name}_begin_s": faults[f"{name}_begin_s"] for name in INJECTED if faults.get(name)}
    begins |= {f'fault."{name}"': getattr(own, "begin_s", 0.0) for name, own in faults.items() if is_own(name)}
    late = [key for key, begin_s in begins.items() if begin_s >= duration_s]
    if not late:
        return None
    end = f"the end of the run (run.duration_s = {duration_s:g} s), or the fault never shows"
    return {
        late[0]: f"got a beginning at {begins[late[0]]:g} s: must be before {end}",
        "run.duration_s": f"got {duration_s:g} s: must be more than {late[0]} ({begins[late[0]]:g} s)",
    }


def _steps_or_a_sine(speed_steps: Sequence[Any], speed_sine_m_s: float) -> Found:
    if not (speed_steps and speed_sine_m_s > 0.0):
        return None
    text = "a speed has steps (reference.speed_steps) or a sine (reference.speed_sine_m_s), not both: leave one out"
    return dict.fromkeys(("reference.speed_steps", "reference.speed_sine_m_s"), text)


def _there_are_such_parts(*sections: Section) -> Found:
    scene = scene_with(ControlScene, ("controller", "cost", "constraints"), sections)
    try:
        strange = controllers.refused(scene.controller.kind, parts_of(scene))
    except ValueError as error:
        return str(error)
    if strange is None:
        return None if scene.cost.parts else {"cost": "parts: got none, must be at least one"}
    section = {"terms": "cost", "constraints": "constraints"}.get(strange, "controller")
    said = f"the controller {scene.controller.kind!r} takes no {strange}: leave out what is said of them, or change it"
    return {section: said, "controller": said} if section != "controller" else said


def _never_backwards(speed_sine_m_s: float, speed_m_s: float) -> Found:
    if speed_sine_m_s == 0.0 or speed_sine_m_s <= speed_m_s:
        return None
    text = "the sine's amplitude is at most reference.speed_m_s: with it a speed of less than 0 cannot be asked for"
    return {
        "reference.speed_sine_m_s": f"got {speed_sine_m_s} m/s: {text}",
        "reference.speed_m_s": f"got {speed_m_s} m/s, with a sine of {speed_sine_m_s} m/s: {text}",
    }


def _decides_no_more_than_once_a_step(period_s: float, dt_s: float) -> Found:
    if period_s >= dt_s * (1.0 - 1e-9):
        return None
    return {
        "controller.period_s": f"got {period_s} s: must be at least run.dt_s ({dt_s} s), the time between measurements",
        "run.dt_s": f"got {dt_s} s: must be at most controller.period_s ({period_s} s)",
    }


OPTIONAL = [name for name, each in QUANTITIES.items() if not each.standard]
"""Sensor channels that a robot may lack."""

FAULTY = ("fault", "controller", "sensor", "worm", *PARTS)
"""Sections that determine the possible faults."""
STEP_KEYS = ("reference.speed_steps", "reference.heading_steps")
CONTROL_CHECKS = (
    *SPATIAL_CHECKS,
    Check(("controller", "cost", "constraints"), _there_are_such_parts),
    Check(("controller.period_s", "run.dt_s"), _decides_no_more_than_once_a_step),
    *switched_checks(INJECTED, "fault", Faults, "fault"),
    building(_faults, *FAULTY),
    Check(("fault", "run.duration_s"), lambda faults, duration_s: _faults_begin_in_the_run(dict(faults), duration_s)),
    *(Check((key, "run.duration_s"), partial(_steps_in_turn, key=key)) for key in STEP_KEYS),
    Check(("reference.speed_steps", "reference.speed_sine_m_s"), _steps_or_a_sine),
    Check(("reference.speed_sine_m_s", "reference.speed_m_s"), _never_backwards),
    Check(("reference", "world", "worm", "start", "run"), _there_is_such_a_path),
    *(Check((f"sensor.{name}", "worm", *PARTS), partial(_worm_has_it, name=name)) for name in OPTIONAL),
    *switched_checks(OPTIONAL, "sensor", Sensor, "sensor"),
    *(Check(("controller.kind", f"sensor.{name}"), partial(_is_sensed, name=name)) for name in OPTIONAL),
    start_check(ControlScene),
)
