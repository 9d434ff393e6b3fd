"""The section [world]: what the worm crawls on; the keys of each kind stand in a file of their own.

A further kind is a further word of `kind`, a class of its keys (with `only`), and its builder in `worlds_build.WORLDS`.
"""

from __future__ import annotations

from typing import Literal

from scenes.language.schema import Section, setting
from scenes.models.worlds.pipe_schema import PipeKeys
from scenes.models.worlds.plane_schema import PLANE, ClampedKeys, PlaneKeys
from scenes.models.worlds.terrain_schema import MeshKeys, TerrainKeys


class KindOfWorld(Section):
    """Which kind of world it is."""

    kind: Literal["plane", "pipe", "slope_into_pipe", "heightfield", "mesh", "clamped", "none"] = setting(
        PLANE,
        title="plane, the inside of a pipe, a slope that leads into one, a heightfield or a mesh: the worm touches it; "
        "clamped: the paper's ground holds the joints' heights; none: nothing there",
        aka=("type",),
    )


# The last class comes first in a written scene.
class World(ClampedKeys, MeshKeys, TerrainKeys, PipeKeys, PlaneKeys, KindOfWorld):
    """What the worm crawls on."""
