"""A smooth curve through points as a chain of circular arcs: a cubic spline, replaced by pairs of arcs.

A biarc joins two points with given tangents by two arcs that meet without a kink (Bolton, "Biarc curves", 1975;
in space Sharrock, "Biarcs in three dimensions", 1987). With v = p_2 - p_1 and equal arms d from the ends along the
tangents to the arcs' corners, the corners p_1 + d t_1 and p_2 - d t_2 are 2 d apart:

    2 (1 - t_1.t_2) d^2 + 2 v.(t_1 + t_2) d - v.v = 0,

and the arcs meet half-way between them.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import scipy

from worm3d.values.arrays import FloatArray

Pieces = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]

STRAIGHT = 1e-9
"""An arc that turns by less than this angle [rad] is a straight piece."""


def samples(points: FloatArray, spans: int) -> tuple[FloatArray, FloatArray]:
    """Return places and unit tangents of the spline through points (P, 3), `spans` to each stretch, each (S, 3)."""
    chord = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    spline = scipy.interpolate.CubicSpline(chord, points, bc_type="natural" if len(points) > 2 else "not-a-knot")
    at = np.concatenate([np.linspace(a, b, spans, endpoint=False) for a, b in pairwise(chord)])
    at = np.append(at, chord[-1])
    slope = spline(at, 1)
    return spline(at), slope / np.linalg.norm(slope, axis=1)[:, None]


def pieces(places: FloatArray, tangents: FloatArray, longest: float) -> Pieces:
    """Return start, tangent, normal, curvature and length of the arcs through places (S, 3) with unit tangents.

    Raises
    ------
    ValueError
        An arc turns by more than `longest` [rad].
    """
    rows = []
    for k in range(len(places) - 1):
        p, q, t, u = places[k], places[k + 1], tangents[k], tangents[k + 1]
        meet, across = _joint(p, q, t, u)
        rows += [_arc(p, t, meet), _arc(meet, across, q)]
    turn = max(row[3] * row[4] for row in rows)
    if turn > longest:
        raise ValueError(
            f"points: the line through them turns by {turn:.3g} rad at once; put the points closer together"
        )
    return tuple(map(np.array, zip(*rows, strict=True)))  # type: ignore[return-value]


def _joint(p: FloatArray, q: FloatArray, t: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return where two arcs meet, and their common tangent there."""
    v = q - p
    a, b, c = 2.0 * (1.0 - float(t @ u)), 2.0 * float(v @ (t + u)), -float(v @ v)
    d = -2.0 * c / (b + np.sqrt(b * b - 4.0 * a * c))  # the positive root, also for a -> 0
    corners = p + d * t, q - d * u
    across = corners[1] - corners[0]
    return (corners[0] + corners[1]) / 2.0, across / float(np.linalg.norm(across))


def _arc(p: FloatArray, t: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float, float]:
    """Return start, tangent, normal, curvature and length of the arc from p with the tangent t to q."""
    v = q - p
    ahead = float(v @ t)
    aside = v - ahead * t
    side = float(np.linalg.norm(aside))
    half = float(np.arctan2(side, ahead))  # of the angle by which it turns
    if half < STRAIGHT:
        return p, t, _any_normal(t), 0.0, ahead
    chord = float(np.linalg.norm(v))
    return p, t, aside / side, 2.0 * np.sin(half) / chord, chord * half / np.sin(half)


def _any_normal(t: FloatArray) -> FloatArray:
    normal = np.cross(t, np.eye(3)[int(np.argmin(np.abs(t)))])
    return normal / float(np.linalg.norm(normal))
