"""What heightfields look like: their spline in squares."""

from __future__ import annotations

import numpy as np

from worm3d.viewer.world import chequered, heightfield
from worm3d.worlds.heightfield import Heightfield
from worm3d.worlds.scenery.base import FINEST, MARGIN, Scenery, Window, scenery, tile_size


@scenery.register
def _heightfield(world: Heightfield, window: Window) -> Scenery:
    margin = MARGIN * window.body_length
    low, high = window.points.min(axis=0)[:2] - margin, window.points.max(axis=0)[:2] + margin
    tile = tile_size(window.body_length, high - low)
    low, high = tile * np.floor(low / tile), tile * np.ceil(high / tile)
    parts = int(np.ceil(tile / max(min(FINEST * window.body_length, world.spacing), 0.1 * tile)))
    x, y = (np.linspace(a, b, round((b - a) / tile) * parts + 1) for a, b in zip(low, high, strict=True))
    height = world.height(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
    return Scenery(chequered(heightfield(x, y, height), tile, together=2))
