"""Checks of the section [world] that involve several keys, or several values of one key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from scenes.language.checks import Check, Found
from scenes.language.toml import shown
from scenes.models.worlds.build import world_of
from scenes.models.worlds.schema import FILES, HEIGHTFIELD, MESH, NO_FILE, PIPE, SLOPE_INTO_PIPE, World
from worm3d.worlds.terrain import MOST_HEIGHTS

BEND = ("bend_deg", "bend_radius_m")


def pieces_are_one_thing(pieces: Sequence[Mapping[str, Any]]) -> str | None:
    """Return an error for a piece of a pipe that is neither straight nor a bend, or that is both."""
    for number, piece in enumerate(pieces):
        straight, bend = piece.get("straight_m") is not None, [piece.get(key) is not None for key in BEND]
        if straight == any(bend) or any(bend) != all(bend):
            return f"piece {number}: must have straight_m, or bend_deg and bend_radius_m"
    return None


def _points_or_pieces(points_m: Sequence[Any], pieces: Sequence[Any], tilt_deg: float) -> str | None:
    if not points_m or (not pieces and tilt_deg == 0.0):
        return None
    return "the points say where the pipe goes: leave out world.pieces and world.tilt_deg"


def _radii_follow_one_another(radii: Sequence[Mapping[str, Any]]) -> str | None:
    at = [place["at_m"] for place in radii]
    if all(a < b for a, b in pairwise(at)):
        return None
    return f"got at_m = {shown(at)}: each place must lie farther along the pipe than the one before"


def _radius_or_radii(radii: Sequence[Any], radius_m: float, usual_m: float = 0.12) -> str | None:
    if not radii or radius_m == usual_m:
        return None
    return f"got {len(radii)} places and world.radius_m = {radius_m}: give one of the two"


def _worm_fits(
    radius_m: float,
    radii: Sequence[Mapping[str, Any]],
    kind: str,
    half_height_m: Any,
    chamber_offset_m: float,
    tail_m: Any,
    law: str,
) -> Found:
    """Return an error for a worm that starts in a pipe and is wider at rest than this pipe.

    The sizes of a worm with the file of a segment law follow from the file, and the start of the run checks them.
    """
    if kind != PIPE or law != NO_FILE:
        return None
    pipe = 2.0 * (float(radii[0]["radius_m"]) if radii and tail_m[0] <= radii[0]["at_m"] else radius_m)
    worm = 2.0 * (float(np.max(half_height_m)) + chamber_offset_m)
    if (radii and tail_m[0] > radii[0]["at_m"]) or worm < pipe:
        return None
    wide = f"the worm is {worm:.4g} m wide at rest (2 (worm.half_height_m + worm.chamber_offset_m))"
    text = f"{wide}, the pipe {pipe:.4g} m: it must be narrower than the pipe where it starts"
    keys = ("world.radii",) if radii else ("world.radius_m",)
    return dict.fromkeys((*keys, "worm.half_height_m", "worm.chamber_offset_m"), text)


def _across_nothing(position_m: Sequence[float], kind: str) -> str | None:
    if kind != PIPE or position_m[1] == 0.0:
        return None
    return f"got {shown(position_m)}: in a pipe it is [how far along it the tail is, 0]"


def _along_the_pipe(azimuth_deg: float, kind: str) -> str | None:
    if kind != PIPE or azimuth_deg % 180.0 == 0.0:
        return None
    return f"got {azimuth_deg}: in a pipe it is 0, the head looks along it, or 180, back"


def _patches_have_an_inside(patches: Sequence[Mapping[str, Any]]) -> str | None:
    for number, patch in enumerate(patches):
        for key in ("along_m", "across_m"):
            side = patch.get(key)
            if side is not None and not side[0] < side[1]:
                return f"{key} of patch {number}: got {shown(side)}: must be [from, to] with from < to"
    return None


def _pipe_leads_into_the_hill(tilt_deg: float, slope_deg: float, face_deg: float | None, kind: str) -> Found:
    if kind != SLOPE_INTO_PIPE:
        return None
    if face_deg is not None and face_deg <= slope_deg:
        return {
            "world.face_deg": f"got {face_deg}: must be above world.slope_deg ({slope_deg}), or left out",
            "world.slope_deg": f"got {slope_deg}: must be below world.face_deg ({face_deg})",
        }
    key, hill = ("world.slope_deg", slope_deg) if face_deg is None else ("world.face_deg", face_deg)
    if tilt_deg < hill:
        return None
    why = "or the pipe does not lead into the hill"
    return {
        "world.tilt_deg": f"got {tilt_deg}: must be below {key} ({hill}), {why}",
        key: f"got {hill}: must be above world.tilt_deg ({tilt_deg}), {why}",
    }


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


def _world_can_be_made(file: str, world: World) -> Found:
    """Return the errors that occur when the file of a mesh or a heightfield is read."""
    if world.kind not in FILES:
        return None
    try:
        world_of(world)
    except ValueError as error:
        text = str(error)
        return {"world": text, ("world.file" if file != NO_FILE else "world"): text}
    return None


SECTION_CHECKS = (
    Check(("world.patches",), _patches_have_an_inside),
    Check(("start.position_m", "world.kind"), _across_nothing),
    Check(("world.pieces",), pieces_are_one_thing),
    Check(("world.points_m", "world.pieces", "world.tilt_deg"), _points_or_pieces),
    Check(("world.radii",), _radii_follow_one_another),
    Check(("world.radii", "world.radius_m"), _radius_or_radii),
    Check(("world.tilt_deg", "world.slope_deg", "world.face_deg", "world.kind"), _pipe_leads_into_the_hill),
    Check(("world.file", "world.kind", "world.surface"), _file_is_given),
    Check(("world.extent_m", "world.spacing_m"), _extent_is_an_area),
    Check(("world.ramp_m", "world.size_m", "world.surface", "world.kind"), _step_has_a_tread),
    Check(("world.file", "world"), _world_can_be_made),
)

WORM_IN_PIPE_CHECKS = (
    Check(("start.azimuth_deg", "world.kind"), _along_the_pipe),
    Check(
        (
            *("world.radius_m", "world.radii", "world.kind"),
            *("worm.half_height_m", "worm.chamber_offset_m", "start.position_m", "segment.file"),
        ),
        _worm_fits,
    ),
)
"""Checks for worms with two chambers side by side."""
