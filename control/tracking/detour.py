"""A path around obstacles, and the body that has to stay clear of the obstacles."""

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
    """Dimensions of a worm for the search of a way."""

    length: float
    """Length at rest [m]."""
    half_width: float
    """Greatest half width of a segment, at the end of its stroke [m]."""

    @classmethod
    def of(cls, worm: Worm) -> Self:
        """Return the body of a worm; the half width is b + sqrt(a^2 - l^2/4) for the shortest length l of a segment."""
        shortest = worm.l0 * (1.0 - worm.stroke[1])
        rise = np.sqrt(np.maximum(worm.link_length**2 - shortest**2 / 4.0, 0.0))
        return cls(worm.length, worm.chamber_offset + float(rise.max()))

    def clearance(self, obstacles: Sequence[Obstacle], places: FloatArray, azimuths: FloatArray) -> FloatArray:
        """Return the distances of bodies at places (..., 2) [m] from obstacles, (...) [m]; below 0 inside.

        The distances are those of circles around 21 spots along the chord, which miss 0.003 of the body.
        """
        spots = places[..., None, :] + self.length * np.linspace(-0.5, 0.5, 21)[:, None] * ahead(azimuths)[..., None, :]
        return np.asarray(nearest(obstacles, spots).min(axis=-1) - self.half_width)


def ahead(azimuth: FloatArray) -> FloatArray:
    """Return the unit vectors of azimuths (...) [rad], (..., 2)."""
    return np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)


@dataclass(frozen=True, eq=False)
class Detour(SplinePath):
    """A path around obstacles; the points lie at equal distances along the wanted path."""

    asked: Path = field(kw_only=True)
    """Wanted path, without the detour."""
    along: FloatArray = field(kw_only=True)
    """Arc lengths of the wanted path beside the points [m], shape (P,)."""
    aside: FloatArray = field(kw_only=True)
    """Offsets of the points to the left of the wanted path [m], shape (P,)."""
    bounds: FloatArray = field(kw_only=True)
    """Greatest offsets of the middle to the left and right of the way, then of the body, [m], shape (4, P)."""
    unknown: tuple[Obstacle, ...] = field(kw_only=True, default=())
    """Obstacles that the worm detects only nearby."""

    def bounds_at(self, s: FloatArray) -> FloatArray:
        """Return the bounds at arc lengths (K,) of the way [m], shape (4, K)."""
        period = self.length if self.closed else None
        return np.array([np.interp(s, self.lengths, each, period=period) for each in self.bounds])

    @cached_property
    def lengths(self) -> FloatArray:
        """Arc lengths of the points along the way [m], shape (P,)."""
        return np.asarray(self._nodes[1][::PARTS][: len(self.points)])
