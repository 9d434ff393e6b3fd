"""Radius of a pipe along its centre line. The wall consists of cylinders and cones with rounded edges between them.

Let s be the distance along the pipe, and rho the distance from its centre line. In the half-plane (s, rho), the wall is
a chain of straight pieces and circular arcs without kinks. The distance from such a chain is computed exactly, and its
gradient is continuous.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly
from worm3d.worlds.centreline import ROUNDING

MOST_PLACES = 200
"""Largest number of places. With this number the formula takes two seconds to compile. The time grows with the square
of the number."""

MAX_RAMP_SLOPE = np.deg2rad(80.0)
"""Largest slope of the wall [rad]. A step of the radius must therefore be given as a short ramp."""


@dataclass(frozen=True, eq=False)
class Profile(ReadOnly):
    """Radius of a pipe, linear between given places, with rounded corners, and constant before and after all places.

    Attributes
    ----------
    along, radius : array_like, shape (K,)
        Increasing distances along the centre line, and the radius there before corners are rounded [m].
    rounding : float or None
        Radius of the arcs that round the corners [m]. It is reduced where an arc would reach farther than half-way to
        the next corner. None means ten times the largest radius of the pipe, reduced in the same way.

    Raises
    ------
    ValueError
        The places do not increase, a radius or `rounding` is not above 0, or the wall is steeper than 80 degrees.
    """

    along: FloatArray
    radius: FloatArray
    rounding: float | None = None

    def __init__(self, along: ArrayLike, radius: ArrayLike, rounding: float | None = None) -> None:
        given = None if rounding is None else arguments.number("rounding", rounding, "m", gt=0.0)
        places, radii = arguments.array("along", along, ("K",)), arguments.array("radius", radius, ("K",), gt=0.0)
        vars(self).update(along=places, radius=radii, rounding=given)
        if self.along.shape != self.radius.shape or not (np.diff(self.along) > 0.0).all():
            raise ValueError(
                f"along, radius: got {arguments.shown(self.along)} and {arguments.shown(self.radius)}, must be as "
                "many, places increasing"
            )
        if len(self.along) > MOST_PLACES:
            raise ValueError(
                f"along: got {len(self.along)} places, must be at most {MOST_PLACES}; leave out those between which "
                "the radius changes evenly"
            )
        slopes = np.abs(np.arctan2(np.diff(self.radius), np.diff(self.along)))
        if len(slopes) and slopes.max() > MAX_RAMP_SLOPE:
            at = self.along[int(np.argmax(slopes))]
            raise ValueError(
                f"radius: rises or falls by {np.rad2deg(slopes.max()):.3g} degrees at {at:g} m, must be at most 80 "
                "degrees: make the ramp longer"
            )

    @property
    def constant(self) -> bool:
        """Whether the radius is the same everywhere."""
        return bool((self.radius == self.radius[0]).all())

    @property
    def changes(self) -> list[tuple[float, float]]:
        """Limits (from, to) of the stretches in which the radius changes [m]."""
        stretches, begin = [], None
        for (start, _), (end, _), _, after, _ in self._corners():
            begin = start if begin is None else begin
            if after == 0.0:
                stretches.append((begin, end))
                begin = None
        return stretches

    def pieces(self) -> FloatArray:
        """Return the pieces of the wall, shape (E, 5).

        Each row has s and rho at the start of the piece [m], cosine and sine of the direction there, and the curvature,
        which is positive if the centre of the arc lies outside the pipe [1/m]. The first piece has no start. Its row
        gives a point on the piece.
        """
        rows = [[float(self.along[0]), float(self.radius[0]), 1.0, 0.0, 0.0]]
        for begin, end, before, after, size in self._corners():
            rows.append([*begin, np.cos(before), np.sin(before), np.sign(after - before) / size])
            rows.append([*end, np.cos(after), np.sin(after), 0.0])
        return np.array(rows)

    def at(self, along: ArrayLike) -> FloatArray:
        """Return the radius at distances of shape (...) along the pipe, shape (...) [m]."""
        s, table = np.asarray(along, dtype=float), self.pieces()
        k = np.maximum(np.searchsorted(table[1:, 0], s, side="right"), 0)
        s0, r0, cosine, sine, kappa = np.moveaxis(table[k], -1, 0)
        safe = np.where(kappa == 0.0, 1.0, kappa)
        # On an arc sin(direction) = sin(direction_0) + kappa (s - s0), and r = r0 + (cos_0 - cos)/kappa.
        turned = sine + kappa * (s - s0)
        level = np.sqrt(np.maximum(1.0 - turned**2, 0.0))
        return np.asarray(np.where(kappa == 0.0, r0 + (s - s0) * sine / cosine, r0 + (cosine - level) / safe))

    def _corners(self) -> list[tuple[tuple[float, float], tuple[float, float], float, float, float]]:
        """Return the rounded corners.

        Each item has (s, rho) at the begin and at the end of the arc [m], the direction of the wall before and after
        the arc [rad], and the radius of the arc [m].
        """
        s, r = self.along, self.radius
        direction = np.concatenate([[0.0], np.arctan2(np.diff(r), np.diff(s)), [0.0]])
        sides = np.concatenate([[np.inf], np.hypot(np.diff(r), np.diff(s)), [np.inf]])
        found = []
        for k in range(len(s)):
            before, after = float(direction[k]), float(direction[k + 1])
            turn = abs(after - before)
            if turn < ROUNDING:
                continue
            room = min(sides[k], sides[k + 1]) / 2.0 / np.tan(turn / 2.0)
            wanted = 10.0 * float(r.max()) if self.rounding is None else self.rounding
            size = float(min(room, wanted))
            arm = size * np.tan(turn / 2.0)
            begin = float(s[k] - arm * np.cos(before)), float(r[k] - arm * np.sin(before))
            end = float(s[k] + arm * np.cos(after)), float(r[k] + arm * np.sin(after))
            found.append((begin, end, before, after, size))
        return found
