"""Worlds from mesh files."""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass, field
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np

from worm3d.machine import cache as disk
from worm3d.machine.compiled import cfunc
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray, IntArray
from worm3d.values.read_only import ReadOnly
from worm3d.worlds import distance_grid, mesh_file, mesh_kernel, mesh_spline, table
from worm3d.worlds.base import WorldKernel
from worm3d.worlds.distance_grid import MOST_NODES, Grid
from worm3d.worlds.laid import laid
from worm3d.worlds.mesh_file import MeshError, Units
from worm3d.worlds.table import looked_up

NODES = 1_000_000
"""Of a grid whose cell is not given: 4 MB, about a second to fill."""

COARSER = 1.05
"""Steps in which such a cell is sought."""

VERSION = b"worm3d grid 3"
"""Of what `distance_grid.filled` computes; a change of it makes grids on disk those of another version."""

KEPT = 20
"""Grids on disk beyond this number are removed, the oldest first."""

_HEAD = struct.Struct("<3q4d")
"""Nodes along each axis, first node, cell."""


@dataclass(frozen=True, eq=False)
class Mesh(ReadOnly):
    """A closed triangle mesh from a file, as a grid of signed distances; frozen, validated.

    The grid is computed once and kept on disk under a digest of the file and of what is asked for. Edges and corners
    are rounded by about a cell (`worm3d.worlds.mesh_spline`).

    Attributes
    ----------
    path : str or path
        An STL, OBJ, PLY or GLB file.
    units : {"m", "cm", "mm", "in", "ft"}
        Of the file's coordinates. STL, OBJ and PLY files do not say theirs; GLB is in metres if it is left out.
    solid : {"inside", "outside"}
        "inside": what the mesh encloses is solid, the worm crawls on it (or through a hole in it). "outside": what it
        encloses is free, as the air in a tunnel, and all around is solid.
    cell : float, optional
        Of the grid [m]; that of a grid of a million nodes if left out.
    up : {"z", "y"}
        The file's axis that points up; y becomes z by a quarter turn about x. glTF's convention is y.
    position : tuple of float
        Where the file's origin is in the world [m].
    grip : float
        Multiplier of the friction coefficients.

    Raises
    ------
    MeshError
        The file cannot be a world (`worm3d.worlds.mesh_file`), or its grid would be too large.
    ValueError
        A value out of range.
    """

    path: str | PathLike[str]
    units: Units | None = None
    solid: Literal["inside", "outside"] = "inside"
    cell: float | None = None
    up: Literal["z", "y"] = "z"
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    grip: float = 1.0
    grid: Grid = field(init=False, repr=False)

    def __post_init__(self) -> None:
        arguments.instance("path", self.path, str | PathLike, "the path of a file")
        for name, allowed in (("solid", ("inside", "outside")), ("up", ("z", "y"))):
            arguments.choice(name, getattr(self, name), allowed)
        if self.cell is not None:
            arguments.number("cell", self.cell, "m", gt=0.0)
        object.__setattr__(self, "position", tuple(arguments.array("position", self.position, (3,)).tolist()))
        arguments.number("grip", self.grip, ge=0.0)
        object.__setattr__(self, "grid", self._grid())

    def _grid(self) -> Grid:
        """Return the grid, from disk if it is there."""
        path = Path(self.path)
        data, scale = mesh_file.content(path), mesh_file.scale_of(path, self.units)
        asked = f"{path.suffix.lower()} {scale!r} {self.up} {self.cell!r}".encode()
        key = hashlib.sha256(b"\0".join([VERSION, asked, data])).hexdigest()
        folder = _folder()
        kept = disk.load(folder, key)
        if kept is not None:
            return _unpacked(kept)
        vertices, faces = self._triangles(path, data, scale)
        grid = distance_grid.filled(vertices, faces, self._cell(path.name, vertices))
        disk.store(folder, key, _packed(grid), most=KEPT)
        return grid

    def _triangles(self, path: Path, data: bytes, scale: float) -> tuple[FloatArray, IntArray]:
        vertices, faces = mesh_file.triangles(path, data, scale)
        if self.up == "y":
            vertices = np.column_stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]])
        return vertices, faces

    def _cell(self, name: str, vertices: FloatArray) -> float:
        """Return the size of a cell, one that memory has room for."""
        if self.cell is None:
            return _coarsened(vertices, float(np.ptp(vertices, axis=0).max()) / NODES, NODES)
        count = float(np.prod(np.ptp(vertices, axis=0) / self.cell + 2.0 * distance_grid.MARGIN + 1.0))
        if count > MOST_NODES:
            least = _coarsened(vertices, self.cell, MOST_NODES)
            raise MeshError(
                f"mesh {name!r}: cells of {self.cell:g} m make {count:.3g} nodes ({4e-6 * count:.3g} MB), at most "
                f"{MOST_NODES:.0e} are allowed; take cell={least:.3g} m or more"
            )
        return self.cell

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return vertices (V, 3) [m] and faces (F, 3) of the file, in the world; for pictures."""
        path = Path(self.path)
        vertices, faces = self._triangles(path, mesh_file.content(path), mesh_file.scale_of(path, self.units))
        return vertices + self.position, faces

    @property
    def uneven(self) -> bool:
        """Whether a worm without friction could slide away under `pressing`."""
        return True

    def kernel(self, band: float = mesh_kernel.CONTACT) -> WorldKernel:
        """Return the compiled world, which reads the spline where a coefficient is less than so many cells."""
        c, first, spline = self.grid.coefficients, self.grid.first + self.position, mesh_spline.kernel()
        side = 1.0 if self.solid == "inside" else -1.0
        work = np.zeros((mesh_kernel.WORK_ROWS, mesh_kernel.TOGETHER))  # of this kernel alone: others may run beside it
        parameters = [
            *(*table.halves(c.ctypes.data), *table.halves(work.ctypes.data), *table.halves(spline.address)),
            *(*c.shape, *first, self.grid.cell, side, self.grip, band),
        ]
        return WorldKernel(_compiled().address, np.array(parameters, dtype=float), (_compiled(), c, work, spline))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance of points of shape (..., 3), shape (...,) [m]."""
        found: FloatArray = looked_up(self.kernel(np.inf), points)[0].reshape(np.shape(points)[:-1])
        return found

    def pressing(self, gravity: FloatArray) -> FloatArray:
        """Return gravity, shape (3,) [m/s^2]."""
        return np.array(gravity, dtype=float)

    def floor(self, places: FloatArray) -> FloatArray:
        """Return the height of the ground at x, y of shape (M, 2), NaN where there is none, shape (M,) [m].

        The highest ground of a mesh that is solid inside, the lowest of one that is solid outside.
        """
        grid, size = self.grid, self.grid.coefficients.shape
        bottom = grid.first[2] + self.position[2]
        z = bottom + grid.cell * np.arange(float(size[2]))
        columns = np.concatenate(
            [np.repeat(places[:, None], len(z), axis=1), np.tile(z, (len(places), 1))[:, :, None]], axis=2
        )
        g = self.distance(columns)
        enters = (g[:, :-1] < 0.0) & (g[:, 1:] >= 0.0)
        k = (
            enters.shape[1] - 1 - np.argmax(enters[:, ::-1], axis=1)
            if self.solid == "inside"
            else np.argmax(enters, axis=1)
        )
        low, high = z[k], z[k + 1]
        for _ in range(40):  # halvings: to rounding
            middle = (low + high) / 2.0
            below = self.distance(np.column_stack([places, middle])) < 0.0
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.where(enters.any(axis=1), high, np.nan)

    def placed(
        self, along: FloatArray, clearance: float, position: FloatArray, azimuth: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return joints of a straight worm laid on the `floor` from above, and its director; see `World.placed`.

        Raises
        ------
        ValueError
            There is no ground under a part of the worm.
        """
        joints = position + along[:, None] * [np.cos(azimuth), np.sin(azimuth)]
        if np.isnan(self.floor(joints)).any():
            bare = joints[np.isnan(self.floor(joints))][0]
            raise ValueError(
                f"position: got {np.asarray(position).tolist()!r} m: the mesh has no ground under the worm at "
                f"x = {bare[0]:.4g}, y = {bare[1]:.4g} m; move or turn it, or give a State"
            )
        return laid(lambda places: np.nan_to_num(self.floor(places), nan=-1e3), along, clearance, position, azimuth)


def _coarsened(vertices: FloatArray, cell: float, most: int) -> float:
    """Return a cell, at least the one given, of which a grid has at most so many nodes."""
    while np.prod([float(n) for n in distance_grid.shape(vertices, cell)]) > most:
        cell *= COARSER
    return cell


def _packed(grid: Grid) -> bytes:
    return _HEAD.pack(*grid.coefficients.shape, *grid.first, grid.cell) + grid.coefficients.tobytes()


def _unpacked(content: bytes) -> Grid:
    *size, x, y, z, cell = _HEAD.unpack_from(content)
    coefficients = np.frombuffer(content, dtype=np.float32, offset=_HEAD.size).reshape(size)
    return Grid(coefficients, np.array([x, y, z]), cell)


def _folder() -> Path | None:
    return disk.folder("grids")


@cache
def _compiled() -> Any:
    return cfunc(table.SIGNATURE, mesh_kernel.mesh, table.OPTIMISATION)
