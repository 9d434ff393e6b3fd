"""Read the triangles of a mesh file, in metres. A mesh that is not closed or does not face outwards is refused.

The package trimesh reads the file. The checks here are needed because trimesh reads garbage as an empty mesh, keeps
NaN, and raises many kinds of errors for truncated files.
"""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np

from worm3d.values import regular_file
from worm3d.values.arrays import FloatArray, IntArray
from worm3d.worlds import mesh_format

Units = Literal["m", "cm", "mm", "in", "ft"]

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Length of each unit [m]."""

SUFFIXES = (".stl", ".obj", ".ply", ".glb")

MAX_MESH_SIDE, MIN_MESH_SIDE = 1000.0, 0.01
"""Range of the longest side of a mesh [m]."""

LARGEST_FILE = 500_000_000
"""Size of the largest mesh file [byte]. A binary STL file of this size has ten million triangles."""


class MeshError(ValueError):
    """A mesh file cannot be a world; the message says why and how to correct the file."""


def content(path: Path) -> bytes:
    """Return the bytes of a mesh file.

    Raises
    ------
    MeshError
        The file does not exist, has an unknown extension, or is empty.
    """
    what, suffix = f"mesh {path.name!r}", path.suffix
    if suffix.lower() not in SUFFIXES:
        raise MeshError(f"{what}: unknown extension {suffix!r}, must be one of {', '.join(SUFFIXES)}; export it")
    data = regular_file.content(path, LARGEST_FILE, "mesh", MeshError)
    if not data:
        raise MeshError(f"{what}: the file is empty; export it again")
    return data


def scale_of(path: Path, units: str | None) -> float:
    """Return the length of the file's unit of length [m].

    Raises
    ------
    MeshError
        The units are unknown, or are left out for a format whose files do not state a unit.
    """
    if units is None and path.suffix.lower() == ".glb":
        return 1.0  # metres, the unit of glTF
    if units not in METRES:
        given = "none" if units is None else repr(units)
        raise MeshError(
            f"mesh {path.name!r}: units: got {given}, must be one of {', '.join(map(repr, METRES))}: "
            f"{path.suffix.lower()[1:].upper()} files do not say theirs"
        )
    return METRES[units]


def triangles(path: Path, data: bytes, scale: float) -> tuple[FloatArray, IntArray]:
    """Return the checked vertices [m] and faces of a mesh file.

    Parameters
    ----------
    path : Path
        Path of the file, for its format and for error messages.
    data : bytes
        Content of the file.
    scale : float
        Length of the file's unit [m].

    Returns
    -------
    ndarray, shape (V, 3)
    ndarray, shape (F, 3)

    Raises
    ------
    MeshError
        The mesh is truncated, garbage, not finite, of an unlikely size, not closed, or inside-out.
    """
    try:
        return _checked(path.suffix.lower()[1:], data, scale)
    except MeshError as error:
        raise MeshError(f"mesh {path.name!r}: {error}") from None


def _checked(kind: str, data: bytes, scale: float) -> tuple[FloatArray, IntArray]:
    if said := mesh_format.wrong(kind, data):
        raise MeshError(said)
    mesh = _read(kind, data)
    _require_finite(mesh)
    with np.errstate(all="ignore"):
        _require_size(np.asarray(mesh.vertices, dtype=float) * scale, np.asarray(mesh.faces))
        mesh.merge_vertices()
    _require_solid(mesh)
    return np.asarray(mesh.vertices, dtype=float) * scale, np.asarray(mesh.faces, dtype=np.int64)


def _read(kind: str, data: bytes) -> Any:
    import trimesh  # takes a second or two

    data = mesh_format.as_utf8(data) if kind == "obj" else data
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded: Any = trimesh.load(BytesIO(data), file_type=kind, force="mesh", process=False)
            vertices, faces = np.array(loaded.vertices, dtype=np.float64), np.array(loaded.faces, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise ValueError("vertices without x, y and z")
    except Exception as error:  # readers raise many kinds of errors
        dangles = isinstance(error, LookupError | TypeError | AttributeError)
        lines = str(error).strip().splitlines() or [type(error).__name__]
        reason = "it refers to what it does not have" if dangles else lines[0][:80]
        raise MeshError(f"truncated, or no {kind.upper()} file at all ({reason}); export it again") from None
    if len(faces) == 0:
        raise MeshError("no triangles in it: empty, truncated or garbage; export it again")
    _require_indices(faces, len(vertices))
    # Built again from plain arrays: trimesh's readers leave normals, colours and caches that may not fit.
    return trimesh.Trimesh(vertices, faces, process=False)


def _require_indices(faces: IntArray, count: int) -> None:
    """Raise MeshError for faces with vertices that do not exist, before the faces are used."""
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError("got faces that are no triangles; export it again, triangulated")
    wrong = (faces < 0) | (faces >= count)
    if wrong.any():
        raise MeshError(f"a face names vertex {faces[wrong][0]} of {count}; export it again")


def _require_finite(mesh: Any) -> None:
    """Raise MeshError for vertices with NaN or infinity. trimesh drops or keeps these without an error."""
    count = np.count_nonzero(~np.isfinite(np.asarray(mesh.vertices, dtype=float)).all(axis=1))
    if count:
        raise MeshError(f"got {count} vertices that are not finite (NaN); repair it where it was made")


def _require_size(vertices: FloatArray, faces: IntArray) -> None:
    side = float(np.ptp(vertices[faces.ravel()], axis=0).max())
    if not MIN_MESH_SIDE <= side <= MAX_MESH_SIDE:
        raise MeshError(
            f"got {side:.4g} m across, must be {MIN_MESH_SIDE:g} to {MAX_MESH_SIDE:g} m; check `units` (a file in "
            "millimetres needs units='mm')"
        )


def _require_solid(mesh: Any) -> None:
    """Raise MeshError for a surface that is not closed, not oriented outwards, or encloses no volume."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        closed, consistent, volume = bool(mesh.is_watertight), bool(mesh.is_winding_consistent), float(mesh.volume)
    if not closed:
        edges, count = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
        raise MeshError(
            f"not closed: {np.count_nonzero(count != 2)} of its {len(edges)} edges do not join two "
            "faces, so it has no inside; close it (cap the ends, give terrain a base), or use worm3d.Heightfield"
        )
    if not consistent:
        raise MeshError("some faces look in, some out; recalculate its normals and export it again")
    if abs(volume) < 1e-9 * float(np.ptp(np.asarray(mesh.vertices), axis=0).max()) ** 3:
        raise MeshError("encloses no volume; close it around something")
    if volume < 0.0:
        raise MeshError(
            f"inside-out: its faces look inwards (volume {volume:.4g}); flip them and export it again "
            "(that the worm crawls inside is said by solid='outside')"
        )
