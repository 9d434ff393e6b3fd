"""A path around obstacles, and the body that is to stay clear of them on it."""

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
from worm3d.values.read_only import read_only

SPOTS = 21
"""Number of spots along the chord at which the distance of the body is taken: circles around them miss 0.003 of it."""


class Body(NamedTuple):
    """What a way has to know of a worm."""

    length: float
    """Length at rest [m]."""
    half_width: float
    """Greatest half width of a segment, at the end of its stroke [m]."""

    @classmethod
    def of(cls, worm: Worm) -> Self:
        """Return that of a worm: b + sqrt(a^2 - l^2/4), l being the shortest length of a segment."""
        shortest = worm.l0 * (1.0 - worm.stroke[1])
        rise = np.sqrt(np.maximum(worm.link_length**2 - shortest**2 / 4.0, 0.0))
        return cls(worm.length, worm.chamber_offset + float(rise.max()))

    def clearance(self, obstacles: Sequence[Obstacle], places: FloatArray, azimuths: FloatArray) -> FloatArray:
        """Return the distances of bodies at places (..., 2) [m] from obstacles, (...) [m]; below 0 inside."""
        along = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=-1)
        spots = places[..., None, :] + self.length * np.linspace(-0.5, 0.5, SPOTS)[:, None] * along[..., None, :]
        return np.asarray(nearest(obstacles, spots).min(axis=-1) - self.half_width)


@dataclass(frozen=True, eq=False)
class Detour(SplinePath):
    """A path around obstacles; its points lie at equal distances along the path that was asked for."""

    asked: Path = field(kw_only=True)
    """Path that was asked for."""
    along: FloatArray = field(kw_only=True)
    """Arc lengths of that path beside the points [m], shape (P,)."""
    aside: FloatArray = field(kw_only=True)
    """Offsets of the points to the left of it [m], shape (P,)."""
    bounds: FloatArray = field(kw_only=True)
    """How far the middle may be to the left and to the right of the way, and the body, [m], shape (4, P)."""
    unknown: tuple[Obstacle, ...] = field(kw_only=True, default=())
    """Obstacles that the worm comes to know of when they are near."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("along", "aside", "bounds"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def bounds_at(self, s: FloatArray) -> FloatArray:
        """Return the bounds at arc lengths (K,) of the way [m], shape (4, K)."""
        period = self.length if self.closed else None
        return np.array([np.interp(s, self.lengths, each, period=period) for each in self.bounds])

    @cached_property
    def lengths(self) -> FloatArray:
        """Arc lengths of the points along the way [m], shape (P,)."""
        return np.asarray(self._nodes[1][::PARTS][: len(self.points)])
