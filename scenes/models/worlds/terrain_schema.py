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
