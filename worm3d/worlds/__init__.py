"""Where worms crawl: worlds given by signed distance, its gradient and curvature, and friction per place."""

from worm3d.worlds.base import World, WorldKernel
from worm3d.worlds.clamped import ClampedGround
from worm3d.worlds.heightfield import Heightfield
from worm3d.worlds.plane import Patch, Plane

__all__ = ["ClampedGround", "Heightfield", "Patch", "Plane", "World", "WorldKernel"]
