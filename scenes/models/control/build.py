"""Construction of the controller, the sensors and the faults from the settings of a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from inspect import signature
from typing import Any

import numpy as np

import worm3d
from control.baselines import Gains
from control.controllers import controller, estimator, made, model
from control.faults.injected import Injected
from control.gaits.steering import WAVE_SCHEDULES, Wave
from control.identification import identified as kept
from control.identification.identified import Identified
from control.identification.strain_model import StrainModel
from control.loop import Driver, WaveController
from control.parts import CONSTRAINT, FAULT, TERM
from control.planning.suited import suited
from control.sensing.sensors import HOW_TO_ADD, QUANTITIES, Sensors
from control.task import ControlTask
from scenes.language.errors import SceneError
from scenes.language.parts import part_of, values_of
from scenes.models.control.identify import Subject, strain_model
from scenes.models.control.nearby import nearby
from scenes.models.control.reference import reference_of, speeds_of
from scenes.models.control.schema import AUTO, Controller, ControlScene
from scenes.models.sensors import channels_of, own_channels
from scenes.models.switched import parts_listed, switched_parts
from scenes.models.worlds.schema import PIPES
from scenes.models.worm.build import friction_of, problem_of, worm_of
from worm3d.values import named


def controller_of(scene: ControlScene) -> Driver:
    """Return the controller.

    Raises
    ------
    SceneError
        If the worm has not been identified and differs too much from the default worm, or if a user's own part cannot
        be used.
    """
    worm, found, asked = worm_of(scene), identified_of(scene), scene.controller
    told = sensors_of(scene).channels if asked.told else {}
    try:
        task = ControlTask(worm, reference_of(scene), found, asked.mechanism, asked.period_s, told)
        parts = parts_of(scene)
        if "problem" in signature(controller(asked.kind).of).parameters:
            parts["problem"] = problem_of(scene, drive=(None, None))
        driver = made(asked.kind, task, **parts)
    except named.EXCEPTIONS as error:
        names = (asked.kind, asked.estimator, asked.model, *scene.cost.parts, *scene.constraints.parts)
        own = [name for name in names if named.is_own(name)]
        if not own:
            raise
        raise SceneError(f"controller: {', '.join(own)}: {named.told(error)}") from error
    if isinstance(driver, WaveController):
        if not asked.inner_loop:
            driver.inner_loop = None
        if scene.world.kind in PIPES:
            driver.descent.steepest = np.inf  # on a steep descent the walls of the pipe hold the worm
    return driver


def parts_of(scene: ControlScene) -> dict[str, Any]:
    """Return the parts of the controller that differ from their defaults, as arguments of the controller's method `of`.

    Raises
    ------
    ValueError
        If the scene names a part that does not exist.
    """
    asked, usual = scene.controller, Controller()
    parts = values_of(controller(asked.kind), asked) if named.is_own(asked.kind) else {}
    for name, find in (("estimator", estimator), ("model", model)):
        if getattr(asked, name) != getattr(usual, name):
            parts[name] = find(getattr(asked, name))
    gains = part_of(Gains, asked, prefix="gain_")
    if gains != part_of(Gains, usual, prefix="gain_"):
        parts["gains"] = gains
    for key, given, kind in (("terms", scene.cost, TERM), ("constraints", scene.constraints, CONSTRAINT)):
        if given != type(given)():
            parts[key] = parts_listed(kind, given)
    return parts


def identified_of(scene: ControlScene, wave: Wave | None = None) -> Identified:
    """Return the maps and lags of the worm that the controller uses, for a given wave or for the wave of the scene.

    Raises
    ------
    SceneError
        If the worm has not been identified and differs too much from the default worm.
    """
    wave, asked = wave or wave_of(scene), scene.controller
    found = loaded(scene, wave) or nearby(worm_of(scene), friction_of(scene), asked.mechanism, WAVE_SCHEDULES[wave])
    segments = scene.worm.segments
    if found.strain is not None and found.strain.segments == segments:
        return found
    if asked.map == "default":
        return replace(found, strain=_usual_strains(segments, wave))
    subject = Subject(worm_of(scene), friction_of(scene), WAVE_SCHEDULES[wave])
    return replace(found, strain=strain_model(subject, found.maps[asked.mechanism]))


@cache
def _usual_strains(segments: int, wave: Wave) -> StrainModel | None:
    """Return the strain model of the default worm with another number of segments, or None if it cannot stand."""
    found = kept.load(worm3d.Worm(), schedule=WAVE_SCHEDULES[wave])
    assert found is not None  # the map is shipped
    return strain_model(
        Subject(worm3d.Worm(segments=segments), worm3d.Friction(), WAVE_SCHEDULES[wave]), found.maps["both"]
    )


def waves_of(scene: ControlScene) -> tuple[Wave, ...]:
    """Return the waves that the controller may use."""
    asked = scene.controller.wave
    return tuple(WAVE_SCHEDULES) if asked == AUTO else (asked,)


def wave_of(scene: ControlScene, known: Callable[[Wave], Identified] | None = None) -> Wave:
    """Return the wave that the controller uses.

    `known` returns the maps of the worm for a wave; `identified_of` if left out.
    """
    first, *others = waves_of(scene)
    if not others:
        return first
    sine = known("sine") if known else identified_of(scene, "sine")
    fastest = float(np.abs(speeds_of(scene)).max())
    return suited(fastest, sine.maps[scene.controller.mechanism], worm_of(scene).length)


def loaded(scene: ControlScene, wave: Wave) -> Identified | None:
    """Return the stored map that the controller uses for a wave, or None if it corrects the map of the default worm."""
    if scene.controller.map == "nearby":
        return None
    if scene.controller.map == "default":
        return kept.load(worm3d.Worm(), schedule=WAVE_SCHEDULES[wave])
    return kept.load(worm_of(scene), friction_of(scene), WAVE_SCHEDULES[wave])


def maps_of(scene: ControlScene) -> dict[Wave, Any]:
    """Return the content of each stored map that the controller may use, by wave; None for a corrected map."""
    found = {wave: loaded(scene, wave) for wave in waves_of(scene)}
    return {wave: each and each.as_dict() for wave, each in found.items()}


def map_name(scene: ControlScene) -> str:
    """Return the source of the map that the controller uses: "identified", "nearby" or "default"."""
    asked = scene.controller.map
    if asked != "own":
        return asked
    return "nearby" if loaded(scene, wave_of(scene)) is None else "identified"


def faults_of(scene: ControlScene) -> list[Injected]:
    """Return the injected faults; raise ValueError for a fault that the worm cannot have."""
    own_channels(scene.sensor)  # registers the user's own channels, which a fault may name
    faults = switched_parts(FAULT, scene.fault)
    for fault in faults:
        fault.require(worm_of(scene))
    return faults


def sensors_of(scene: ControlScene) -> Sensors:
    """Return the sensors. The seed of the scene determines their random errors.

    A channel that the section cannot switch on or off is present if it is standard, or if it is listed in the
    controller's `senses`.

    Raises
    ------
    SceneError
        If the controller senses a channel that does not exist.
    """
    senses = getattr(controller(scene.controller.kind), "senses", ())
    kept = {name for name, each in QUANTITIES.items() if each.standard or name in senses}
    asked = [name for name in QUANTITIES if getattr(scene.sensor, name, name in kept)]
    channels: dict[str, Any] = dict(channels_of(scene.sensor, asked))
    if lost := [name for name in senses if name not in channels]:
        kind, (first, *_) = scene.controller.kind, lost
        raise SceneError(f"controller: {kind} senses {first!r}, and there is no such sensor; {HOW_TO_ADD}")
    return Sensors(seed=scene.seed, **channels)
