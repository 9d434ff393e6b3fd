"""A piece of the scene: a mesh with a colour, and the pose in every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.viewer.shapes import Mesh
from worm3d.viewer.world import Colour

HIDDEN = 1e-6
"""Scale of a hidden piece; 0 would have no inverse, which the lighting needs."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """A mesh that moves as a whole, in one layer of the scene."""

    path: str
    """Unique name, "layer/name"."""
    mesh: Mesh
    colour: Colour
    opacity: float = 1.0
    on_top: bool = False
    """Whether the piece is visible through everything else."""
    position: FloatArray | None = None
    """Shape (T, 3): place [m]; a piece without places stays at the origin."""
    turn: FloatArray | None = None
    """Shape (T, 3, 3): rotation matrices."""
    scale: FloatArray | None = None
    """Shape (T, 3): factors along the axes of the piece."""
    tint: FloatArray | None = None
    """Shape (T, 3): colour in every frame."""
    stepped: bool = False
    """Whether the scale changes at the frames, not between them."""
    paint: FloatArray | None = None
    """Shape (V, 3): colours of the vertices, instead of `colour`."""

    @property
    def layer(self) -> str:
        """First part of the path."""
        return self.path.split("/", 1)[0]

    def matrix(self, frame: int) -> FloatArray:
        """Return the homogeneous transform in a frame, shape (4, 4)."""
        result = np.eye(4)
        if self.turn is not None:
            result[:3, :3] = self.turn[frame]
        if self.scale is not None:
            result[:3, :3] *= self.scale[frame]
        if self.position is not None:
            result[:3, 3] = self.position[frame]
        return result

    def colour_at(self, frame: int) -> Colour:
        """Return the colour in a frame."""
        if self.tint is None:
            return self.colour
        red, green, blue = (float(part) for part in self.tint[frame])
        return red, green, blue


def y_onto(direction: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the rotations that turn y onto `direction`, and x as near to `normal` as possible, shape (..., 3, 3).

    Both have shape (..., 3) and are not parallel; neither needs unit length.
    """
    y = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    x = normal - np.sum(normal * y, axis=-1, keepdims=True) * y
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def any_normal(direction: FloatArray) -> FloatArray:
    """Return a vector that is not parallel to `direction`, shape (..., 3): x, or y if `direction` is near x."""
    along_x = np.abs(direction[..., :1]) > 0.7 * np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.where(along_x, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
