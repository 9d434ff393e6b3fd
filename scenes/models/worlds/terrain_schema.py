"""Keys of the section [world] for terrain, and for worlds from mesh files."""

from __future__ import annotations

from typing import Literal

from scenes.language.schema import Pair, Section, quantity, setting

HEIGHTFIELD, MESH = "heightfield", "mesh"
FILES = (HEIGHTFIELD, MESH)

NO_FILE = "none"
"""What stands for a file that is not given."""


class TerrainKeys(Section):
    """Keys of a heightfield."""

    surface: Literal["rubble", "steps", "sinusoid", "image"] = setting(
        "rubble",
        only=HEIGHTFIELD,
        title="heightfield only: stones at random, stairs up along x, waves along x, or a greyscale picture (file)",
    )
    spacing_m: float = quantity(
        0.02, unit="m", gt=0, only=HEIGHTFIELD, title="heightfield only: spacing of the heights"
    )
    extent_m: Pair = quantity(
        (4.0, 2.0), unit="m", only=HEIGHTFIELD, title="heightfield only: length from x = 0 and width about y = 0"
    )
    height_m: float = quantity(
        0.03,
        unit="m",
        gt=0,
        only=HEIGHTFIELD,
        title="heightfield only: of the highest stone, a step, a crest above the mean, or white above black",
    )
    size_m: float = quantity(
        0.15,
        unit="m",
        gt=0,
        only=HEIGHTFIELD,
        title="heightfield only: radius of the largest stone, tread of a step, or wavelength",
    )
    ramp_m: float = quantity(
        0.1, unit="m", gt=0, only=HEIGHTFIELD, title="heightfield only: length over which a step rises"
    )
    stones: int = quantity(0, ge=0, le=2**63 - 1, only=HEIGHTFIELD, title="heightfield only: seed of the stones")


class MeshKeys(Section):
    """Keys of a mesh."""

    file: str = setting(
        NO_FILE,
        only=FILES,
        title="mesh and picture only: an STL, OBJ, PLY or GLB file, or a PNG: beside the scene, shipped, or a path",
        aka=("path", "mesh", "image"),
    )
    units: Literal["unknown", "m", "cm", "mm", "in", "ft"] = setting(
        "unknown",
        only=MESH,
        title="mesh only: of the file's coordinates; only GLB files say theirs",
        aka=("mesh_units",),
    )
    solid: Literal["inside", "outside"] = setting(
        "inside", only=MESH, title="mesh only: what it encloses is solid, or free, as the air in a tunnel"
    )
    cell_m: float | None = quantity(
        unit="m", gt=0, only=MESH, left_out="a million cells", title="mesh only: cell of its grid of distances"
    )
    up: Literal["z", "y"] = setting("z", only=MESH, title="mesh only: the file's axis that points up")
    grip: float = quantity(1.0, ge=0, only=FILES, title="heightfield and mesh only: multiplier of the friction")
