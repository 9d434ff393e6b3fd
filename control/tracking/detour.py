"""A path around obstacles, and the dimensions of the body that has to stay clear of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from control.tracking.curves import PARTS
from control.tracking.obstacles import Obstacle, nearest
from control.tracking.paths import Path, SplinePath
from worm3d import Worm
from worm3d.values.arrays import FloatArray


class Body(NamedTuple):
    """Dimensions of a worm for the search of a way around obstacles."""

    length: float
    """Length at rest [m]."""
    half_width: float
    """Greatest half width of a segment, reached at the end of its stroke [m]."""

    @classmethod
    def of(cls, worm: Worm) -> Self:
        """Return the dimensions of a worm.

        The half width is the outward distance of a chamber with the shortest length of a segment. For rhombi it is
        b + sqrt(a^2 - l^2/4), where l is this length.
        """
        shortest = np.full((worm.segments, 1), worm.l0 * (1.0 - worm.stroke[1]))
        _, outward = worm.segment.free_outlines(worm, shortest)
        return cls(worm.length, float(outward.max()))

    def clearance(self, obstacles: Sequence[Obstacle], places: FloatArray, azimuths: FloatArray) -> FloatArray:
        """Return the distances of bodies from the nearest obstacle, shape (...) [m]. They are negative inside.

        `places` are the middles of the bodies, shape (..., 2) [m], and `azimuths` their directions, shape (...) [rad].
        A body is represented by circles around 21 points of its chord. The error is at most 0.003 body lengths.
        """
        spots = places[..., None, :] + self.length * np.linspace(-0.5, 0.5, 21)[:, None] * ahead(azimuths)[..., None, :]
        return np.asarray(nearest(obstacles, spots).min(axis=-1) - self.half_width)


def ahead(azimuth: FloatArray) -> FloatArray:
    """Return the unit vectors in the direction of azimuths, shape (..., 2) for azimuths of shape (...) [rad]."""
    return np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)


@dataclass(frozen=True, eq=False)
class Detour(SplinePath):
    """A spline around obstacles. Its points are next to points at equal distances along the requested path."""

    asked: Path = field(kw_only=True)
    """Requested path, without the detour."""
    along: FloatArray = field(kw_only=True)
    """Arc lengths along the requested path that belong to the points [m], shape (P,)."""
    aside: FloatArray = field(kw_only=True)
    """Offsets of the points to the left of the requested path [m], shape (P,)."""
    bounds: FloatArray = field(kw_only=True)
    """Greatest offsets from the detour [m], shape (4, P): of the middle of the body to the left and to the right, then
    of both ends of the body to the left and to the right."""
    unknown: tuple[Obstacle, ...] = field(kw_only=True, default=())
    """Obstacles that the worm detects only when it is near them."""

    def bounds_at(self, s: FloatArray) -> FloatArray:
        """Return the bounds at arc lengths `s` of the detour [m], shape (4, K) for `s` of shape (K,)."""
        period = self.length if self.closed else None
        return np.array([np.interp(s, self.lengths, each, period=period) for each in self.bounds])

    @cached_property
    def lengths(self) -> FloatArray:
        """Arc lengths along the detour at its points [m], shape (P,)."""
        return np.asarray(self._nodes[1][::PARTS][: len(self.points)])
