"""Places on the ground below others: lines that say where a worm goes are drawn there."""

from __future__ import annotations

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.worlds.base import World

MOST_STEPS = 80
"""Steps of a distance at a time; on a plane of 60 degrees they take half of what is left, at 80 degrees a sixth."""

EXACT = 1e-6
"""Distance from the ground at which a place is on it, in body lengths."""

DEEPEST = 1.0
"""How far below a place the ground may be, in body lengths."""


def on_ground(world: World | None, places: FloatArray, body_length: float, above: float = 0.0) -> FloatArray:
    """Return places, shape (..., 3), moved along z on to the world; those with no ground near stay where they are [m].

    A place goes down by its distance again and again, which never leads beyond the surface nearest to it ("sphere
    tracing", Hart 1996, The Visual Computer 12, 527); one below the ground comes up.

    Parameters
    ----------
    world : World or None
    places : ndarray, shape (..., 3)
        [m].
    body_length : float
        [m].
    above : float
        Height over the ground, so that lines are seen [m].
    """
    result = np.array(places, dtype=float)
    if world is None:
        return result
    moving = result.reshape(-1, 3).copy()
    searched = np.arange(len(moving))
    for _ in range(MOST_STEPS):
        distance = world.distance(moving[searched])
        far = np.abs(distance) > EXACT * body_length
        moving[searched[far], 2] -= distance[far]
        gone = np.abs(moving[searched, 2] - result.reshape(-1, 3)[searched, 2]) > DEEPEST * body_length
        found = searched[~far & ~gone]
        result.reshape(-1, 3)[found] = moving[found] + [0.0, 0.0, above]
        searched = searched[far & ~gone]
        if not len(searched):
            break
    return result
