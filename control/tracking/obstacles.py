"""Obstacles on the ground that the worm goes around.

An obstacle is the set of points within a radius of its spine, the convex hull of a sequence of points. The signed
distance from an obstacle is negative inside. It is defined once, by a CasADi expression, which is also evaluated for
numbers. To add a shape, add a class to this file and a row to `OBSTACLES`. `control.tracking.detour` adds the space
that the worm needs beside an obstacle.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.spelling import Spelled


def seen_from() -> Any:
    """Return the field `sight` of an obstacle."""
    meaning = "the controller knows of an obstacle whose edge is nearer than this to the middle line of the worm"
    return parameter(math.inf, meaning=meaning, unit="m", gt=0, infinite=True, left_out="known from the start")


class Obstacle(Spelled, ABC):
    """A convex obstacle, a frozen dataclass."""

    radius: float
    sight: float = math.inf
    """Distance from the obstacle's edge to the worm's middle line below which the controller detects the obstacle
    [m]."""

    def __post_init__(self) -> None:
        check(self)

    @property
    @abstractmethod
    def spine(self) -> FloatArray:
        """Points of the spine in order, along a line or around an area [m], shape (M, 2)."""

    @abstractmethod
    def distance(self, x: ca.SX, y: ca.SX) -> ca.SX:
        """Return the signed distance of a place from the obstacle, negative inside [m]."""

    def distances(self, places: ArrayLike) -> FloatArray:
        """Return the signed distances of places, shape (...) for places of shape (..., 2) [m].

        NaN for places with NaN.
        """
        given = np.asarray(places, dtype=float)
        found, known = np.full(given.shape[:-1], np.nan), np.isfinite(given).all(axis=-1)
        if known.any():
            found[known] = self.formula.map(int(known.sum()))(*given[known].T[:, None]).full().ravel()
        return found

    @cached_property
    def formula(self) -> ca.Function:
        """`distance` as a CasADi function (x, y) -> distance."""
        x, y = ca.SX.sym("x"), ca.SX.sym("y")
        return ca.Function("distance", [x, y], [self.distance(x, y)])

    def outline(self) -> FloatArray:
        """Return points around the obstacle for drawings [m], shape (K, 2). They are exact to 0.03 % of the radius."""
        turn = np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False)
        ways, spine = np.column_stack([np.cos(turn), np.sin(turn)]), self.spine
        return np.asarray(spine[np.argmax(ways @ spine.T, axis=1)] + self.radius * ways)


@documented
@dataclass(frozen=True)
class Disc(Obstacle):
    """A circular disc."""

    x: float = parameter(meaning="x of the middle", unit="m")
    y: float = parameter(meaning="y of the middle", unit="m")
    radius: float = parameter(meaning="distance of the edge from the middle", unit="m", gt=0)
    sight: float = seen_from()

    @property
    def spine(self) -> FloatArray:
        """Middle of the disc, see `Obstacle`."""
        return np.array([[self.x, self.y]])

    def distance(self, x: ca.SX, y: ca.SX) -> ca.SX:
        """Return the signed distance; see `Obstacle`."""
        return ca.SX(ca.hypot(x - self.x, y - self.y) - self.radius)


@documented
@dataclass(frozen=True)
class Wall(Obstacle):
    """A straight wall with round ends."""

    x: float = parameter(meaning="x of the middle", unit="m")
    y: float = parameter(meaning="y of the middle", unit="m")
    radius: float = parameter(meaning="distance of the edge from the middle line", unit="m", gt=0)
    length: float = parameter(1.0, meaning="length of the middle line", unit="m", gt=0)
    azimuth: float = parameter(0.0, meaning="direction of the middle line", unit="rad")
    sight: float = seen_from()

    @property
    def spine(self) -> FloatArray:
        """Points of the middle line. Their spacing is at most the radius, except in walls longer than 500 radii."""
        count = min(int(np.ceil(self.length / self.radius)), 500)
        along = self.length * (np.arange(count + 1) / count - 0.5)
        return np.column_stack([self.x + along * np.cos(self.azimuth), self.y + along * np.sin(self.azimuth)])

    def distance(self, x: ca.SX, y: ca.SX) -> ca.SX:
        """Return the signed distance; see `Obstacle`."""
        dx, dy, cos, sin = x - self.x, y - self.y, np.cos(self.azimuth), np.sin(self.azimuth)
        along = cos * dx + sin * dy
        beyond = ca.fmax(ca.fabs(along) - self.length / 2.0, 0.0)
        return ca.SX(ca.hypot(beyond, cos * dy - sin * dx) - self.radius)


OBSTACLES: Mapping[str, type[Obstacle]] = MappingProxyType({"disc": Disc, "wall": Wall})
"""Obstacles by the name that scenes use."""


def nearest(obstacles: Sequence[Obstacle], places: FloatArray) -> FloatArray:
    """Return the distances of places from the nearest obstacle, shape (...) for places of shape (..., 2) [m].

    They are infinite if there is no obstacle.
    """
    found = [each.distances(places) for each in obstacles]
    return np.min(found, axis=0) if found else np.full(places.shape[:-1], np.inf)
