"""Worlds as a grid of signed distances: the fit of a spline to the distances, and the world of a Python function.

A spline that only passes through the distances at the nodes rounds edges and corners, with errors of up to 0.28 of a
cell there. The spline is therefore also fitted to samples between the nodes. Each cell has eight samples, shifted from
a node by 0 or by half a cell along each axis. A sample has the exact distance d, and w are the weights (WS1) of the
spline coefficients c at its position. If the error r of the spline at a sample exceeds a tolerance e, the smallest
change of the coefficients that reduces the error to the tolerance is applied:

    c <- c - w (r - e sign(r))/|w|^2,    r = w.c - d,                                                        (WM3)

The samples are corrected one after the other, in a few sweeps (Agmon, "The relaxation method for linear inequalities",
1954). Where the surface is smooth, no error exceeds the tolerance, and nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from worm3d.machine.compiled import njit
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray, IntArray, SingleArray
from worm3d.values.read_only import ReadOnly
from worm3d.worlds import kernels, sampled_kernel
from worm3d.worlds.base import World, chord
from worm3d.worlds.kernels import WorldKernel, looked_up

FIT_TOLERANCE = 0.1
"""e of (WM3), in cells. The errors between the samples, together with the error of (WM1), are about as large."""

FITTED = 1.25
"""Distance from the surface within which the spline is fitted between the nodes, in cells."""

NODES = 1_000_000
"""Number of nodes of a grid if the user does not set the cell size. Such a grid needs 4 MB and takes about a second to
compute."""

NODES_KEPT = 60_000
"""Largest number of nodes of the grid that a result stores for a user-defined world, for pictures. It needs 0.2 MB, and
its cells are about 40 mm wide along the path of a default worm. With half as many nodes the cells are 50 mm wide. With
twice as many, they are 32 mm wide and the file is twice as large."""

MOST_NODES = 8_000_000
"""Largest number of nodes of a grid. Such a grid needs 32 MB, and ten times as much while it is computed."""

AT_ONCE = 200_000
"""Largest number of points in one call of a distance function."""

STEEPNESS = (0.8, 1.25)
"""Allowed range of the length of the gradient next to the surface. The gradient may be smaller at a tenth of the
places, and larger at another tenth."""

Shift = tuple[float, ...]
"""Fractions of a cell along x, y and z, each from 0 to 1."""


@dataclass(frozen=True, eq=False)
class Grid(ReadOnly):
    """A cubic spline of signed distances on a regular grid, negative inside."""

    coefficients: SingleArray
    """Coefficients of the spline, shape (A, B, C) [cells]."""
    first: FloatArray
    """Position of the first node, shape (3,) [m]."""
    cell: float
    """Distance between neighbouring nodes [m]."""


class GridWorld(World, ReadOnly):
    """A world as a grid of signed distances.

    At edges and corners, which become round, the surface is off by up to a fifth of a cell (`sampled_kernel`).
    """

    grid: Grid
    grip: float

    straight: ClassVar[bool] = True
    """Whether the world continues straight beyond the grid. If not, there is no solid beyond the grid."""

    @property
    def first(self) -> FloatArray:
        """Position of the grid's first node, shape (3,) [m]."""
        return self.grid.first

    @property
    def side(self) -> float:
        """1 if the solid has negative distances in the grid, -1 if it has positive distances."""
        return 1.0

    def kernel(self, band: float = sampled_kernel.CONTACT) -> WorldKernel:
        """Return the compiled world.

        `band` is the limit of `sampled_kernel` up to which the spline is evaluated [cells].
        """
        grid, spline = self.grid, sampled_kernel.spline_kernel()
        # The kernel has its own working memory, because other kernels may run at the same time.
        work = np.zeros((sampled_kernel.WORK_ROWS, sampled_kernel.TOGETHER))
        places = kernels.halves(grid.coefficients.ctypes.data, work.ctypes.data, spline.address)
        box = (*grid.coefficients.shape, *self.first, grid.cell)
        parameters = [*places, *box, self.side, self.grip, band, self.straight]
        return kernels.kernel_by_hand(sampled_kernel.sampled, parameters, (grid, work, spline))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""
        return np.asarray(looked_up(self.kernel(np.inf), points)[0])

    def forward(self, joints: FloatArray, level: FloatArray) -> FloatArray:
        """Return the unit vector from the tail to the head of joints with the shape (N+1, 3)."""
        return chord(joints)

    def height(self, places: FloatArray) -> FloatArray:
        """Return the height of the ground at places x, y, NaN where there is no ground, shape (M,) [m].

        The places have the shape (M, 2). If there are several surfaces above each other, the result is the highest
        ground if `side` is 1, and the lowest if `side` is -1, as in a tunnel.
        """
        z = self.first[2] + self.grid.cell * np.arange(float(self.grid.coefficients.shape[2]))
        columns = np.empty((len(places), len(z), 3))
        columns[:, :, :2], columns[:, :, 2] = places[:, None], z
        g = self.distance(columns)
        enters = (g[:, :-1] < 0.0) & (g[:, 1:] >= 0.0)
        highest, lowest = enters.shape[1] - 1 - np.argmax(enters[:, ::-1], axis=1), np.argmax(enters, axis=1)
        k = highest if self.side > 0.0 else lowest
        low, high = z[k], z[k + 1]
        for _ in range(40):  # halvings of the interval, down to rounding errors
            middle = (low + high) / 2.0
            below = self.distance(np.column_stack([places, middle])) < 0.0
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.where(enters.any(axis=1), high, np.nan)


