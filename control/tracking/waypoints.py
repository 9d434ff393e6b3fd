"""Paths of straight legs and arcs: way points with rounded corners, and pipes seen from above."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from control.tracking.curves import Curve, require_apart, require_points
from worm3d import Bend, Centreline, Straight
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly


@dataclass(frozen=True, eq=False)
class PlanView(ReadOnly, Curve):
    """The centre line of a pipe seen from above.

    Attributes
    ----------
    centreline : worm3d.Centreline
        Nowhere vertical.
    """

    centreline: Centreline

    def __post_init__(self) -> None:
        arguments.instance("centreline", self.centreline, Centreline, "a worm3d.Centreline")
        if np.linalg.norm(self.centreline.at(self._nodes_of_line())[1][:, :2], axis=1).min() < 1e-3:
            raise ValueError("centreline: it is vertical somewhere, where it has no heading; follow a level part of it")

    def knots(self) -> FloatArray:
        """Return the ends of its pieces; see `Curve`."""
        return np.concatenate([[0.0], self.centreline.ends])

    def derivatives(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return r, r' and r'' at distances u along the line; see `Curve`."""
        line = self.centreline
        points, tangents = line.at(u)
        begins = line.ends - line.length
        k = np.clip(np.searchsorted(begins, u, side="right") - 1, 0, len(begins) - 1)
        turn = (line.curvature[k] * (u - begins[k]))[:, None]
        normal = np.cos(turn) * line.normal[k] - np.sin(turn) * line.tangent[k]
        return points[:, :2], tangents[:, :2], (line.curvature[k][:, None] * normal)[:, :2]

    def _nodes_of_line(self) -> FloatArray:
        return np.linspace(0.0, self.centreline.total, 64 * len(self.centreline.length) + 1)


class WayPoints(PlanView):
    """Straight legs from point to point, the corners rounded by arcs of one radius; it passes beside inner points.

    Attributes
    ----------
    points : ndarray, shape (P, 2)
        At least two, each apart from the next [m].
    radius : float
        Of the arcs [m].

    Raises
    ------
    ValueError
        Points that coincide or turn back, or legs too short for the radius.
    """

    points: FloatArray
    radius: float

    def __init__(self, points: ArrayLike, radius: float = 1.0) -> None:
        object.__setattr__(self, "points", require_points(points, 2))
        object.__setattr__(self, "radius", arguments.number("radius", radius, "m", gt=0.0))
        require_apart(self.points)
        super().__init__(_rounded(self.points, self.radius))


def _rounded(points: FloatArray, radius: float) -> Centreline:
    """Return legs and arcs."""
    legs = np.diff(points, axis=0)
    length, azimuth = np.linalg.norm(legs, axis=1), np.arctan2(legs[:, 1], legs[:, 0])
    turn = np.mod(np.diff(azimuth) + np.pi, 2.0 * np.pi) - np.pi
    cut = np.concatenate([[0.0], radius * np.tan(np.abs(turn) / 2.0), [0.0]])
    left = length - cut[:-1] - cut[1:]
    if left.min() < -1e-9 * length.max():
        k = int(np.argmin(left))
        raise ValueError(
            f"radius: got {radius!r} m, too large for the leg of {length[k]:.4g} m from point {k} to {k + 1}: its "
            f"corners take {cut[k] + cut[k + 1]:.4g} m; choose a smaller radius or move the points apart"
        )
    pieces: list[Straight | Bend] = []
    for k, rest in enumerate(left):
        if rest > 1e-9 * length.max():
            pieces.append(Straight(float(rest)))
        if k < len(turn) and abs(turn[k]) > 1e-9:
            pieces.append(Bend(abs(float(turn[k])), radius, "left" if turn[k] > 0.0 else "right"))
    return Centreline.of(pieces, (*points[0], 0.0), float(azimuth[0]))
