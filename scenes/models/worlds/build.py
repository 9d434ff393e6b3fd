"""Construction of the plant's world from the section [world]."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import worm3d
from control.parts import WORLD
from scenes.language.loader import file_named
from scenes.language.parts import part_named
from scenes.models.worlds.schema import NO_WORLD, Patch, Piece, World


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
    slope, tilt, heading = map(math.radians, (world.slope_deg, world.tilt_deg, world.heading_deg))
    face = None if world.face_deg is None else math.radians(world.face_deg)
    return worm3d.slope_into_pipe(slope, world.mouth_m, _pieces(world), _radius(world), tilt, heading, face)


def _pieces(world: World) -> list[worm3d.Straight | worm3d.Bend]:
    return [_piece(piece) for piece in world.pieces] or [worm3d.Straight(1.0)]  # a pipe continues beyond both ends


def _piece(piece: Piece) -> worm3d.Straight | worm3d.Bend:
    if piece.bend_deg is None or piece.bend_radius_m is None:
        assert piece.straight_m is not None  # checked by `pieces_are_one_thing`
        return worm3d.Straight(piece.straight_m)
    return worm3d.Bend(math.radians(piece.bend_deg), piece.bend_radius_m, piece.towards)


def _radius(world: World) -> float | worm3d.Profile:
    if not world.radii:
        return world.radius_m
    return worm3d.Profile([r.at_m for r in world.radii], [r.radius_m for r in world.radii], world.rounding_m)


def _patch(patch: Patch) -> worm3d.Patch:
    sides = {"along": patch.along_m, "across": patch.across_m}
    return worm3d.Patch(patch.grip, **{name: side for name, side in sides.items() if side is not None})


def _heightfield(world: World) -> worm3d.Heightfield:
    """Return the heightfield of a section."""
    (length, width), spacing, height, size = world.extent_m, world.spacing_m, world.height_m, world.size_m
    if world.surface == "image":
        return worm3d.Heightfield.from_image(file_named(world.file), spacing, 0.0, height, grip=world.grip)
    if world.surface == "steps":
        return worm3d.Heightfield.steps(
            length, width, spacing, height=height, tread=size, ramp=world.ramp_m, grip=world.grip
        )
    if world.surface == "sinusoid":
        return worm3d.Heightfield.sinusoid(length, width, spacing, amplitude=height, wavelength=size, grip=world.grip)
    return worm3d.Heightfield.rubble(
        length, width, spacing, height=height, size=size, seed=world.stones, grip=world.grip
    )


def _mesh(world: World) -> worm3d.Mesh:
    """Return the world from the mesh file of a section."""
    units = None if world.units == "unknown" else world.units
    return worm3d.Mesh(file_named(world.file), units, world.solid, world.cell_m, world.up, grip=world.grip)


WORLDS: dict[str, Callable[[World], Any]] = {
    "plane": _plane,
    "pipe": _pipe,
    "slope_into_pipe": _slope_into_pipe,
    "heightfield": _heightfield,
    "mesh": _mesh,
    NO_WORLD: lambda world: None,
}
"""Function that returns the world, for each `kind` whose keys are written in `schema.py`."""


def world_of(world: World) -> worm3d.World | None:
    """Return the world of a section, or None for the kind "none"."""
    if world.kind in WORLDS:
        built: worm3d.World | None = WORLDS[world.kind](world)
        return built
    found: worm3d.World = part_named(WORLD, world.kind, world)
    return found
