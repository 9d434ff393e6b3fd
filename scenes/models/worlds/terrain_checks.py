"""What is wrong with terrain or a mesh of a scene though each of its keys is right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from scenes.language.checks import Check, Found
from scenes.language.toml import shown
from scenes.models.worlds.build import world_of
from scenes.models.worlds.schema import World
from scenes.models.worlds.terrain_schema import FILES, HEIGHTFIELD, MESH, NO_FILE
from worm3d.worlds.terrain import MOST_HEIGHTS


def _file_is_given(file: str, kind: str, surface: str) -> str | None:
    if file != NO_FILE or not (kind == MESH or (kind == HEIGHTFIELD and surface == "image")):
        return None
    return f"missing: world.kind = '{kind}' needs it; give the path of a {'mesh' if kind == MESH else 'picture'}"


def _extent_is_an_area(extent_m: Sequence[float], spacing_m: float) -> str | None:
    if min(extent_m) <= 0.0:
        return f"got {shown(extent_m)} m: length and width must be above 0"
    along, across = (side / spacing_m + 1.0 for side in extent_m)
    if along * across <= MOST_HEIGHTS:
        return None
    return (
        f"got {shown(extent_m)} m at world.spacing_m = {spacing_m}: makes {along * across:.2g} heights, at most 4e6 "
        "are allowed"
    )


def _step_has_a_tread(ramp_m: float, size_m: float, surface: str, kind: str) -> str | None:
    if kind != HEIGHTFIELD or surface != "steps" or ramp_m <= size_m:
        return None
    return f"got {ramp_m} m: a step rises over at most its tread, world.size_m ({size_m} m)"


def _world_can_be_made(file: str, section: Mapping[str, Any]) -> Found:
    """Tell what a mesh or picture file says of itself when it is read."""
    world = World.model_validate(section)
    if world.kind not in FILES:
        return None
    try:
        world_of(world)
    except ValueError as error:
        text = str(error)
        return {"world": text, ("world.file" if file != NO_FILE else "world"): text}
    return None


TERRAIN_CHECKS = (
    Check(("world.file", "world.kind", "world.surface"), _file_is_given),
    Check(("world.extent_m", "world.spacing_m"), _extent_is_an_area),
    Check(("world.ramp_m", "world.size_m", "world.surface", "world.kind"), _step_has_a_tread),
    Check(("world.file", "world"), _world_can_be_made),
)
