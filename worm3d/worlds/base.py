"""What the simulator asks of a world.

A world's compiled kernel takes points and its own parameters, as rows of the inputs, and returns as rows

    g               signed distance, negative inside the solid [m]
    n (3)           its gradient, a unit vector out of the solid
    H (6)           its Hessian, xx, xy, xz, yy, yz, zz [1/m]; zero is allowed and costs Newton steps only
    grip            multiplier of the friction coefficients at that place

in the layout of `worm3d.machine.codegen`: row r of point k stands at [r, k].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from worm3d.values.arrays import FloatArray


@dataclass(frozen=True)
class WorldKernel:
    """A compiled world.

    Attributes
    ----------
    address : int
        Of the C function (`worm3d.machine.codegen.emit`).
    parameters : ndarray, shape (m,)
        Rows of the inputs after the point's coordinates, the same for all points.
    owner : object
        Kept alive as long as the address is used.
    """

    address: int
    parameters: FloatArray
    owner: object


@runtime_checkable
class World(Protocol):
    """Something to crawl on or in.

    A world may have an attribute `uneven`: True where a worm without friction could slide away under `pressing`. There
    it is brought to rest with contacts that stick, and then by the friction of its run. And it may have a method
    `bumps(within) -> float`: how high bumps are that stand within a distance [m]; a run is refused where they could
    pass between a worm's contact points.
    """

    def kernel(self) -> WorldKernel:
        """Return the compiled world."""

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""

    def pressing(self, gravity: FloatArray) -> FloatArray:
        """Return the part of gravity that presses a resting worm to the world, 0 if none does, shape (3,) [m/s^2]."""

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints of a straight worm on the world, and its director to the left.

        Parameters
        ----------
        along : ndarray, shape (N+1,)
            Distance of the joints from the tail [m].
        clearance : float
            Distance of the joints from the surface [m].
        position : ndarray, shape (2,)
            Where the tail is, seen from above [m].
        azimuth : float
            Heading [rad].

        Returns
        -------
        ndarray, shape (N+1, 3)
        ndarray, shape (3,) or (N, 3)
            One for all segments, or one each.
        """
