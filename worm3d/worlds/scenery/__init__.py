"""What worlds look like: the part of each that surrounds a worm, as meshes for pictures.

A further world is a further file with a function under `@scenery.register`, imported here. A world without one is drawn
from its signed distance.
"""

from worm3d.worlds.scenery import mesh, pipe, plane, terrain, union
from worm3d.worlds.scenery.base import Scenery, Window, scenery, tile_size
from worm3d.worlds.scenery.ground import on_ground

__all__ = ["Scenery", "Window", "mesh", "on_ground", "pipe", "plane", "scenery", "terrain", "tile_size", "union"]