@dataclass(frozen=True, eq=False)
class SampledWorld(GridWorld):
    """The sampled world of a Python function, made by `World.from_distance`."""

    grid: Grid
    """Spline of the distances."""
    grip: float = 1.0
    """Multiplier of the friction coefficients."""

    @classmethod
    def of(
        cls, f: Callable[[FloatArray], ArrayLike], bounds: ArrayLike, spacing: float | None, grip: float
    ) -> SampledWorld:
        """Return the world of a signed distance; see `World.from_distance`."""
        import scipy  # slow to import, and rarely needed

        arguments.function("f", f, "a function of points, shape (n, 3), that returns distances, shape (n,)")
        arguments.number("grip", grip, ge=0.0)
        low, high = arguments.array("bounds", bounds, (2, 3))
        if not (low < high).all():
            raise ValueError(
                f"bounds: got {arguments.shown(bounds)}, must be the lowest and the highest corner of a box: "
                "((x, y, z), (x, y, z)), each of the second above that of the first [m]"
            )
        cell = _spacing(high - low, spacing)
        points = _nodes(low, high, cell)
        distance = _asked(f, points.reshape(-1, 3)).reshape(points.shape[:3]) / cell
        _require_a_distance(distance, cell)
        # Reflection continues the distances without a kink. One node beyond the bounds is kept, so that the spline is
        # complete up to the bounds.
        padded = np.pad(distance, kernels.SPLINE_PADDING, mode="reflect", reflect_type="odd")
        spline, beyond = scipy.ndimage.spline_filter(padded, order=3), kernels.SPLINE_PADDING - 1
        coefficients = np.ascontiguousarray(spline[beyond:-beyond, beyond:-beyond, beyond:-beyond])
        fit(coefficients, [_samples(f, distance, low, cell, shift) for shift in product((0.0, 0.5), repeat=3)])
        return cls(Grid(coefficients.astype(np.float32), low - cell, cell), float(grip))

    @classmethod
    def around(cls, world: World, places: FloatArray, margin: float) -> SampledWorld:
        """Return a sampled copy, for pictures only, of the part of a world around places.

        The copy covers the box around the places, shape (..., 3) [m], widened by a margin [m].
        """
        import scipy  # slow to import, and rarely needed

        flat = places.reshape(-1, 3)
        low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
        cell = coarsened(high - low, float((high - low).max()) / NODES_KEPT, NODES_KEPT)
        distance = np.nan_to_num(world.distance(_nodes(low, high, cell))) / cell
        return cls(Grid(scipy.ndimage.spline_filter(distance, order=3).astype(np.float32), low, cell))


World.sampled = SampledWorld.of


def _nodes(low: FloatArray, high: FloatArray, cell: float) -> FloatArray:
    """Return the nodes of a grid over a box, shape (A, B, C, 3) [m]."""
    sides = [begin + cell * np.arange(float(n)) for begin, n in zip(low, node_counts(high - low, cell), strict=True)]
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)


def node_counts(sides: FloatArray, cell: float, margin: int = 0) -> tuple[int, int, int]:
    """Return the number of nodes along each axis of a grid over a box, widened by a margin [cells] on each side.

    The sides of the box have the shape (3,) [m]. If a side is a whole number of cells, rounding errors do not add
    another cell.
    """
    a, b, c = (int(np.ceil(side / cell * (1.0 - 1e-12))) + 2 * margin + 1 for side in sides)
    return a, b, c


def coarsened(sides: FloatArray, cell: float, most: int, margin: int = 0) -> float:
    """Return a cell size of at least `cell` [m] for which the grid over a box has at most `most` nodes."""
    while np.prod([float(n) for n in node_counts(sides, cell, margin)]) > most:
        cell *= 1.05
    return cell


def _spacing(sides: FloatArray, spacing: float | None) -> float:
    largest = float(sides.min()) / 4.0
    if spacing is None:
        return min(coarsened(sides, float(sides.max()) / NODES, NODES), largest)
    cell = arguments.number("spacing", spacing, "m", gt=0.0)
    if cell > largest:
        raise ValueError(
            f"spacing: got {cell:g} m, must be at most {largest:.3g} m, a quarter of the shortest side of the bounds"
        )
    count = float(np.prod(sides / cell + 1.0))
    if count > MOST_NODES:
        raise ValueError(
            f"spacing: got {cell:g} m, which makes {count:.3g} nodes, at most {MOST_NODES:.0e} are allowed; take "
            f"{coarsened(sides, cell, MOST_NODES):.3g} m or more, or smaller bounds"
        )
    return cell


