"""From the section [world] to the world of the plant."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import worm3d
from scenes.kinds.world_plane_schema import Patch
from scenes.kinds.worlds_schema import World


def _plane(world: World) -> worm3d.Plane:
    patches = tuple(map(_patch, world.patches))
    return worm3d.Plane(math.radians(world.slope_deg), math.radians(world.heading_deg), patches)


def _patch(patch: Patch) -> worm3d.Patch:
    sides = {"along": patch.along_m, "across": patch.across_m}
    return worm3d.Patch(patch.grip, **{name: side for name, side in sides.items() if side is not None})  # type: ignore[arg-type]


WORLDS: dict[str, Callable[[World], Any]] = {
    "plane": _plane,
    "clamped": lambda world: worm3d.ClampedGround(world.velocity_threshold_m_s),
    "none": lambda world: None,
}
"""What each `kind` of world becomes."""


def world_of(world: World) -> worm3d.worlds.World | None:
    """Return the world that a section describes; None if there is nothing."""
    built: worm3d.worlds.World | None = WORLDS[world.kind](world)
    return built
