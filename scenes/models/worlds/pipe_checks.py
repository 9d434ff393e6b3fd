"""What is wrong with a pipe of a scene though each of its keys is right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from scenes.language.checks import Check, Found
from scenes.language.toml import shown
from scenes.models.worlds.plane_schema import PIPE, SLOPE_INTO_PIPE

BEND = ("bend_deg", "bend_radius_m")


def pieces_are_one_thing(pieces: Sequence[Mapping[str, Any]]) -> str | None:
    """Tell of a piece that is not either straight or a bend."""
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
) -> Found:
    """Tell of a worm wider at rest than the pipe that it starts in."""
    if kind != PIPE:
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


def _pipe_leads_into_the_hill(tilt_deg: float, slope_deg: float, kind: str) -> Found:
    if kind != SLOPE_INTO_PIPE or tilt_deg < slope_deg:
        return None
    why = "or the pipe does not lead into the hill"
    return {
        "world.tilt_deg": f"got {tilt_deg}: must be below world.slope_deg ({slope_deg}), {why}",
        "world.slope_deg": f"got {slope_deg}: must be above world.tilt_deg ({tilt_deg}), {why}",
    }


PIPE_CHECKS = (
    Check(("start.position_m", "world.kind"), _across_nothing),
    Check(("world.pieces",), pieces_are_one_thing),
    Check(("world.points_m", "world.pieces", "world.tilt_deg"), _points_or_pieces),
    Check(("world.radii",), _radii_follow_one_another),
    Check(("world.radii", "world.radius_m"), _radius_or_radii),
    Check(("world.tilt_deg", "world.slope_deg", "world.kind"), _pipe_leads_into_the_hill),
)

WORM_IN_PIPE_CHECKS = (
    Check(("start.azimuth_deg", "world.kind"), _along_the_pipe),
    Check(
        (
            *("world.radius_m", "world.radii", "world.kind"),
            *("worm.half_height_m", "worm.chamber_offset_m", "start.position_m"),
        ),
        _worm_fits,
    ),
)
"""For worms with chambers beside each other."""
