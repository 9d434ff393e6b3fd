"""A straight worm laid over uneven ground from above, so that nothing of it is inside."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from worm3d.values.arrays import FloatArray

REACH = 1.6
"""How far the body reaches sideways from its axis, in clearances: the outward apexes of the default worm."""

SOLE = 0.8
"""It is as deep as the clearance up to this offset, in clearances, and rises to its axis from there to `REACH`."""

ACROSS, ALONG = 17, 129
"""Samples of the ground under the body."""


def laid(
    height: Callable[[FloatArray], FloatArray],
    along: FloatArray,
    clearance: float,
    position: FloatArray,
    azimuth: float,
) -> tuple[FloatArray, FloatArray]:
    """Return joints and director of a straight worm on ground of which the height is known; see `World.placed`.

    The axis is the line that is nowhere lower than the body needs, and lowest in its middle: the edge of the upper
    convex hull, over that middle, of what each place asks for.

    Parameters
    ----------
    height : callable
        Height of the ground at x, y of shape (M, 2), shape (M,) [m].
    """
    forward = np.array([np.cos(azimuth), np.sin(azimuth)])
    left = np.array([-forward[1], forward[0]])
    s = np.linspace(along[0] - clearance, along[-1] + clearance, ALONG)
    w = clearance * REACH * np.linspace(-1.0, 1.0, ACROSS)
    deep = clearance * np.clip((REACH - np.abs(w) / clearance) / (REACH - SOLE), 0.0, 1.0)
    ground = height((position + s[:, None, None] * forward + w[:, None] * left).reshape(-1, 2))
    needed = _widened((ground.reshape(ALONG, ACROSS) + deep).max(axis=1), s, clearance / 2.0)
    begin, rise = _lowest_line_above(s, needed, float(along[[0, -1]].mean()))
    tangent = np.append(forward, rise) / np.hypot(1.0, rise)
    # Needed along the line's normal what the ground asks for upwards.
    lift = begin + (np.hypot(1.0, rise) - 1.0) * clearance
    return np.append(position, lift) + along[:, None] * tangent, np.append(left, 0.0)


def _widened(values: FloatArray, s: FloatArray, reach: float) -> FloatArray:
    """Return the greatest value within a reach of each place."""
    near = np.abs(s[:, None] - s) <= reach
    widest: FloatArray = np.where(near, values, -np.inf).max(axis=1)
    return widest


def _lowest_line_above(s: FloatArray, values: FloatArray, middle: float) -> tuple[float, float]:
    """Return height at 0 and slope of the line above all values that is lowest in the middle."""
    floor = values.min() - 1.0
    points = np.vstack([np.column_stack([s, values]), [[s[0], floor], [s[-1], floor]]])
    hull = scipy.spatial.ConvexHull(points).simplices
    ends = points[hull]
    over = (
        (ends[:, :, 0].min(axis=1) <= middle)
        & (middle <= ends[:, :, 0].max(axis=1))
        & (ends[:, :, 1].min(axis=1) > floor)
    )
    (s_0, z_0), (s_1, z_1) = ends[over][0]
    rise = (z_1 - z_0) / (s_1 - s_0)
    return float(z_0 - rise * s_0), float(rise)
