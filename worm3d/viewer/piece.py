"""A piece of the scene: a mesh with a colour, and the pose in every frame; quaternions are (x, y, z, w)."""

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
    quaternion: FloatArray | None = None
    """Shape (T, 4): turn, (x, y, z, w)."""
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
        if self.quaternion is not None:
            result[:3, :3] = matrices(self.quaternion[frame])
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


def quaternions(axes: FloatArray) -> FloatArray:
    """Return the quaternions, shape (..., 4), of rotation matrices, shape (..., 3, 3), stable for all angles."""
    m = axes
    diagonal = np.stack([m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    trace = diagonal.sum(axis=-1)
    # Squares of 2 x, 2 y, 2 z, 2 w; the largest is the divisor.
    squares = np.concatenate([1.0 + 2.0 * diagonal - trace[..., None], 1.0 + trace[..., None]], axis=-1)
    symmetric, skew = _pairs(m, 1.0), _pairs(m, -1.0)
    yz, zx, xy = (symmetric[..., k] for k in range(3))
    wx, wy, wz = (skew[..., k] for k in range(3))
    products = np.stack(  # row k: the four numbers times 4 x, 4 y, 4 z or 4 w
        [
            np.stack([squares[..., 0], xy, zx, wx], axis=-1),
            np.stack([xy, squares[..., 1], yz, wy], axis=-1),
            np.stack([zx, yz, squares[..., 2], wz], axis=-1),
            np.stack([wx, wy, wz, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = squares.argmax(axis=-1)[..., None, None]
    row = np.take_along_axis(products, best, axis=-2)[..., 0, :]
    return np.asarray(row / np.linalg.norm(row, axis=-1, keepdims=True))


def _pairs(m: FloatArray, sign: float) -> FloatArray:
    """Return m_zy ± m_yz, m_xz ± m_zx, m_yx ± m_xy."""
    return np.stack(
        [m[..., 2, 1] + sign * m[..., 1, 2], m[..., 0, 2] + sign * m[..., 2, 0], m[..., 1, 0] + sign * m[..., 0, 1]],
        axis=-1,
    )


def matrices(q: FloatArray) -> FloatArray:
    """Return the rotation matrices, shape (..., 3, 3), of unit quaternions, shape (..., 4)."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=-1),
            np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=-1),
            np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def y_onto(direction: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the quaternions that turn y onto `direction`, and x as near to `normal` as possible, shape (..., 4).

    Both have shape (..., 3) and are not parallel; neither needs unit length.
    """
    y = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    x = normal - np.sum(normal * y, axis=-1, keepdims=True) * y
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return quaternions(np.stack([x, y, np.cross(x, y)], axis=-1))


def any_normal(direction: FloatArray) -> FloatArray:
    """Return a vector that is not parallel to `direction`, shape (..., 3): x, or y if `direction` is near x."""
    along_x = np.abs(direction[..., :1]) > 0.7 * np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.where(along_x, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
