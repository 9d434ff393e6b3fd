"""Shape of the chain (lengths, apexes, angles) from its joints.

The leading dimensions "..." of the arrays are empty for a single instant, or for example (T,) for T instants.
"""

from __future__ import annotations

import numpy as np

from planar.linkage.segment_law import RHOMBUS, SegmentLaw, values
from worm3d.values.arrays import FloatArray

R = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Matrix that turns a vector by 90 degrees to the left."""


def diagonals(joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lengths and the unit tangents of the segments.

    The joints have the shape (..., N+1, 2) [m], the lengths (..., N) [m] and the tangents (..., N, 2).
    """
    e = joints[..., 1:, :] - joints[..., :-1, :]
    length = np.sqrt(e[..., 0] ** 2 + e[..., 1] ** 2)
    return length, e / length[..., None]


def apexes(joints: FloatArray, a: FloatArray) -> FloatArray:
    """Return the apexes [bottom, top] of each rhombus, midpoint -+ h n, shape (..., N, 2, 2) [m].

    The joints have the shape (..., N+1, 2) [m], and the lengths a of the links the shape (N,) [m].
    """
    e = joints[..., 1:, :] - joints[..., :-1, :]
    return _across(joints, np.sqrt(a**2 / (e[..., 0] ** 2 + e[..., 1] ** 2) - 0.25))


def apexes_by_law(joints: FloatArray, l_cmd: FloatArray, law: SegmentLaw) -> FloatArray:
    """Return the apexes [bottom, top] of segments with any segment law, shape (..., N, 2, 2) [m].

    The joints have the shape (..., N+1, 2) [m], and the commanded lengths the shape (..., N) [m].
    """
    if law.kind == RHOMBUS:
        return apexes(joints, law.link_length)
    length, _ = diagonals(joints)
    return _across(joints, values(length, l_cmd, law).height / length)


def _across(joints: FloatArray, w: FloatArray) -> FloatArray:
    """Return the apexes (K1) of segments whose ratios w = h/l have the shape (..., N)."""
    tail, head = joints[..., :-1, :], joints[..., 1:, :]
    e, middle = head - tail, 0.5 * (tail + head)
    points = np.empty((*e.shape[:-1], 2, 2))
    for j, reach in enumerate((-w, w)):
        points[..., j, 0] = middle[..., 0] - reach * e[..., 1]
        points[..., j, 1] = middle[..., 1] + reach * e[..., 0]
    return points


def cross_products(joints: FloatArray) -> FloatArray:
    """Return t1 x t2 of successive segments (P6), shape (..., N-1)."""
    _, t = diagonals(joints)
    return np.asarray(t[..., :-1, 0] * t[..., 1:, 1] - t[..., :-1, 1] * t[..., 1:, 0])


def joint_cosines(joints: FloatArray) -> FloatArray:
    """Return the cosine of the angle between successive segments, shape (..., N-1)."""
    _, t = diagonals(joints)
    return np.asarray(np.sum(t[..., :-1, :] * t[..., 1:, :], axis=-1))


def hinge_angles(length: FloatArray, a: FloatArray) -> FloatArray:
    """Return the angles of the apex hinges, 2 asin(l / 2a) [rad], in the shape of `length`."""
    return np.asarray(2.0 * np.arcsin(length / (2.0 * a)))
