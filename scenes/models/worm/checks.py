"""Checks that involve several keys of a scene of the 3D worm."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from control.gaits import FeedbackGait, RecordedCommands
from control.gaits.reflexes import REFLEXES
from control.parts import GAIT
from scenes.language.checks import Check, Found
from scenes.language.parts import class_named
from scenes.language.schema import Section, keys_in
from scenes.language.toml import shown
from scenes.models.checks import RUN_CHECKS, building, gait_checks, in_keys, too_much_memory
from scenes.models.switched import switched_checks
from scenes.models.worlds.build import world_of
from scenes.models.worlds.checks import SECTION_CHECKS, WORM_IN_PIPE_CHECKS
from scenes.models.worm.build import PARTS, WORM_KEYS, friction_of, gait_of, gravity_of, start_of, worm_of
from scenes.models.worm.schema import (
    NO_LAW,
    PlanarGait,
    PlanarWorm,
    PlanarWormScene,
    Reflexes,
    Senses,
    SpatialScene,
    Surroundings,
    Worm,
    WormGait,
    WormScene,
)
from worm3d.recorded.state import StateError
from worm3d.running import start
from worm3d.values.arguments import MAX_MAGNITUDE, bytes_of_run
from worm3d.values.named import is_own

IMPOSSIBLE = (ValueError, ArithmeticError)
"""Errors that an impossible worm raises. Arithmetic errors occur if huge numbers overflow."""
BODY = ("worm", *PARTS)
"""Sections that describe the body of a 3D worm."""
PLANAR_BODY = ("worm", "segment")
"""Sections that describe the body of a planar worm."""
STARTS_WITH = ("world", "start", "run")
"""Sections that decide, beside those of the body, whether a worm can start."""
SPATIAL_STARTS_WITH = (*BODY, *STARTS_WITH)
"""Sections that decide whether a 3D worm can start."""


def start_check(schema: type[Surroundings], names: tuple[str, ...] = SPATIAL_STARTS_WITH) -> Check:
    """Return the check that the worm of a scene can start. The check reads the sections `names`."""

    def can_start(mass_kg: float | None, *sections: Section) -> Found:
        return _refusal(scene_with(schema, names, sections))

    return Check(("worm.mass_kg", *names), can_start)


def scene_with(schema: type[Surroundings], names: tuple[str, ...], sections: Sequence[Section]) -> Any:
    """Return a scene with the given sections, and defaults for the other sections."""
    return schema(model="", **dict(zip(names, sections, strict=True)))


def _sized(section: Section, segments: int) -> None:
    """Raise ValueError if the friction or the friction law does not have a value for each segment."""
    friction = friction_of(SpatialScene(model="", friction=section))
    friction.coefficients(segments)
    friction.law.rows(segments)


def _refusal(scene: Any) -> Found:
    """Return the error with which the solver refuses a scene before the first step, or None.

    For example, the solver refuses a worm that is flattened by its weight.
    """
    try:
        with np.errstate(all="ignore"):
            worm, world, gravity = worm_of(scene), world_of(scene.world), gravity_of(scene)
            start.require_felt(worm, world)
            state = start_of(scene, worm, world)
            start.require_shape(worm, state)
            if world is not None and start.settles(world, gravity):
                start.require_equilibrium(worm, float(np.linalg.norm(world.pressing(gravity))), state.contraction)
    except StateError as error:
        return dict.fromkeys(("start", "world"), in_keys(str(error), WORM_KEYS))
    except IMPOSSIBLE as error:
        return in_keys(str(error), WORM_KEYS)
    return None


def _g_or_a_vector(gravity_m_s2: Any) -> str | None:
    if np.max(np.abs(gravity_m_s2), initial=0.0) > MAX_MAGNITUDE:
        return f"got {shown(gravity_m_s2)} m/s^2: must be at most {MAX_MAGNITUDE:g}"
    if isinstance(gravity_m_s2, list | tuple):
        if len(gravity_m_s2) == 3:
            return None
        return f"got a list of {len(gravity_m_s2)}: must be one number (g, downwards) or a list of three (x, y, z)"
    return (
        None if gravity_m_s2 >= 0 else f"got {gravity_m_s2} m/s^2: g is at least 0; a list of x, y, z may point upwards"
    )


def _clamped_by_coulomb(law: str, kind: str) -> str | None:
    if kind != "clamped" or law == "coulomb":
        return None
    return (
        f"got {law!r}: with world.kind = 'clamped' the law is always Coulomb friction, (P10); leave this key out, or "
        "take another world"
    )


def _accuracy_by_bdf2(accuracy: float | None, integrator: str) -> str | None:
    if accuracy is None or integrator == "bdf2":
        return None
    return f"got {accuracy} with run.integrator = '{integrator}': only bdf2 has steps of variable length; leave one out"


def law_is_named(file: str, kind: str) -> str | None:
    """Return an error for a learned law without a file."""
    return "must name the file of a law that 'worm3d law' wrote" if kind == "learned" and file == NO_LAW else None


def _stays_within_the_law(*sections: Section, schema: type[Surroundings], names: tuple[str, ...]) -> None:
    """Raise ValueError if a worm cannot follow its gait.

    A gait must not contract chambers further than a segment law with a stroke allows, and the law must know the inputs
    that the gait gives.
    """
    scene = scene_with(schema, names, sections)
    worm, given = worm_of(scene), gait_of(scene)
    if worm.segment.suited() or isinstance(given, RecordedCommands):
        given.bind(worm)


def _stay_check(schema: type[Surroundings], body: tuple[str, ...]) -> Check:
    names = ("gait", *body)
    return building(partial(_stays_within_the_law, schema=schema, names=names), *names)


def _push_on_a_joint(joint: int, segments: int) -> str | None:
    return None if joint <= segments else f"got {joint}: the last joint, the head, is {segments} (worm.segments)"


def _push_lasts_a_step(duration_s: float | None, dt_s: float) -> str | None:
    if duration_s is None or duration_s >= dt_s * (1.0 - 1e-9):
        return None
    return f"got {duration_s} s: must be at least run.dt_s ({dt_s} s), or the steps miss the push"


def _fits_into_memory(dt_s: float, duration_s: float, segments: int, record_every: int) -> Found:
    steps = duration_s / dt_s
    needed = bytes_of_run(segments, steps, record_every)
    remedy = "a larger run.record_every, a shorter run.duration_s, a longer run.dt_s or fewer worm.segments"
    return too_much_memory(needed, steps, segments, remedy)


def _errors_are_felt(sensor: Senses, reflexes: Reflexes, kind: str) -> Found:
    """Return an error if a scene sets sensor errors, but neither its gait nor a reflex uses sensors."""
    wrong = [key for key, value in sensor if is_own(key) or value != keys_in(Senses)[key].default]
    gait = class_named(GAIT, kind)
    if not wrong or any(value is True or is_own(name) for name, value in reflexes) or issubclass(gait, FeedbackGait):
        return None
    return f"got {wrong[0]}: neither the gait {kind!r} nor a reflex senses anything; leave this section out"


REFLEX_CHECKS = (
    *switched_checks(REFLEXES, "reflexes", Reflexes, "reflex"),
    Check(("sensor", "reflexes", "gait.kind"), _errors_are_felt),
)
"""Checks that no parameter is set for a reflex that is off, and no sensor error for a worm that uses no sensors."""

WORLD_CHECKS = (
    *RUN_CHECKS,
    Check(("run.gravity_m_s2",), _g_or_a_vector),
    Check(("friction.law", "world.kind"), _clamped_by_coulomb),
    Check(("run.accuracy", "run.integrator"), _accuracy_by_bdf2),
    *SECTION_CHECKS,
    Check(("segment.file", "segment.kind"), law_is_named),
    Check(("push.joint", "worm.segments"), _push_on_a_joint),
    Check(("push.duration_s", "run.dt_s"), _push_lasts_a_step),
    Check(("run.dt_s", "run.duration_s", "worm.segments", "run.record_every"), _fits_into_memory),
)
"""Checks for scenes of every worm, planar or 3D."""

SPATIAL_CHECKS = (
    *WORLD_CHECKS,
    building(lambda *sections: worm_of(scene_with(SpatialScene, BODY, sections)), *BODY, refusals=IMPOSSIBLE),
    building(_sized, "friction", "worm.segments"),
    *WORM_IN_PIPE_CHECKS,
)
"""Checks for scenes of every 3D worm, with a gait or with a controller."""

WORM_CHECKS = (
    *SPATIAL_CHECKS,
    *gait_checks(WormGait, Worm),
    _stay_check(WormScene, ("reflexes", *BODY)),
    *REFLEX_CHECKS,
    start_check(WormScene),
)

PLANAR_CHECKS = (
    *WORLD_CHECKS,
    building(
        lambda *sections: worm_of(scene_with(PlanarWormScene, PLANAR_BODY, sections)), *PLANAR_BODY, refusals=IMPOSSIBLE
    ),
    building(_sized, "friction", "worm.segments"),
    *gait_checks(PlanarGait, PlanarWorm),
    _stay_check(PlanarWormScene, PLANAR_BODY),
    *REFLEX_CHECKS,
    start_check(PlanarWormScene, (*PLANAR_BODY, *STARTS_WITH)),
)
