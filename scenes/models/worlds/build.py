"""From the section [world] to the world of the plant."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import worm3d
from scenes.models.worlds.pipe_schema import Piece
from scenes.models.worlds.plane_schema import Patch
from scenes.models.worlds.schema import World
from scenes.models.worlds.terrain_build import heightfield, mesh


def _plane(world: World) -> worm3d.Plane:
    patches = tuple(map(_patch, world.patches))
    return worm3d.Plane(math.radians(world.slope_deg), math.radians(world.heading_deg), patches)


def _pipe(world: World) -> worm3d.Pipe:
    heading, tilt = math.radians(world.heading_deg), math.radians(world.tilt_deg)
    if world.points_m:
        line = worm3d.Centreline.through(world.points_m)
    else:
        line = worm3d.Centreline.of(_pieces(world), heading=heading, tilt=tilt)
    patches = tuple(map(_patch, world.patches))
    return worm3d.Pipe(line, _radius(world), patches, world.start_wall, world.end_wall)


def _slope_into_pipe(world: World) -> worm3d.Union:
    angles = (math.radians(angle) for angle in (world.tilt_deg, world.heading_deg))
    slope = math.radians(world.slope_deg)
    return worm3d.slope_into_pipe(slope, world.mouth_m, _pieces(world), _radius(world), *angles)


def _pieces(world: World) -> list[worm3d.Straight | worm3d.Bend]:
    return [_piece(piece) for piece in world.pieces] or [worm3d.Straight(1.0)]  # a pipe goes on beyond its ends


def _piece(piece: Piece) -> worm3d.Straight | worm3d.Bend:
    if piece.bend_deg is None or piece.bend_radius_m is None:
        assert piece.straight_m is not None  # `pieces_are_one_thing` has looked
        return worm3d.Straight(piece.straight_m)
    return worm3d.Bend(math.radians(piece.bend_deg), piece.bend_radius_m, piece.towards)


def _radius(world: World) -> float | worm3d.Profile:
    if not world.radii:
        return world.radius_m
    return worm3d.Profile([r.at_m for r in world.radii], [r.radius_m for r in world.radii], world.rounding_m)


def _patch(patch: Patch) -> worm3d.Patch:
    sides = {"along": patch.along_m, "across": patch.across_m}
    return worm3d.Patch(patch.grip, **{name: side for name, side in sides.items() if side is not None})  # type: ignore[arg-type]


WORLDS: dict[str, Callable[[World], Any]] = {
    "plane": _plane,
    "pipe": _pipe,
    "slope_into_pipe": _slope_into_pipe,
    "heightfield": heightfield,
    "mesh": mesh,
    "clamped": lambda world: worm3d.ClampedGround(world.velocity_threshold_m_s),
    "none": lambda world: None,
}
"""What each `kind` of world becomes."""


def world_of(world: World) -> worm3d.worlds.World | None:
    """Return the world that a section describes; None if there is nothing."""
    built: worm3d.worlds.World | None = WORLDS[world.kind](world)
    return built
