"""Worlds for worms to crawl in: a signed distance with gradient and Hessian, and the friction of each place."""

from worm3d.worlds.base import WORLDS, World
from worm3d.worlds.centreline import Bend, Centreline, Straight
from worm3d.worlds.foot import Foot
from worm3d.worlds.groove import Groove
from worm3d.worlds.heightfield import Heightfield
from worm3d.worlds.kernels import WorldKernel
from worm3d.worlds.mesh import Mesh
from worm3d.worlds.mesh_file import MeshError
from worm3d.worlds.pipe import Pipe
from worm3d.worlds.plane import ClampedGround, Patch, Plane
from worm3d.worlds.profile import Profile
from worm3d.worlds.union import Union, slope_into_pipe

__all__ = [
    "Bend",
    "Centreline",
    "ClampedGround",
    "Foot",
    "Groove",
    "Heightfield",
    "Mesh",
    "MeshError",
    "Patch",
    "Pipe",
    "Plane",
    "Profile",
    "Straight",
    "Union",
    "WORLDS",
    "World",
    "WorldKernel",
    "slope_into_pipe",
]
