"""Worms at rest in a pipe: on its bottom, or on the centre line of a steep one."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import scipy

from worm3d.values.arrays import FloatArray
from worm3d.worlds.centreline import Centreline

STEEP = np.deg2rad(60.0)
"""A worm on a stretch steeper than this is put on the centre line, not on the bottom."""

UP = np.array([0.0, 0.0, 1.0])


def in_pipe(
    line: Centreline, radius_at: Callable[[FloatArray], FloatArray], along: FloatArray, tail: float, clearance: float
) -> tuple[FloatArray, FloatArray]:
    """Return joints (N+1, 3) and directors (N, 3) of a worm with its tail at a distance along the centre line.

    Parameters
    ----------
    along : ndarray, shape (N+1,)
        Distances of the joints from the tail, negative where the head looks back [m].
    clearance : float
        Distance of the joints from the wall [m]; on a steep stretch they have at least that.

    Raises
    ------
    ValueError
        The pipe is narrower than the clearance.
    """
    sample = tail + along
    narrow = float(np.min(radius_at(sample)))
    if clearance > narrow:
        raise ValueError(
            f"the pipe is narrower than the worm: a radius of {narrow:.4g} m leaves no room for it; make the pipe "
            "wider, or the worm thinner (half_height, chamber_offset)"
        )
    steep = bool(np.max(np.abs(line.at(sample)[1][:, 2])) > np.sin(STEEP))

    def on_path(s: float) -> FloatArray:
        point, tangent = line.at(s)
        if steep:
            return point
        up = UP - tangent[2] * tangent
        below: FloatArray = point - (radius_at(np.array(s)) - clearance) * up / np.linalg.norm(up)
        return below

    joints = _spaced(on_path, along, tail)
    edges = np.diff(joints, axis=0)
    tangents = edges / np.linalg.norm(edges, axis=1)[:, None]
    return joints, _carried(tangents) if steep else _level(tangents)


def normal_to(tangent: FloatArray) -> FloatArray:
    """Return a unit vector normal to another one: level, and along y where that one is vertical, shape (3,)."""
    level = np.cross(UP, tangent)
    size = float(np.linalg.norm(level))
    normal: FloatArray = level / size if size > 1e-9 else np.array([0.0, 1.0, 0.0])
    return normal


def _spaced(on_path: Callable[[float], FloatArray], along: FloatArray, tail: float) -> FloatArray:
    """Return points on a path as far from one another as the joints."""
    s, joints = tail, [on_path(tail)]
    for way in np.diff(along):

        def too_far(to: float, begin: FloatArray = joints[-1], length: float = abs(way)) -> float:
            return float(np.linalg.norm(on_path(to) - begin)) - length

        reach = 2.0 * way
        while too_far(s + reach) < 0.0:
            reach *= 2.0
        s = scipy.optimize.brentq(too_far, s, s + reach, xtol=1e-15, rtol=1e-14)
        joints.append(on_path(s))
    return np.array(joints)


def _level(tangents: FloatArray) -> FloatArray:
    return np.array([normal_to(t) for t in tangents])


def _carried(tangents: FloatArray) -> FloatArray:
    """Return directors carried from the first by parallel transport: a worm without twist."""
    directors = [normal_to(tangents[0])]
    for a, b in pairwise(tangents):
        d = directors[-1]
        directors.append(d - (d @ b) / (1.0 + a @ b) * (a + b))
    return np.array(directors)
