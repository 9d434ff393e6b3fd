"""A piece of the scene: a mesh, its colour, and where it is in every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from worm3d.values.arrays import FloatArray
from worm3d.viewer import rotation
from worm3d.viewer.tube import Mesh
from worm3d.viewer.world import Colour

HIDDEN = 1e-6
"""Scale of what is not to be seen; zero has no inverse, which the lighting needs."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """A mesh that moves as a whole, in one layer of the scene.

    Attributes
    ----------
    path : str
        "layer/name"; unique.
    mesh : Mesh
    colour : tuple of float
    opacity : float
    on_top : bool
        Whether it is seen through everything else.
    position : ndarray, shape (T, 3), optional
        [m]; a piece without it stands still at the origin.
    quaternion : ndarray, shape (T, 4), optional
    scale : ndarray, shape (T, 3), optional
    tint : ndarray, shape (T, 3), optional
        Colour in every frame.
    stepped : bool
        Whether the scale changes at the frames, not between them.
    paint : ndarray, shape (V, 3), optional
        Colours of the vertices, in the place of `colour`.
    """

    path: str
    mesh: Mesh
    colour: Colour
    opacity: float = 1.0
    on_top: bool = False
    position: FloatArray | None = None
    quaternion: FloatArray | None = None
    scale: FloatArray | None = None
    tint: FloatArray | None = None
    stepped: bool = False
    paint: FloatArray | None = None

    @property
    def layer(self) -> str:
        """First part of the path."""
        return self.path.split("/", 1)[0]

    def matrix(self, frame: int) -> FloatArray:
        """Return the homogeneous transform in a frame, shape (4, 4)."""
        result = np.eye(4)
        if self.quaternion is not None:
            result[:3, :3] = rotation.matrices(self.quaternion[frame])
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
