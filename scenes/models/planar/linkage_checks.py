"""What is wrong with a scene of the corrected planar worm though each of its keys is right."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from planar import linkage
from planar.linkage.simulate import bytes_per_step
from scenes.language.checks import Check, Found, kind_checks
from scenes.language.toml import shown
from scenes.models.checks import GAIT_CHECKS, RUN_CHECKS, memory_check
from scenes.models.planar.linkage_build import KEYS, lengthens, simulate, worm_of
from scenes.models.planar.linkage_schema import LinkageGait, LinkageScene

PER_SEGMENT = ("half_height_m", "spring_N", "apex_hinge_N_m_rad")
PER_JOINT = ("torsion_J", "cross0")


def as_many_as_segments(values: Any, segments: int) -> str | None:
    """Tell of a list that has not a number for each segment."""
    return _wrong_number(values, segments, f"one for each of the {segments} segments")


def as_many_as_joints(values: Any, segments: int) -> str | None:
    """Tell of a list that has not a number for each joint between two segments."""
    joints = segments - 1
    return _wrong_number(values, joints, f"one for each of the {joints} joints between the {segments} segments")


def _wrong_number(values: Any, wanted: int, meaning: str) -> str | None:
    if not isinstance(values, list | tuple) or len(values) == wanted:
        return None
    return f"got a list of {len(values)}: must be one number for all or {wanted} numbers, {meaning}"


def links_reach(
    amplitude: float,
    half_height_m: Any,
    length_m: float,
    segments: int,
    kind: str,
    rectified: bool,
    alternating: bool,
) -> Found:
    """Tell of a gait that lengthens a segment beyond its links."""
    try:
        worm = linkage.Linkage(segments=segments, length=length_m, half_height=half_height_m)
    except ValueError:
        return None  # `_can_start` tells
    longest, reach = worm.l0 * (1.0 + amplitude), 2.0 * float(np.min(worm.link_length))
    if longest < reach or not lengthens(kind, rectified=rectified, alternating=alternating):
        return None
    limit = f"must be below {reach / worm.l0 - 1.0:.4g} unless the gait only contracts"
    too_long = f"lengthens a segment to {longest:.4g} m, but its links end at {reach:.4g} m"
    whose = f"gait.amplitude ({amplitude}) {too_long}; it {limit}"
    return {
        "gait.amplitude": f"got {amplitude}: {too_long}; {limit}",
        "worm.half_height_m": f"got {shown(half_height_m)}: {whose}",
        "gait.rectified": f"got {shown(rectified)}: {whose}",
        "gait.kind": f"got {shown(kind)}: {whose}",
    }


def _can_start(
    mass_kg: float | None,
    worm: Mapping[str, Any],
    friction: Mapping[str, Any],
    ground: Mapping[str, Any],
    gait: Mapping[str, Any],
) -> str | None:
    """Tell what the model refuses: a worm that its weight would flatten, or one too small for its numbers."""
    sections = {"worm": worm, "friction": friction, "ground": ground, "gait": gait}
    scene = LinkageScene.model_validate({"model": "planar_linkage", **sections})
    try:
        with np.errstate(all="ignore"):
            if _is_flattened(scene):
                simulate(scene, lambda done: False)  # which says how far beyond the limit point it is
    except (ValueError, ArithmeticError) as error:
        return in_keys(str(error))
    return None


def _is_flattened(scene: LinkageScene) -> bool:
    worm, ground = worm_of(scene.worm), scene.ground
    load = worm.apex_load(ground.gravity_m_s2 * math.cos(math.radians(ground.slope_deg)))
    return ground.kind == "contact" and bool((load >= worm.flattening_weight()).any())


def in_keys(sentence: str, keys: Mapping[str, str] = KEYS) -> str:
    """Return a sentence of the model with the keys of the scene in place of its parameters."""
    for parameter, key in keys.items():
        if "_" in parameter:
            sentence = sentence.replace(parameter, key)
    return sentence


LIST_CHECKS = (
    *(Check((f"worm.{key}", "worm.segments"), as_many_as_segments) for key in PER_SEGMENT),
    *(Check((f"worm.{key}", "worm.segments"), as_many_as_joints) for key in PER_JOINT),
)
REACH_NEEDS = (
    *("gait.amplitude", "worm.half_height_m", "worm.length_m", "worm.segments"),
    *("gait.kind", "gait.rectified", "gait.alternating"),
)

RULES = (
    *RUN_CHECKS,
    *GAIT_CHECKS,
    *LIST_CHECKS,
    Check(REACH_NEEDS, links_reach),
    *kind_checks(LinkageGait),
)
"""What makes no sense on paper."""

CHECKS = (
    *RULES,
    memory_check(bytes_per_step),
    Check(("worm.mass_kg", "worm", "friction", "ground", "gait"), _can_start),
)
"""And what the model refuses, such as a worm that its weight would flatten."""
