"""Outlines of the worm on a plane: ellipsoids, bars, arrows, and cuts through meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worm3d.viewer.arrays import FloatArray

_CORNERS = 36


@dataclass(frozen=True, eq=False)
class Projection:
    """A view along a straight line, without perspective.

    Attributes
    ----------
    right, up, near : ndarray, shape (3,)
        Unit vectors: to the right and upwards in the picture, and towards the viewer.
    """

    right: FloatArray
    up: FloatArray
    near: FloatArray

    @property
    def plane(self) -> FloatArray:
        """Rows that give picture coordinates, shape (2, 3)."""
        return np.array([self.right, self.up])

    def points(self, points: FloatArray) -> FloatArray:
        """Return picture coordinates, shape (..., 2) [m]."""
        return np.asarray(points @ self.plane.T)

    def ellipsoids(self, centre: FloatArray, axes: FloatArray) -> FloatArray:
        """Return the outlines of ellipsoids, shape (E, corners, 2).

        Parameters
        ----------
        centre : ndarray, shape (E, 3)
            [m].
        axes : ndarray, shape (E, 3, 3)
            Semi-axes as columns [m].
        """
        # The shadow of {A x, |x| <= 1} is {P A x}: an ellipse with the singular values of P A as semi-axes.
        turn, size, _ = np.linalg.svd(self.plane @ axes, full_matrices=False)
        angle = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
        circle = np.stack([np.cos(angle), np.sin(angle)])
        return np.asarray(self.points(centre)[:, None] + np.swapaxes(turn * size[:, None] @ circle, 1, 2))

    def bars(self, start: FloatArray, end: FloatArray, thick: float | FloatArray) -> FloatArray:
        """Return the outlines of bars of radius `thick` from `start` to `end`, (B, 3), shape (B, 4, 2) [m]."""
        a, b = self.points(start), self.points(end)
        along, _ = _unit(b - a)
        across = np.broadcast_to(thick, len(a))[:, None] * _turned(along)
        return np.stack([a - across, b - across, b + across, a + across], axis=1)

    def arrows(self, start: FloatArray, vector: FloatArray, wide: float) -> FloatArray:
        """Return the outlines of arrows, shape (A, 7, 2) [m]; one that points at the viewer has none.

        Parameters
        ----------
        start, vector : ndarray, shape (A, 3)
            [m].
        wide : float
            Of the head [m].
        """
        a, v = self.points(start), self.points(vector)
        along, size = _unit(v)
        head = np.minimum(1.6 * wide, 0.5 * size)
        half = 0.5 * np.minimum(wide, size)
        across, neck, tip = _turned(along), a + v - head * along, a + v
        thin, broad = 0.35 * half * across, half * across
        return np.stack([a - thin, neck - thin, neck - broad, tip, neck + broad, neck + thin, a + thin], axis=1)

    def cut(self, vertices: FloatArray, faces: NDArray[np.int64], through: FloatArray) -> FloatArray:
        """Return where a mesh meets the plane of the picture through a point, as lines, shape (S, 2, 2) [m]."""
        height = (vertices - through) @ self.near
        above = height[faces] >= 0.0
        crossed = above.any(axis=1) & ~above.all(axis=1)
        corners, above, height = vertices[faces[crossed]], above[crossed], height[faces[crossed]]
        # The corner that is alone on its side.
        alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
        rows = np.arange(len(alone))
        ends = []
        for step in (1, 2):
            other = (alone + step) % 3
            a, b = height[rows, alone], height[rows, other]
            share = (a / (a - b))[:, None]
            ends.append(self.points(corners[rows, alone] * (1.0 - share) + corners[rows, other] * share))
        return np.stack(ends, axis=1)


def _unit(vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors and lengths, shape (..., 1); no direction where there is no length."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(size, 1e-300)), size


def _turned(vectors: FloatArray) -> FloatArray:
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)
