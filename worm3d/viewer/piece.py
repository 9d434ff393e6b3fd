"""A piece of the scene: a mesh with a colour, and the pose in every frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.viewer.shapes import Mesh
from worm3d.viewer.world import Colour

HIDDEN = 1e-6
"""Scale of a hidden piece. It is not 0, because the lighting needs the inverse of the transform."""


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
    """Position in every frame, shape (T, 3) [m]. None means the origin."""
    turn: FloatArray | None = None
    """Rotation matrix in every frame, shape (T, 3, 3). None means no rotation."""
    scale: FloatArray | None = None
    """Scale factors along the axes of the piece in every frame, shape (T, 3). None means 1."""
    tint: FloatArray | None = None
    """Colour in every frame, shape (T, 3), instead of `colour`."""
    stepped: bool = False
    """Whether the scale changes suddenly at a frame, instead of gradually between two frames."""
    paint: FloatArray | None = None
    """Colours of the vertices, shape (V, 3), instead of `colour`."""

    @property
    def layer(self) -> str:
        """Name of the layer, the first part of the path."""
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Group:
    """P pieces of a layer, which have the same fields."""

    layer: str
    meshes: Mapping[str, Mesh]
    """Meshes by the names of the pieces."""
    colour: Colour
    on_top: bool
    poses: Mapping[str, FloatArray]
    """Position, turn, scale and tint as in `Piece`, for all pieces, with shapes (T, P, ...)."""

    @property
    def paths(self) -> list[str]:
        """Paths of the pieces."""
        return [f"{self.layer}/{name}" for name in self.meshes]

    def pieces(self) -> list[Piece]:
        """Return the pieces."""
        look: dict[str, Any] = {"colour": self.colour, "on_top": self.on_top, "stepped": self.layer == "anchors"}
        rows: list[dict[str, Any]] = [
            {name: of[:, k] for name, of in self.poses.items()} for k in range(len(self.meshes))
        ]
        return [
            Piece(path=path, mesh=mesh, **look, **row)
            for path, mesh, row in zip(self.paths, self.meshes.values(), rows, strict=True)
        ]


def y_onto(direction: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the rotations that turn y to `direction`, and x as near to `normal` as possible, shape (..., 3, 3).

    `direction` and `normal` have the shape (..., 3). They must not be parallel, and need not be unit vectors.
    """
    y = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    x = normal - np.sum(normal * y, axis=-1, keepdims=True) * y
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def any_normal(direction: FloatArray) -> FloatArray:
    """Return a vector that is not parallel to `direction`, shape (..., 3). It is x, or y if `direction` is near x."""
    along_x = np.abs(direction[..., :1]) > 0.7 * np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.where(along_x, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
