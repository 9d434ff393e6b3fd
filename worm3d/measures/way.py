"""Forward distance of a worm, and the path of its centre of mass along the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from worm3d.recorded.finished import FinishedRun
from worm3d.recorded.series import heading
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import kept

if TYPE_CHECKING:
    from worm3d.worlds import World

NO_HEADING = "the body is vertical at the start, and a vertical body has no heading"
NO_PERIOD = "the actuation has no `period` [s] for the average of the centre of mass"
NO_WAY = 1e-9
"""Largest distance that counts as rounding, as a fraction of the body length."""


def way(com: FloatArray, joints: FloatArray, world: World | None) -> FloatArray | None:
    """Return the forward position of each centre of mass, shape (T,) [m]; None for a vertical body.

    Forward is the direction of the heading of the joints in the world's tangent plane. In a pipe, it is the direction
    of the centre line towards the head.

    Parameters
    ----------
    com : ndarray, shape (T, 3)
        Centres of mass [m].
    joints : ndarray, shape (N+1, 3)
        Joints, which define the heading [m].
    world : World or None
    """
    course = None if world is None else world.course(com, joints)
    if course is not None:
        return course
    azimuth = heading(joints[None])[0]
    if np.isnan(azimuth):
        return None
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return com @ (level / np.linalg.norm(level) if world is None else world.forward(joints, level))


@kept
def distance(result: FinishedRun) -> float:
    """Return the forward displacement of the centre of mass, as defined in `way` [m]; NaN for a vertical body."""
    return distance_of(result.com, result.joints[0], result.world)


def distance_of(com: FloatArray, joints: FloatArray, world: World | None) -> float:
    """Return the forward displacement from the first to the last centre of mass [m]; NaN for a vertical body."""
    ends = way(com[[0, -1]], joints, world)
    return float("nan") if ends is None else float(ends[-1] - ends[0])


def along_the_ground(result: FinishedRun) -> FloatArray:
    """Return the centre of mass without its height over a plane, since a worm that only rises does not advance."""
    if result.world is None or not result.world.flat:
        return result.com
    normal = result.world.normal(result.joints[0].mean(axis=0), result.worm.length)
    return result.com - (result.com @ normal)[:, None] * normal
