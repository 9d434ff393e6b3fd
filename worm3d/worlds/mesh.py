"""Worlds from mesh files."""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from worm3d.machine import cache as disk
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray, IntArray
from worm3d.worlds import mesh_distance, mesh_file
from worm3d.worlds.mesh_distance import GRID_MARGIN_CELLS
from worm3d.worlds.mesh_file import MeshError, Units
from worm3d.worlds.sampled import MOST_NODES, NODES, Grid, GridWorld, coarsened

VERSION = b"worm3d grid 3"
"""Version of the grids that `mesh_distance.filled` computes. Grids stored on disk by another version are not read."""

_HEAD = struct.Struct("<3q4d")
"""Layout of the header of a grid on disk: number of nodes along each axis, position of the first node, cell size."""


@dataclass(frozen=True, eq=False)
class Mesh(GridWorld):
    """A closed triangle mesh from a file, as a grid of signed distances. The object is frozen and validated.

    The grid is computed once and stored on disk under a digest of the file and the options. At edges and corners, which
    become round, the surface is off by up to a fifth of a cell (`worm3d.worlds.sampled_kernel`).

    Attributes
    ----------
    path : str or path
        An STL, OBJ, PLY or GLB file.
    units : {"m", "cm", "mm", "in", "ft"}
        Unit of the file's coordinates. It must be given for STL, OBJ and PLY files, which do not state a unit. For GLB
        files the default is metres.
    solid : {"inside", "outside"}
        With "inside", the enclosed space is solid, and the worm crawls on the mesh (or through a hole in it). With
        "outside", the enclosed space is free, like the air in a tunnel, and everything around it is solid.
    cell : float, optional
        Size of the cells of the grid [m]. If it is left out, the grid has up to a million nodes.
    up : {"z", "y"}
        The axis of the file that points up. With "y", the mesh is rotated by a quarter turn about x. glTF files
        usually have y up.
    position : tuple of float
        Position of the file's origin in the world [m].
    grip : float
        Multiplier of the friction coefficients.

    Raises
    ------
    MeshError
        The file cannot be a world (`worm3d.worlds.mesh_file`), or the grid would be too large.
    ValueError
        A value is out of range.
    """

    straight: ClassVar[bool] = False

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
        """Return the grid of the file, from disk if stored there."""
        path = Path(self.path)
        data, scale = mesh_file.content(path), mesh_file.scale_of(path, self.units)
        asked = f"{path.suffix.lower()} {scale!r} {self.up} {self.cell!r}".encode()
        key = hashlib.sha256(b"\0".join([VERSION, asked, data])).hexdigest()
        kept = disk.load(_folder(), key)
        if kept is not None:
            return _unpacked(kept)
        vertices, faces = self._triangles(path, data, scale)
        grid = mesh_distance.filled(vertices, faces, self._cell(path.name, vertices))
        disk.store(_folder(), key, _packed(grid), most=20)
        return grid

    def _triangles(self, path: Path, data: bytes, scale: float) -> tuple[FloatArray, IntArray]:
        vertices, faces = mesh_file.triangles(path, data, scale)
        if self.up == "y":
            vertices = np.column_stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]])
        return vertices, faces

    def _cell(self, name: str, vertices: FloatArray) -> float:
        """Return the cell size [m], chosen by the number of nodes if the user gives none.

        Raises
        ------
        MeshError
            The grid with the user's cell size has too many nodes.
        """
        sides = np.ptp(vertices, axis=0)
        if self.cell is None:
            return coarsened(sides, float(sides.max()) / NODES, NODES, GRID_MARGIN_CELLS)
        count = float(np.prod(sides / self.cell + 2.0 * GRID_MARGIN_CELLS + 1.0))
        if count > MOST_NODES:
            least = coarsened(sides, self.cell, MOST_NODES, GRID_MARGIN_CELLS)
            raise MeshError(
                f"mesh {name!r}: cells of {self.cell:g} m make {count:.3g} nodes ({4e-6 * count:.3g} MB), at most "
                f"{MOST_NODES:.0e} are allowed; take cell={least:.3g} m or more"
            )
        return self.cell

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """Return the vertices [m] and faces of the file in world coordinates, for drawing, shapes (V, 3) and (F, 3)."""
        path = Path(self.path)
        vertices, faces = self._triangles(path, mesh_file.content(path), mesh_file.scale_of(path, self.units))
        return vertices + self.position, faces

    @property
    def first(self) -> FloatArray:
        """Position of the grid's first node, shape (3,) [m]."""
        return np.asarray(self.grid.first + self.position)

    @property
    def side(self) -> float:
        """1 if the inside is solid, -1 if the outside is solid."""
        return 1.0 if self.solid == "inside" else -1.0


def _packed(grid: Grid) -> bytes:
    return _HEAD.pack(*grid.coefficients.shape, *grid.first, grid.cell) + grid.coefficients.tobytes()


def _unpacked(content: bytes) -> Grid:
    *size, x, y, z, cell = _HEAD.unpack_from(content)
    coefficients = np.frombuffer(content, dtype=np.float32, offset=_HEAD.size).reshape(size)
    return Grid(coefficients, np.array([x, y, z]), cell)


def _folder() -> Path | None:
    return disk.folder("grids")
