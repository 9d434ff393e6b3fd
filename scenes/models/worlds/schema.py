"""The section [world]: what the worm crawls on.

A world with a name in `worm3d.worlds.WORLDS` is a `kind` without further ado: its keys are its parameters. The others
have keys that are written out here (`only` says for which kind), and a function in `build.WORLDS`.
"""

from __future__ import annotations

from dataclasses import make_dataclass
from typing import Literal

from control.parts import WORLD
from scenes.language.parts import PartSection, key_of, keys_of, meanings
from scenes.language.schema import Pair, Points, Section, Tables, quantity, setting, tables
from worm3d.values.parameters import parameters_of
from worm3d.worlds import WORLDS

PLANE, HEIGHTFIELD, MESH, NONE = "plane", "heightfield", "mesh", "none"
PIPE, SLOPE_INTO_PIPE = "pipe", "slope_into_pipe"
PIPES, FILES = (PIPE, SLOPE_INTO_PIPE), (HEIGHTFIELD, MESH)

WRITTEN = (PLANE, PIPE, SLOPE_INTO_PIPE, HEIGHTFIELD, MESH)
"""Kinds of which the keys are written out."""

NO_FILE = "none"
"""Stands for a file that is not given."""


def _kinds() -> dict[str, type]:
    """Return the class of each kind of world, without parameters where its keys are written out."""
    bare = make_dataclass("Bare", ())
    return {**dict.fromkeys(WRITTEN, bare), **dict(sorted(WORLDS.items())), NONE: bare}


NAMED = keys_of(
    _kinds(),
    by="kind",
    own=True,
    title="plane, the inside of a pipe, a slope that leads into one, a heightfield or a mesh: the worm touches it; "
    f"{meanings(WORLDS)}; none: nothing there",
)
"""Keys of the kinds of world that are found by name, and which one it is."""


class KindOfWorld(PartSection, keys={"kind": NAMED["kind"]}):
    """Which kind of world it is."""


class Patch(Section):
    """A rectangle of the plane with another friction."""

    grip: float = quantity(ge=0, title="multiplier of the friction coefficients")
    along_m: Pair | None = quantity(
        unit="m",
        left_out="everywhere",
        title="from where to where along the steepest ascent, from the origin, or along a pipe",
    )
    across_m: Pair | None = quantity(
        unit="m", left_out="everywhere", title="from where to where to the left of it, from the origin"
    )


class PlaneKeys(Section):
    """Keys of a plane."""

    slope_deg: float = quantity(
        0.0, unit="deg", gt=-90, lt=90, only=(PLANE, SLOPE_INTO_PIPE), title="angle, rising towards x"
    )
    heading_deg: float = quantity(
        0.0,
        unit="deg",
        only=(PLANE, PIPE, SLOPE_INTO_PIPE),
        title="azimuth of a plane's steepest ascent, or of a pipe where it starts, if not x",
        aka=("azimuth_deg",),
    )
    patches: Tables[Patch] = tables(
        only=(PLANE, PIPE),
        title="places with another friction, each a table of grip, along_m = [from, to] and (planes only) across_m; "
        "in a pipe along its centre line",
    )


class Piece(Section):
    """A straight piece (straight_m) or a bend (bend_deg, bend_radius_m, towards) of a pipe."""

    straight_m: float | None = quantity(unit="m", gt=0, left_out="a bend", title="length of a straight piece")
    bend_deg: float | None = quantity(unit="deg", gt=0, le=360, left_out="a straight piece", title="angle of a bend")
    bend_radius_m: float | None = quantity(
        unit="m", gt=0, left_out="a straight piece", title="radius of a bend's centre line"
    )
    towards: Literal["left", "right", "up", "down"] = setting("left", title="where a bend turns, seen along the pipe")


class Radius(Section):
    """A place along a pipe and its inner radius there; between two places the wall is a cone with rounded edges."""

    at_m: float = quantity(unit="m", title="how far along the pipe")
    radius_m: float = quantity(unit="m", gt=0, title="inner radius there")


