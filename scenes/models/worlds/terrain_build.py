"""From the section [world] to terrain and to worlds from mesh files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import worm3d

if TYPE_CHECKING:
    from scenes.models.worlds.schema import World

SHIPPED = Path(__file__).parents[2]
"""Folder of the files that come with the program."""


def heightfield(world: World) -> worm3d.Heightfield:
    """Return the terrain of a section."""
    (length, width), spacing, height, size = world.extent_m, world.spacing_m, world.height_m, world.size_m
    if world.surface == "image":
        return worm3d.Heightfield.from_image(file_of(world), spacing, 0.0, height, grip=world.grip)
    if world.surface == "steps":
        return worm3d.Heightfield.steps(
            length, width, spacing, height=height, tread=size, ramp=world.ramp_m, grip=world.grip
        )
    if world.surface == "sinusoid":
        return worm3d.Heightfield.sinusoid(length, width, spacing, amplitude=height, wavelength=size, grip=world.grip)
    return worm3d.Heightfield.rubble(
        length, width, spacing, height=height, size=size, seed=world.stones, grip=world.grip
    )


def mesh(world: World) -> worm3d.Mesh:
    """Return the world of a section's mesh file."""
    units = None if world.units == "unknown" else world.units
    return worm3d.Mesh(file_of(world), units, world.solid, world.cell_m, world.up, grip=world.grip)


def file_of(world: World) -> Path:
    """Return the file of a section: as it says, or among those that come with the program."""
    path = Path(world.file)
    shipped = SHIPPED / path.name
    return shipped if not os.path.exists(path) and path.name == world.file and os.path.isfile(shipped) else path
