"""The worm's parts at every instant: chambers with lengths and heights, and the links around the chambers.

The vector e between the joints of a segment has the length l, and d is the director. Then

    t = e/l,   u = t x d,   centre of a chamber = middle of its lower and upper apex,   h_c = |above - below|/2

Both chambers of a segment have links of the same length a, with a^2 = h_c^2 + l_c^2/4, and l_L + l_R = 2 l. From this
follow the lengths of the left and the right chamber:

    l_L = l + (h_R^2 - h_L^2)/l,   l_R = l - (h_R^2 - h_L^2)/l.

The lengths of chambers without links are given (`Frames.chamber_length`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.viewer.frames import Frames

_OPPOSITE = np.array([1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Bars:
    """B rigid bars at T instants. The arrays have the shape (T, B, 3)."""

    names: tuple[str, ...]
    start: FloatArray
    end: FloatArray
    normal: FloatArray
    """Vectors across the bars that turn with their segments, so that no bar spins about its axis between two frames."""

    @property
    def length(self) -> FloatArray:
        """Mean length of each bar, shape (B,) [m]."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=2).mean(axis=0))


@dataclass(frozen=True, eq=False)
class Body:
    """Chambers, and axes of the segments, for N segments at T instants."""

    t: FloatArray
    d: FloatArray
    u: FloatArray
    """t, d and u: unit vectors along the segments, to the left and up, each of shape (T, N, 3)."""
    centre: FloatArray
    """Centres of the chambers, shape (T, N, 2, 3) [m]."""
    length: FloatArray
    height: FloatArray
    """length and height: l_c and h_c of the chambers, each of shape (T, N, 2) [m]."""

    @classmethod
    def of(cls, frames: Frames) -> Body:
        """Return the body for the joints, directors and apexes of `frames`."""
        edges = np.diff(frames.joints, axis=1)
        l = np.linalg.norm(edges, axis=2)[..., None]  # noqa: E741
        t = edges / l
        d = frames.directors - np.sum(frames.directors * t, axis=2, keepdims=True) * t
        d = d / np.linalg.norm(d, axis=2, keepdims=True)
        below, above = frames.apexes[:, :, 0::3], frames.apexes[:, :, 1::3]
        height = 0.5 * np.linalg.norm(above - below, axis=3)
        h_left, h_right = height[..., :1], height[..., 1:]
        length = frames.chamber_length
        if length is None:
            length = np.maximum(l + _OPPOSITE * (h_right**2 - h_left**2) / l, 0.05 * l)
        return cls(t, d, np.cross(t, d), 0.5 * (below + above), length, height)

    @property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Tail and head ends of the chambers, each of shape (T, N, 2, 3) [m]."""
        half = 0.5 * self.length[..., None] * self.t[:, :, None]
        return self.centre - half, self.centre + half

    def links(self, frames: Frames) -> Bars:
        """Return the links, 12 for each segment, and a crossbar at each joint between the left and right chambers."""
        count, segments = self.t.shape[:2]
        apexes = frames.apexes.reshape(count, segments, 2, 3, 1, 3)
        ends = np.stack(self.ends, axis=3)[:, :, :, None]  # (T, N, 2 sides, 1, 2 ends, 3)
        shape = (count, segments, 2, 3, 2, 3)
        across = np.stack([self.d, self.d, self.u], axis=2)[:, :, None, :, None]
        parts = [np.broadcast_to(x, shape).reshape(count, -1, 3) for x in (ends, apexes, across)]
        numbers = [f"{i:02d}" for i in range(segments)]
        names = map("-".join, product(numbers, "LR", ("below", "above", "outward"), ("tail", "head")))
        rods = self._crossbars(frames.joints)
        if rods is None:
            return Bars(tuple(names), *parts)
        rod_names = [f"{j:02d}-joint" for j in range(segments + 1)]
        return Bars((*names, *rod_names), *(np.concatenate(pair, axis=1) for pair in zip(parts, rods, strict=True)))

    def _crossbars(self, joints: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Return starts, ends and normals of crossbars at the joints, or None if left and right chambers coincide."""
        apart = np.linalg.norm(self.centre[:, :, 0] - self.centre[:, :, 1], axis=2).mean()
        if apart < 0.02 * self.length.mean():
            return None
        faces = [end[:, :, 0] - end[:, :, 1] for end in self.ends]
        across = self._at_joints(*(face / np.linalg.norm(face, axis=2, keepdims=True) for face in faces))
        half = 0.5 * apart * across / np.linalg.norm(across, axis=2, keepdims=True)
        return joints - half, joints + half, self._at_joints(self.t, self.t)

    @staticmethod
    def _at_joints(behind: FloatArray, ahead: FloatArray) -> FloatArray:
        """Return sums over the segments that meet at each joint, shape (T, N+1, 3).

        `behind` belongs to the tail end of each segment, `ahead` to the head end.
        """
        none = np.zeros_like(behind[:, :1])
        return np.asarray(np.concatenate([behind, none], axis=1) + np.concatenate([none, ahead], axis=1))
