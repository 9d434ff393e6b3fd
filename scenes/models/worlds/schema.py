"""The section [world]: the surfaces around the worm.

There are two groups of kinds of worlds. For a class that is registered in `worm3d.worlds.WORLDS`, the keys of the scene
are the parameters of the class, and no code is needed here. The keys of the other kinds are written in this module,
where `only` names the kinds that have a key, and a function in `build.WORLDS` makes the world.
"""

from __future__ import annotations

from dataclasses import make_dataclass, replace
from typing import Literal

from control.parts import WORLD
from scenes.language.parts import PartSection, keys_of, meanings
from scenes.language.schema import Key, Pair, Points, Section, Tables, keys_in, setting
from worm3d.worlds import WORLDS

PLANE, HEIGHTFIELD, MESH, NO_WORLD = "plane", "heightfield", "mesh", "none"
PIPE, SLOPE_INTO_PIPE = "pipe", "slope_into_pipe"
PIPES, FILES = (PIPE, SLOPE_INTO_PIPE), (HEIGHTFIELD, MESH)

WRITTEN = (PLANE, PIPE, SLOPE_INTO_PIPE, HEIGHTFIELD, MESH)
"""Kinds whose keys are written in this module."""

NO_FILE = "none"
"""Value of the key `file` if there is no file."""


def _kinds() -> dict[str, type]:
    """Return the class of each kind of world, whose parameters are its keys.

    For a kind whose keys are written in this module, it is a class without parameters.
    """
    bare = make_dataclass("Bare", ())
    return {**dict.fromkeys(WRITTEN, bare), **dict(sorted(WORLDS.items())), NO_WORLD: bare}


NAMED = keys_of(
    _kinds(),
    by="kind",
    own=True,
    meaning="plane, the inside of a pipe, a slope that leads into one, a heightfield or a mesh: the worm touches it; "
    f"{meanings(WORLDS)}; none: nothing there",
)
"""The key `kind`, and the keys of the kinds that are registered in `worm3d.worlds.WORLDS`."""


class Patch(Section):
    """A rectangle of the plane with different friction."""

    grip: float = setting(ge=0, meaning="multiplier of the friction coefficients")
    along_m: Pair | None = setting(
        unit="m",
        left_out="everywhere",
        meaning="from where to where along the steepest ascent, from the origin, or along a pipe",
    )
    across_m: Pair | None = setting(
        unit="m", left_out="everywhere", meaning="from where to where to the left, from the origin"
    )


class Piece(Section):
    """A straight piece (straight_m) or a bend (bend_deg, bend_radius_m, towards) of a pipe."""

    straight_m: float | None = setting(unit="m", gt=0, left_out="a bend", meaning="length of a straight piece")
    bend_deg: float | None = setting(unit="deg", gt=0, le=360, left_out="a straight piece", meaning="angle of a bend")
    bend_radius_m: float | None = setting(
        unit="m", gt=0, left_out="a straight piece", meaning="radius of a bend's centre line"
    )
    towards: Literal["left", "right", "up", "down"] = setting("left", meaning="where a bend turns, seen along the pipe")


class Radius(Section):
    """A position along a pipe with an inner radius; between two positions the wall is a cone with rounded edges."""

    at_m: float = setting(unit="m", meaning="how far along the pipe")
    radius_m: float = setting(unit="m", gt=0, meaning="inner radius there")


