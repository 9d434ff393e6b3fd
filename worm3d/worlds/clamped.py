"""The paper's ground: nothing touches it; the joints' heights are held and give loads (P9) and friction (P10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.worlds.base import WorldKernel
from worm3d.worlds.plane import Plane


@dataclass(frozen=True)
class ClampedGround:
    """The paper's level ground in 3D.

    The joints' z stays as it is. A predictor without friction gives the normal load of each joint, the force (P9) that
    holds its z, and its velocity; (P10) turns them into friction: against the motion with the coefficients towards
    the head, towards the tail and sideways, and none below the threshold. The corrector is solved with these forces.

    Attributes
    ----------
    velocity_threshold : float
        eps of (P10) [m/s].
    """

    velocity_threshold: float = 1e-6

    def __post_init__(self) -> None:
        arguments.number("velocity_threshold", self.velocity_threshold, "m/s", ge=0.0)

    def kernel(self) -> WorldKernel:
        """Return the level plane, for distances in records; no contact acts."""
        return Plane().kernel()

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the height of points of shape (..., 3) above the level of the joints, shape (...,) [m]."""
        return np.asarray(points)[..., 2]

    def pressing(self, gravity: FloatArray) -> FloatArray:
        """Return zero: the clamped worm does not rest on contacts."""
        return np.zeros(3)

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints at z = 0; see `World.placed`."""
        return Plane().placed(along, 0.0, position, azimuth)