class PipeKeys(Section):
    """Keys of a pipe."""

    radius_m: float = quantity(0.12, unit="m", gt=0, only=PIPES, title="inner radius")
    tilt_deg: float = quantity(
        0.0, unit="deg", ge=-90, le=90, only=PIPES, title="angle with the horizontal where it starts, 90: up"
    )
    pieces: Tables[Piece] = tables(
        only=PIPES,
        title="straight pieces and bends one after the other, none: straight, each a table of straight_m, "
        "or of bend_deg, bend_radius_m and towards = left, right, up or down",
    )
    points_m: Points = quantity(
        (),
        unit="m",
        only=PIPE,
        title="instead of tilt_deg and pieces, places [x, y, z] that it goes through",
    )
    radii: Tables[Radius] = tables(
        only=PIPES,
        title="instead of radius_m, places with at_m and radius_m, between them the wall is a cone",
    )
    rounding_m: float | None = quantity(
        unit="m",
        gt=0,
        only=PIPES,
        left_out="as round as there is room",
        title="radius of the edges where the wall's slope changes",
    )
    start_wall: bool = setting(False, only=PIPE, title="whether a wall closes it where it starts")
    end_wall: bool = setting(False, only=PIPE, title="whether a wall closes it where it ends")
    mouth_m: float = quantity(
        1.3, unit="m", only=SLOPE_INTO_PIPE, title="how far up the slope the pipe's bottom starts"
    )
    face_deg: float | None = quantity(
        unit="deg",
        gt=-90,
        lt=90,
        only=SLOPE_INTO_PIPE,
        left_out="the slope goes on",
        title="angle of the hill's face, which begins a radius of the pipe farther up than its bottom",
    )


class TerrainKeys(Section):
    """Keys of a heightfield."""

    surface: Literal["rubble", "steps", "sinusoid", "image"] = setting(
        "rubble",
        only=HEIGHTFIELD,
        title="stones at random, stairs up along x, waves along x, or a greyscale picture (file)",
    )
    spacing_m: float = quantity(0.02, unit="m", gt=0, only=HEIGHTFIELD, title="spacing of the heights")
    extent_m: Pair = quantity((4.0, 2.0), unit="m", only=HEIGHTFIELD, title="length from x = 0 and width about y = 0")
    height_m: float = quantity(
        0.03,
        unit="m",
        gt=0,
        only=HEIGHTFIELD,
        title="of the highest stone, a step, a crest above the mean, or white above black",
    )
    size_m: float = quantity(
        0.15,
        unit="m",
        gt=0,
        only=HEIGHTFIELD,
        title="radius of the largest stone, tread of a step, or wavelength",
    )
    ramp_m: float = quantity(0.1, unit="m", gt=0, only=HEIGHTFIELD, title="length over which a step rises")
    stones: int = quantity(0, ge=0, le=2**63 - 1, only=HEIGHTFIELD, title="seed of the stones")


class MeshKeys(Section):
    """Keys of a mesh."""

    file: str = setting(
        NO_FILE,
        only=FILES,
        title="an STL, OBJ, PLY or GLB file, or a PNG: beside the scene, shipped, or a path",
        aka=("path", "mesh", "image"),
        is_file=True,
    )
    units: Literal["unknown", "m", "cm", "mm", "in", "ft"] = setting(
        "unknown",
        only=MESH,
        title="of the file's coordinates; only GLB files say theirs",
        aka=("mesh_units",),
    )
    solid: Literal["inside", "outside"] = setting(
        "inside", only=MESH, title="what it encloses is solid, or free, as the air in a tunnel"
    )
    cell_m: float | None = quantity(
        unit="m", gt=0, only=MESH, left_out="a million cells", title="cell of its grid of distances"
    )
    up: Literal["z", "y"] = setting("z", only=MESH, title="the file's axis that points up")
    grip: float = quantity(1.0, ge=0, only=FILES, title="multiplier of the friction")


class WrittenKeys(MeshKeys, TerrainKeys, PipeKeys, PlaneKeys, KindOfWorld):
    """Keys of the kinds of which they are written out; the last class comes first in a written scene."""


class World(
    WrittenKeys,
    keys={key: of for key, of in NAMED.items() if key not in WrittenKeys.model_fields},
    holds={"kind": WORLD},
):
    """What the worm crawls on."""


def _share() -> None:
    """Let each kind that is found by name have the keys of its parameters, where others have them too."""
    for name, world in WORLDS.items():
        for known in parameters_of(world).values():
            extra = World.model_fields[key_of(known)].json_schema_extra
            if isinstance(extra, dict) and isinstance(only := extra["only"], list) and only and name not in only:
                only.append(name)


_share()