def _asked(f: Callable[[FloatArray], ArrayLike], points: FloatArray) -> FloatArray:
    """Call the user's function and return the checked distances of points, shape (P,) [m].

    The points have the shape (P, 3) [m].
    """
    result = np.empty(len(points))
    for first in range(0, len(points), AT_ONCE):
        some = points[first : first + AT_ONCE]
        found = arguments.floats("f", f(some.copy()))
        if found.shape != (len(some),):
            raise ValueError(
                f"f: returned shape {found.shape} for points of shape {some.shape}, must return a distance for each, "
                f"shape ({len(some)},)"
            )
        if not np.isfinite(found).all():
            wrong = np.flatnonzero(~np.isfinite(found))
            at = ", ".join(f"{x:.4g}" for x in some[wrong[0]])
            raise ValueError(
                f"f: returned {len(wrong)} values that are not finite, as {found[wrong[0]]} at ({at}) m; it must be a "
                "distance everywhere in the bounds"
            )
        result[first : first + len(some)] = found
    return result


def _require_a_distance(distance: FloatArray, cell: float) -> None:
    """Raise ValueError if there is no surface, or if the gradient next to the surface is far from a unit vector."""
    import scipy  # slow to import, and rarely needed

    solid = distance < 0.0
    if solid.all() or not solid.any():
        sign, nearest = ("negative", distance.max()) if solid.any() else ("positive", distance.min())
        raise ValueError(
            f"f: is {sign} everywhere in the bounds (at best {cell * nearest:.3g} m): no surface is there; it must be "
            "positive in free space and negative inside the solid, and the bounds must hold some of both"
        )
    cross = scipy.ndimage.generate_binary_structure(3, 1)
    near = scipy.ndimage.binary_dilation(solid, cross) & scipy.ndimage.binary_dilation(~solid, cross)
    steepness = np.sqrt(np.sum(np.square(np.gradient(distance)), axis=0))[near]
    low, high = np.quantile(steepness, (0.1, 0.9))
    # The central differences of a true distance have at most the length 3^(1/2).
    if low < STEEPNESS[0] or high > STEEPNESS[1] or steepness.max() > 1.75:
        raise ValueError(
            f"f: is no distance: next to its surface it changes by {steepness.min():.3g} to {steepness.max():.3g} m "
            f"per metre ({low:.3g} to {high:.3g} but for a tenth of the places each), must be 1; divide it by the "
            "length of its gradient, or, where the surface is finer than the grid, take a smaller spacing"
        )


def _samples(
    f: Callable[[FloatArray], ArrayLike], distance: FloatArray, low: FloatArray, cell: float, shift: Shift
) -> tuple[Shift, IntArray, FloatArray]:
    """Return the samples near the surface that are shifted from the nodes by `shift`, in the form that `fit` takes."""
    behind = np.argwhere(np.abs(distance[:-1, :-1, :-1]) < FITTED + 1.0)
    found = _asked(f, low + cell * (behind + shift)) / cell
    near = np.abs(found) < FITTED
    return shift, behind[near] + 1, found[near]


def fit(coefficients: FloatArray, samples: Sequence[tuple[Shift, IntArray, FloatArray]]) -> None:
    """Change the coefficients of a spline in place, so that its errors at few samples exceed the tolerance of (WM3).

    Parameters
    ----------
    coefficients : ndarray, shape (A, B, C)
    samples : sequence of tuple
        Groups of samples. Each group has the shift of its samples from the nodes [cells], the indices of the nodes,
        shape (M, 3), and the exact distances, shape (M,) [cells].
    """
    for _ in range(10):  # sweeps. At a few corners the error stays slightly larger than the tolerance
        missed = 0
        for shift, nodes, distance in samples:
            missed += _sweep(coefficients, _weights(shift), np.ascontiguousarray(nodes), distance)
        if not missed:
            return


@njit
def _sweep(c: FloatArray, w: FloatArray, nodes: IntArray, distance: FloatArray) -> int:
    """Apply (WM3) to each sample, and return the number of samples that needed a change."""
    missed, square = 0, np.sum(w * w)
    for m in range(len(nodes)):
        i, j, k = nodes[m, 0] - 1, nodes[m, 1] - 1, nodes[m, 2] - 1
        r = -distance[m]
        for a in range(4):
            for b in range(4):
                for d in range(4):
                    r += w[a, b, d] * c[i + a, j + b, k + d]
        if abs(r) > FIT_TOLERANCE:
            missed += 1
            share = (r - np.sign(r) * FIT_TOLERANCE) / square
            for a in range(4):
                for b in range(4):
                    for d in range(4):
                        c[i + a, j + b, k + d] -= share * w[a, b, d]
    return missed


def _weights(shift: Shift) -> FloatArray:
    """Return the weights of the coefficients around a sample shifted from its node, shape (4, 4, 4)."""
    along, across, up = (np.array(kernels.cubic(t)[0]) for t in shift)
    return np.asarray(along[:, None, None] * across[:, None] * up)
