"""Where worms crawl: worlds given by signed distance, its gradient and curvature, and friction per place."""

from worm3d.worlds.base import World, WorldKernel
from worm3d.worlds.centreline import Bend, Centreline, Straight
from worm3d.worlds.clamped import ClampedGround
from worm3d.worlds.pipe import Pipe
from worm3d.worlds.plane import Patch, Plane
from worm3d.worlds.profile import Profile

__all__ = [
    "Bend",
    "Centreline",
    "ClampedGround",
    "Patch",
    "Pipe",
    "Plane",
    "Profile",
    "Straight",
    "World",
    "WorldKernel",
]
