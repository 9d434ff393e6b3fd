"""Terrain given by heights on a regular grid."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from worm3d.values import arguments
from worm3d.values.arguments import require_room
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly
from worm3d.worlds import heightfield_kernel, kernels, terrain
from worm3d.worlds.base import World, chord
from worm3d.worlds.kernels import WorldKernel, looked_up


@dataclass(frozen=True, eq=False)
class Heightfield(World, ReadOnly):
    """A surface z = h(x, y), the bicubic spline through heights on a regular grid. The solid lies below the surface.

    Beyond the grid the terrain continues at the height of the edge. The spline has continuous curvature, so that
    normals change smoothly. Distances are measured from the nearest point of the spline
    (`worm3d.worlds.heightfield_kernel`).

    Attributes
    ----------
    heights : ndarray, shape (A, B)
        Heights at x = origin[0] + i spacing, y = origin[1] + j spacing [m]. A and B are at least 4.
    spacing : float
        Spacing of the grid [m].
    origin : tuple of float
        x and y of the first height [m].
    grip : float or ndarray, shape (A, B)
        Multiplier of the friction coefficients, everywhere or at each node of the grid. It is linear between nodes.

    Raises
    ------
    ValueError
        A value is not finite or is out of range, or an array has the wrong shape.
    """

    heights: FloatArray
    spacing: float
    origin: tuple[float, float] = (0.0, 0.0)
    grip: float | FloatArray = 1.0

    def __post_init__(self) -> None:
        self._keep("heights", self.heights)
        if self.heights.ndim != 2 or min(self.heights.shape) < 4:
            raise ValueError(f"heights: got shape {self.heights.shape}, must be (A, B) with at least 4 along each side")
        size = self.heights.size
        require_room("heights", 64.0 * size, f"{size:.3g} of them", "a wider spacing")  # bytes of the tables
        arguments.number("spacing", self.spacing, "m", gt=0.0)
        object.__setattr__(self, "origin", tuple(arguments.array("origin", self.origin, (2,)).tolist()))
        self._keep("grip", self.grip)
        shape, grips = np.shape(self.grip), np.atleast_1d(self.grip)
        if shape not in ((), self.heights.shape) or not 0.0 <= grips.min() <= grips.max() <= arguments.MAX_MAGNITUDE:
            least = f" and least value {grips.min()}" if grips.size else ""
            raise ValueError(
                f"grip: got shape {shape}{least}, must be at least 0, a number or as the heights, {self.heights.shape}"
            )

    def _keep(self, name: str, value: ArrayLike) -> None:
        array = arguments.floats(name, value)
        if not np.isfinite(array).all():
            count = np.count_nonzero(~np.isfinite(array))
            raise ValueError(f"{name}: got {count} values that are not finite, every one must be; fill the gaps first")
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    @classmethod
    def from_image(cls, path: str | PathLike[str], spacing: float, low: float, high: float, **more: Any) -> Heightfield:
        """Return the terrain of a greyscale image with a node for each pixel.

        Black has the height `low` [m], and white has the height `high` [m]. In an image of more than 8 bits, the
        darkest and the lightest value take the place of black and white. The left edge of the image is
        x = origin[0], and the lower edge is y = origin[1]. `more` are further arguments of `Heightfield`.

        Raises
        ------
        ValueError
            The file is missing or is not an image, or the image has only one colour.
        """
        return cls(terrain.image(path, low, high), spacing, **more)

    @classmethod
    def rubble(
        cls, length: float, width: float, spacing: float, *, height: float, size: float, seed: int = 0, **more: Any
    ) -> Heightfield:
        """Return smooth stones at random places, with heights up to `height` and radii up to `size` [m].

        The terrain extends from x = 0 to `length` and has the given width, centred at y = 0.
        """
        return cls._made(terrain.rubble, length, width, spacing, more, height=height, size=size, seed=seed)

    @classmethod
    def steps(
        cls, length: float, width: float, spacing: float, *, height: float, tread: float, ramp: float, **more: Any
    ) -> Heightfield:
        """Return stairs that go up along x.

        Each tread of length `tread` is level except for its last part of length `ramp`, where it rises smoothly by
        `height` to the next tread [m].
        """
        return cls._made(terrain.steps, length, width, spacing, more, height=height, tread=tread, ramp=ramp)

    @classmethod
    def sinusoid(
        cls,
        length: float,
        width: float,
        spacing: float,
        *,
        amplitude: float,
        wavelength: float,
        azimuth: float = 0.0,
        **more: Any,
    ) -> Heightfield:
        """Return waves along an azimuth [rad], with a crest at the origin. Amplitude and wavelength are in metres."""
        waves = {"amplitude": amplitude, "wavelength": wavelength, "azimuth": azimuth}
        return cls._made(terrain.sinusoid, length, width, spacing, more, **waves)

    @classmethod
    def _made(
        cls, maker: Any, length: float, width: float, spacing: float, more: dict[str, Any], **numbers: Any
    ) -> Heightfield:
        x, y = terrain.nodes(length, width, spacing)
        for name, value in numbers.items():
            if name == "seed":
                arguments.whole(name, value, ge=0)
            else:
                signed = name in ("azimuth", "amplitude", "height")
                bounds: arguments.Bounds = {} if signed else {"gt": 0.0}
                arguments.number(name, value, **bounds)
        return cls(maker(x, y, **numbers), spacing, **{"origin": (0.0, float(y[0])), **more})

    @property
    def x(self) -> FloatArray:
        """Coordinates x of the nodes, shape (A,) [m]."""
        return self.origin[0] + self.spacing * np.arange(float(self.heights.shape[0]))

    @property
    def y(self) -> FloatArray:
        """Coordinates y of the nodes, shape (B,) [m]."""
        return self.origin[1] + self.spacing * np.arange(float(self.heights.shape[1]))

    @cached_property
    def _tables(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coefficients of the spline and upper bounds of the surface in each cell, both in spacings, and grips.

        The tables have additional nodes around the grid, with the values of the edge. The upper bound in a cell is the
        largest coefficient around the cell.
        """
        import scipy  # slow to import, and rarely needed

        grips = np.broadcast_to(self.grip, self.heights.shape)
        padded = np.pad(self.heights / self.spacing, kernels.SPLINE_PADDING, mode="edge")
        coefficients = np.ascontiguousarray(scipy.ndimage.spline_filter(padded, order=3))
        tops = np.ascontiguousarray(scipy.ndimage.maximum_filter(coefficients, size=4, origin=-1))
        return coefficients, tops, np.pad(grips, kernels.SPLINE_PADDING, mode="edge")

    def kernel(self, band: float = heightfield_kernel.CONTACT) -> WorldKernel:
        """Return the compiled world.

        The nearest point of the surface is computed for points up to `band` cells above the upper bound of the surface
        in their cell. The distance of higher points is an estimate.
        """
        first = np.asarray(self.origin) - kernels.SPLINE_PADDING * self.spacing
        coefficients, tops, grips = self._tables
        places = kernels.halves(coefficients.ctypes.data, tops.ctypes.data, grips.ctypes.data)
        parameters = [*places, *coefficients.shape, *first, self.spacing, band]
        return kernels.kernel_by_hand(heightfield_kernel.heightfield, parameters, (coefficients, tops, grips))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points of shape (..., 3), shape (...,) [m].

        The distance is exact up to 4 cells above the upper bound of the surface, and an estimate farther above.
        """
        return np.asarray(looked_up(self.kernel(4.0), points)[0])

    def height(self, places: FloatArray) -> FloatArray:
        """Return the height of the surface at x, y of shape (..., 2), shape (...,) [m]."""
        import scipy  # slow to import, and rarely needed

        nodes = (np.asarray(places, dtype=float) - self.origin).reshape(-1, 2) / self.spacing + kernels.SPLINE_PADDING
        found = scipy.ndimage.map_coordinates(self._tables[0], nodes.T, order=3, prefilter=False, mode="nearest")
        return self.spacing * np.reshape(found, np.shape(places)[:-1])

    @property
    def uneven(self) -> bool:
        """Whether the heights differ, so that a worm without friction could slide away."""
        return bool(np.ptp(self.heights) > 0.0)

    def forward(self, joints: FloatArray, level: FloatArray) -> FloatArray:
        """Return the unit vector from the tail to the head of joints with the shape (N+1, 3)."""
        return chord(joints)

    def pressing(self, gravity: FloatArray) -> FloatArray:
        """Return gravity if it points downwards, otherwise zero, shape (3,) [m/s^2]."""
        return super().pressing(gravity) if gravity[2] < 0.0 else np.zeros(3)

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints of a straight worm laid over the terrain from above, and the director.

        Raises
        ------
        ValueError
            The tail or the head would lie beyond the grid.
        """
        ends = position + along[[0, -1], None] * [np.cos(azimuth), np.sin(azimuth)]
        low, high = [float(self.x[0]), float(self.y[0])], [float(self.x[-1]), float(self.y[-1])]
        if (ends < low).any() or (ends > high).any():
            raise ValueError(
                f"position: got {position.tolist()!r} m, the worm would reach to {ends[1].tolist()!r} m, beyond the "
                f"terrain, which spans {low!r} to {high!r} m"
            )
        return super().placed(along, clearance, position, azimuth)

    @lru_cache(maxsize=8)  # noqa: B019 - a few worlds are kept
    def bumps(self, within: float) -> float:
        """Return the largest height [m] of bumps that are narrower than `within` [m] along x and y, 0 without bumps.

        The bumps are removed by a morphological opening with a square of this side (Serra, Image Analysis and
        Mathematical Morphology, 1982). The result is the largest difference between the terrain before and after.
        """
        import scipy  # slow to import, and rarely needed

        nodes = 2 * round(within / self.spacing / 2.0) + 1
        if min(nodes, *self.heights.shape) < 3:
            return 0.0
        return float(scipy.ndimage.white_tophat(self.heights, size=(nodes, nodes)).max())
