"""Smooth plane curves as functions of arc length, the base of all paths except lines and circles.

A subclass defines a curve r(u) and its first two derivatives. With the arc length s,

    ds/du = |r'|,   t = r'/|r'|,   kappa = (x' y'' - y' x'') / |r'|^3                                          (L1)

The point of a curve that is nearest to a place p solves (r(s) - p) . t(s) = 0. The slope of this function is
1 - kappa n . (p - r), where n points to the left of t. An open curve continues straight beyond both ends, and a closed
curve repeats.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import ArrayLike

from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import Spelled

PARTS = 16
"""Number of parts into which each interval between knots is divided."""
GAUSS = np.polynomial.legendre.leggauss(5)
"""Points and weights of Gauss's quadrature rule on [-1, 1]."""


class Curve(Spelled, ABC):
    """A curve as a function of arc length. Subclasses define r(u) for u from 0 to the last knot."""

    closed: bool = False
    """Whether the curve ends where it begins, without a kink."""

    @abstractmethod
    def derivatives(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return r, r' and r'' at u of shape (K,), each of shape (K, 2)."""

    @abstractmethod
    def knots(self) -> FloatArray:
        """Return increasing parameters u from 0 on, between which the curve is smooth, shape (M,)."""

    @property
    def length(self) -> float:
        """Arc length from one end to the other [m]."""
        return float(self._nodes[1][-1])

    def point(self, s: ArrayLike) -> FloatArray:
        """Return the points at arc lengths `s` [m], shape (..., 2) for `s` of shape (...) [m]."""
        inside, beyond, _ = self._inside(s)
        r, d, _ = self._at(inside)
        return r + beyond[..., None] * _unit(d)

    def heading(self, s: ArrayLike) -> FloatArray:
        """Return the azimuths of the tangents at arc lengths `s` [rad]. They are continuous along the curve."""
        inside, _, laps = self._inside(s)
        _, d, _ = self._at(inside)
        azimuth, known = np.arctan2(d[..., 1], d[..., 0]), self._headings
        near = np.interp(inside, self._nodes[1], known)
        turned = azimuth + 2.0 * np.pi * np.round((near - azimuth) / (2.0 * np.pi))
        return np.asarray(turned + laps * (known[-1] - known[0]))

    def curvature(self, s: ArrayLike) -> FloatArray:
        """Return the curvatures (L1) at arc lengths `s`, positive to the left [1/m]."""
        inside, beyond, _ = self._inside(s)
        _, d, dd = self._at(inside)
        kappa = (d[..., 0] * dd[..., 1] - d[..., 1] * dd[..., 0]) / np.linalg.norm(d, axis=-1) ** 3
        return np.where(beyond == 0.0, kappa, 0.0)

    def project(self, xy: ArrayLike, near: float | None = None) -> FloatArray:
        """Return the arc lengths of the points nearest to places, shape (...) [m].

        `xy` are the places, shape (..., 2) [m]. If `near` is given, only points within an eighth of the curve's length
        from the arc length `near` are searched. Otherwise all points are searched. If the curve passes a place more
        than once, the first pass is returned whose distance exceeds the smallest distance by at most a hundredth of the
        length.
        """
        places = np.asarray(xy, dtype=float)
        flat = [self._nearest(place, near) for place in places.reshape(-1, 2)]
        return np.array(flat).reshape(places.shape[:-1])

    def _nearest(self, place: FloatArray, near: float | None) -> float:
        """Return the arc length of the nearest point.

        Newton's method in the parameter u starts from the nearest node.
        """
        (nodes, lengths), (k, laps) = self._nodes, self._nearest_node(place, near)
        low, high = self._beside(k)
        u = float(nodes[k])
        for _ in range(20):  # three or four are enough, except at the centre of curvature
            r, d, dd = (part[0] for part in self._derivatives(np.array([u])))
            speed = float(d @ d)
            change = float((r - place) @ d) / max(speed + float((r - place) @ dd), 0.1 * speed)
            u, before = min(max(u - change, low), high), u
            if abs(u - before) <= 1e-13 * float(nodes[-1]):
                break
        s = float(lengths[k]) + float(self._ways(nodes[k : k + 1], np.array([u]))[0])
        return s + laps * self.length + self._beyond(place, u)

    def _beyond(self, place: FloatArray, u: float) -> float:
        """Return the distance from the end of an open curve to the nearest point on its straight continuation [m]."""
        if self.closed or 0.0 < u < self._nodes[0][-1]:
            return 0.0
        r, d, _ = (part[0] for part in self.derivatives(np.array([u])))
        along = float((place - r) @ _unit(d))
        return min(along, 0.0) if u == 0.0 else max(along, 0.0)

    def _nearest_node(self, place: FloatArray, near: float | None) -> tuple[int, float]:
        """Return the index of a node beside the nearest point, and the number of laps before this node."""
        chords = np.diff(self._places, axis=0)
        share = np.einsum("ij,ij->i", place - self._places[:-1], chords) / np.einsum("ij,ij->i", chords, chords)
        share = np.clip(share, 0.0, 1.0)
        distance = np.linalg.norm(self._places[:-1] + share[:, None] * chords - place, axis=1)
        node = np.arange(len(chords)) + np.round(share).astype(int)
        lengths, laps = self._nodes[1][node], np.zeros(len(node))
        if near is None:
            alike = distance <= distance.min() + 0.01 * self.length
            first = int(np.argmax(alike))
            distance[first + int(np.argmin([*alike[first:], False])) :] = np.inf
        else:
            if self.closed:
                laps = np.round((near - lengths) / self.length)
            inside = near if self.closed else min(max(near, 0.0), self.length)
            distance[np.abs(lengths + laps * self.length - inside) > 0.125 * self.length] = np.inf
        k = int(np.argmin(distance))
        return int(node[k]), float(laps[k])

    def _beside(self, k: int) -> tuple[float, float]:
        """Return the parameters of the nodes before and after node k. A closed curve continues beyond its ends."""
        nodes = self._nodes[0]
        first, last = (nodes[-2] - nodes[-1], nodes[-1] + nodes[1]) if self.closed else nodes[[0, -1]]
        return float(nodes[k - 1] if k else first), float(nodes[k + 1] if k < len(nodes) - 1 else last)

    def _inside(self, s: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the arc lengths clipped to the curve, the excess beyond its ends, and the laps of a closed curve."""
        given = np.asarray(s, dtype=float)
        if self.closed:
            laps = np.floor(given / self.length)
            return given - laps * self.length, np.zeros_like(given), laps
        inside = np.clip(given, 0.0, self.length)
        return inside, given - inside, np.zeros_like(given)

    def _at(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        parts = self.derivatives(self._parameter(s.ravel()))
        r, d, dd = (part.reshape(*s.shape, 2) for part in parts)
        return r, d, dd

    @cached_property
    def _nodes(self) -> tuple[FloatArray, FloatArray]:
        """Parameters and arc lengths of the nodes, which are the knots and points between them."""
        parts = [np.linspace(a, b, PARTS, endpoint=False) for a, b in itertools.pairwise(self.knots())]
        u = np.append(np.concatenate(parts), self.knots()[-1])
        return u, np.concatenate([[0.0], np.cumsum(self._ways(u[:-1], u[1:]))])

    def _ways(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Return the arc lengths between pairs of parameters by Gauss's rule, shape (K,)."""
        half = (end - begin) / 2.0
        places = begin[:, None] + half[:, None] * (1.0 + GAUSS[0])
        speed = np.linalg.norm(self.derivatives(places.ravel())[1], axis=1).reshape(places.shape)
        return np.asarray(half * (speed @ GAUSS[1]))

    def _parameter(self, s: FloatArray) -> FloatArray:
        """Return the parameters u that belong to arc lengths, shape (K,).

        A cubic interpolation between nodes is followed by a step of Newton's method.
        """
        nodes, lengths = self._nodes
        u = np.clip(self._guess(s), 0.0, nodes[-1])
        k = np.clip(np.searchsorted(nodes, u, side="right") - 1, 0, len(nodes) - 2)
        missing = s - lengths[k] - self._ways(nodes[k], u)
        speed = np.linalg.norm(self.derivatives(u)[1], axis=1)
        return np.asarray(np.clip(u + missing / speed, 0.0, nodes[-1]))

    @cached_property
    def _places(self) -> FloatArray:
        return self.derivatives(self._nodes[0])[0]

    def _derivatives(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return r, r' and r''. For a closed curve, u may lie beyond the ends."""
        return self.derivatives(np.mod(u, self._nodes[0][-1]) if self.closed else u)

    @cached_property
    def _headings(self) -> FloatArray:
        d = self.derivatives(self._nodes[0])[1]
        return np.unwrap(np.arctan2(d[:, 1], d[:, 0]))

    @cached_property
    def _guess(self) -> scipy.interpolate.CubicHermiteSpline:
        u, s = self._nodes
        return scipy.interpolate.CubicHermiteSpline(s, u, 1.0 / np.linalg.norm(self.derivatives(u)[1], axis=1))


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.linalg.norm(vector, axis=-1)[..., None])
