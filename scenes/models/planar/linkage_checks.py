"""What is wrong with a scene of the corrected planar worm though each of its keys is right."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from planar.linkage.simulate import bytes_per_step
from scenes.language.checks import Check
from scenes.models.checks import RUN_CHECKS, gait_checks, in_keys, list_checks, memory_check
from scenes.models.planar.linkage_scene import KEYS, Friction, LinkageGait, LinkageScene, Worm, simulate, worm_of


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
        return in_keys(str(error), KEYS)
    return None


def _is_flattened(scene: LinkageScene) -> bool:
    worm, ground = worm_of(scene.worm), scene.ground
    load = worm.apex_load(ground.gravity_m_s2 * math.cos(math.radians(ground.slope_deg)))
    return ground.kind == "contact" and bool((load >= worm.flattening_weight()).any())


RULES = (
    *RUN_CHECKS,
    *gait_checks(LinkageGait, Worm),
    *list_checks(Worm, "worm"),
    *list_checks(Friction, "friction"),
)
"""What makes no sense on paper."""

CHECKS = (
    *RULES,
    memory_check(bytes_per_step),
    Check(("worm.mass_kg", "worm", "friction", "ground", "gait"), _can_start),
)
"""And what the model refuses, such as a worm that its weight would flatten."""