class WrittenKeys(PartSection, keys={"kind": NAMED["kind"]}):
    """Keys of the kinds written in this module."""

    # Planes
    slope_deg: float = setting(
        0.0, unit="deg", gt=-90, lt=90, only=(PLANE, SLOPE_INTO_PIPE), meaning="angle, rising towards x"
    )
    heading_deg: float = setting(
        0.0,
        unit="deg",
        only=(PLANE, PIPE, SLOPE_INTO_PIPE),
        meaning="azimuth of a plane's steepest ascent, or of the start of a pipe, if not x",
        aka=("azimuth_deg",),
    )
    patches: Tables[Patch] = setting(
        (),
        only=(PLANE, PIPE),
        meaning="places with another friction, each a table of grip, along_m = [from, to] and (planes only) across_m; "
        "in a pipe along the centre line",
    )
    # Pipes
    radius_m: float = setting(0.12, unit="m", gt=0, only=PIPES, meaning="inner radius")
    tilt_deg: float = setting(
        0.0, unit="deg", ge=-90, le=90, only=PIPES, meaning="angle of the start with the horizontal, 90: up"
    )
    pieces: Tables[Piece] = setting(
        (),
        only=PIPES,
        meaning="straight pieces and bends one after the other, none: straight, each a table of straight_m, "
        "or of bend_deg, bend_radius_m and towards = left, right, up or down",
    )
    points_m: Points = setting(
        (), unit="m", only=PIPE, meaning="instead of tilt_deg and pieces, places [x, y, z] on the centre line"
    )
    radii: Tables[Radius] = setting(
        (), only=PIPES, meaning="instead of radius_m, places with at_m and radius_m, between them the wall is a cone"
    )
    rounding_m: float | None = setting(
        unit="m",
        gt=0,
        only=PIPES,
        left_out="as round as there is room",
        meaning="radius of the edges where the wall's slope changes",
    )
    start_wall: bool = setting(False, only=PIPE, meaning="whether a wall closes the start of the pipe")
    end_wall: bool = setting(False, only=PIPE, meaning="whether a wall closes the end of the pipe")
    mouth_m: float = setting(
        1.3, unit="m", only=SLOPE_INTO_PIPE, meaning="how far up the slope the pipe's bottom starts"
    )
    face_deg: float | None = setting(
        unit="deg",
        gt=-90,
        lt=90,
        only=SLOPE_INTO_PIPE,
        left_out="the slope goes on",
        meaning="angle of the hill's face, which begins a radius of the pipe above the bottom of the face",
    )
    # Heightfields
    surface: Literal["rubble", "steps", "sinusoid", "image"] = setting(
        "rubble",
        only=HEIGHTFIELD,
        meaning="stones at random, stairs up along x, waves along x, or a greyscale picture (file)",
    )
    spacing_m: float = setting(0.02, unit="m", gt=0, only=HEIGHTFIELD, meaning="spacing of the heights")
    extent_m: Pair = setting((4.0, 2.0), unit="m", only=HEIGHTFIELD, meaning="length from x = 0 and width about y = 0")
    height_m: float = setting(
        0.03,
        unit="m",
        gt=0,
        only=HEIGHTFIELD,
        meaning="of the highest stone, a step, a crest above the mean, or white above black",
    )
    size_m: float = setting(
        0.15, unit="m", gt=0, only=HEIGHTFIELD, meaning="radius of the largest stone, tread of a step, or wavelength"
    )
    ramp_m: float = setting(0.1, unit="m", gt=0, only=HEIGHTFIELD, meaning="length over which a step rises")
    stones: int = setting(0, ge=0, le=2**63 - 1, only=HEIGHTFIELD, meaning="seed of the stones")
    # Meshes
    file: str = setting(
        NO_FILE,
        only=FILES,
        meaning="an STL, OBJ, PLY or GLB file, or a PNG: beside the scene, shipped, or a path",
        aka=("path", "mesh", "image"),
        is_file=True,
    )
    units: Literal["unknown", "m", "cm", "mm", "in", "ft"] = setting(
        "unknown", only=MESH, meaning="of the file's coordinates; only GLB files say theirs", aka=("mesh_units",)
    )
    solid: Literal["inside", "outside"] = setting(
        "inside", only=MESH, meaning="whether the inside of the mesh is solid, or free as the air in a tunnel"
    )
    cell_m: float | None = setting(
        unit="m", gt=0, only=MESH, left_out="a million cells", meaning="cell of its grid of distances"
    )
    up: Literal["z", "y"] = setting("z", only=MESH, meaning="the file's axis that points up")
    grip: float = setting(1.0, ge=0, only=FILES, meaning="multiplier of the friction")


def _shared(name: str, known: Key) -> Key:
    """Return a key of registered kinds of worlds.

    If the key is also written in this module, return that key, with the registered kinds added to its kinds.
    """
    written = keys_in(WrittenKeys).get(name)
    if written is None:
        return known
    return replace(written, only=(*written.only, *known.only)) if written.only else written


class World(WrittenKeys, keys={name: _shared(name, known) for name, known in NAMED.items()}, holds={"kind": WORLD}):
    """The surfaces around the worm."""
