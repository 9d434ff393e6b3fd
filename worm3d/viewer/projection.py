"""Shapes on the plane of a picture: points, which way polygons face, arrows, and cuts through meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray


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

    def facing(self, corners: FloatArray) -> FloatArray:
        """Return how much polygons face the viewer: the cosine of the angle to their normals, shape (K,).

        Parameters
        ----------
        corners : ndarray, shape (K, corners, 3)
            Anticlockwise, seen from where their normals point; nearly flat [m].
        """
        normal, _ = _unit(np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1))
        return np.asarray(normal @ self.near)

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
