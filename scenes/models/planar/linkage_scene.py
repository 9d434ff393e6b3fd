"""Scene of the corrected planar worm: sections, checks, and construction of the worm and its run."""

from __future__ import annotations

import math
from functools import partial
from inspect import signature
from typing import Any, Literal

import numpy as np

from control.parts import GAIT
from planar import linkage
from planar.linkage.simulate import Gait, bytes_per_step
from scenes.language.checks import Check
from scenes.language.parts import PartSection, keys_by_parameter, keys_of, part_of
from scenes.language.schema import Section, setting
from scenes.models.base import Observer
from scenes.models.checks import RUN_CHECKS, building, gait_checks, in_keys, memory_check
from scenes.models.sections import BODY_BOUNDS, Settings, gait_from, planar_gait_keys

_RUN: dict[str, Any] = {name: given.default for name, given in signature(linkage.simulate).parameters.items()}


class Worm(PartSection, keys=keys_of(linkage.Linkage, bounds=BODY_BOUNDS)):
    """The chain of rhombic linkages."""


class Friction(PartSection, keys=keys_of(linkage.Friction)):
    """Directional Coulomb friction along the ground."""

    law: Literal["anchored", "threshold"] = setting(
        _RUN["friction_law"], meaning="in contact: set-valued with anchors, or the paper's (P10) for comparison"
    )
    velocity_threshold_m_s: float = setting(
        _RUN["velocity_threshold"], unit="m/s", ge=0, meaning="(P10): no friction below this speed (threshold, clamped)"
    )


class Ground(Section):
    """The ground under the worm, and gravity."""

    kind: Literal["contact", "clamped"] = setting(
        _RUN["ground"],
        meaning="contact: the apexes touch the ground; clamped: the joints' heights are held, loads by (P9)",
    )
    slope_deg: float = setting(_RUN["slope"], unit="deg", gt=-90, lt=90, meaning="angle, rising towards the head")
    gravity_m_s2: float = setting(_RUN["gravity"], unit="m/s^2", ge=0, meaning="g")


class LinkageGait(PartSection, holds={"kind": GAIT}, keys=partial(planar_gait_keys, without=("force",))):
    """The commanded contraction: rest lengths are l0 (1 - amplitude x activation)."""


class LinkageScene(Settings):
    """A whole scene."""

    model: Literal["planar_linkage"] = setting(meaning="which simulation the scene is for")
    worm: Worm = Worm()
    friction: Friction = Friction()
    gait: LinkageGait = LinkageGait()
    ground: Ground = Ground()


LINKAGE_KEYS = keys_by_parameter(linkage.Linkage, Worm)
"""Key of each parameter of `Linkage` in the section [worm]."""


def simulate(scene: LinkageScene, observer: Observer) -> linkage.Run:
    """Run the worm of a scene.

    Raises
    ------
    ValueError
        If the parameters of the worm are invalid, or its weight would flatten it (`LimitPointError`).
    """
    return linkage.simulate(
        worm_of(scene.worm),
        gait_of(scene),
        duration=scene.run.duration_s,
        dt=scene.run.dt_s,
        ground=scene.ground.kind,
        friction=part_of(linkage.Friction, scene.friction),
        friction_law=scene.friction.law,
        gravity=scene.ground.gravity_m_s2,
        slope=math.radians(scene.ground.slope_deg),
        velocity_threshold=scene.friction.velocity_threshold_m_s,
        observer=observer,
    )


def worm_of(worm: Worm) -> linkage.Linkage:
    """Return the worm described by the section [worm]."""
    return part_of(linkage.Linkage, worm)


def gait_of(scene: LinkageScene) -> Gait:
    """Return the gait as a function of the time [s] that returns the contraction of each segment, shape (N,)."""
    wave, segments = gait_from(scene.gait, scene.run.dt_s), scene.worm.segments
    return lambda t: wave.amplitude * wave.activation(t, segments)


def _can_start(mass_kg: float | None, worm: Worm, friction: Friction, ground: Ground, gait: LinkageGait) -> str | None:
    """Return an error if the worm cannot start, because its weight flattens it or its numbers overflow."""
    scene = LinkageScene(model="planar_linkage", worm=worm, friction=friction, ground=ground, gait=gait)
    try:
        with np.errstate(all="ignore"):
            if _is_flattened(scene):
                simulate(scene, lambda done: False)  # raises an error that says how much too heavy the worm is
    except (ValueError, ArithmeticError) as error:
        return in_keys(str(error), LINKAGE_KEYS)
    return None


def _is_flattened(scene: LinkageScene) -> bool:
    worm, ground = worm_of(scene.worm), scene.ground
    load = worm.apex_load(ground.gravity_m_s2 * math.cos(math.radians(ground.slope_deg)))
    return ground.kind == "contact" and bool((load >= worm.flattening_weight()).any())


FRICTION = ("friction", "worm.segments")
"""Keys for the check that friction has a single value or a value for each segment."""

LINKAGE_CHECKS = (
    *RUN_CHECKS,
    *gait_checks(LinkageGait, Worm, can_sense=False),
    building(worm_of, "worm"),
    building(lambda friction, segments: part_of(linkage.Friction, friction).coefficients(segments), *FRICTION),
    memory_check(bytes_per_step),
    Check(("worm.mass_kg", "worm", "friction", "ground", "gait"), _can_start),
)
