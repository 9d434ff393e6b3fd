"""Triangles of a mesh file, in metres, closed and facing outwards, or an error that names the fault.

trimesh reads the file. The library takes garbage for an empty mesh, keeps NaN, and raises various errors for truncated
files.
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
"""Largest mesh file [byte]: ten million triangles."""

MIN_ENCLOSED_VOLUME = 1e-9
"""Volume below which nothing is enclosed, as a fraction of the cube of the longest side."""

STL_HEADER, STL_TRIANGLE = 84, 50
"""Sizes in a binary STL file [byte]."""


class MeshError(ValueError):
    """A mesh file cannot be a world; the message says why and how to correct the file."""


def content(path: Path) -> bytes:
    """Return the bytes of a mesh file.

    Raises
    ------
    MeshError
        No such file, an unknown extension, or nothing in it.
    """
    name = path.name
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(
            f"mesh {name!r}: unknown extension {path.suffix!r}, must be one of {', '.join(SUFFIXES)}; export it"
        )
    try:
        data = regular_file.read(path, LARGEST_FILE)
    except FileNotFoundError:
        raise MeshError(f"mesh {name!r}: there is no such file in {str(path.parent)!r}; check the path") from None
    except OSError as error:
        raise MeshError(
            f"mesh {name!r}: cannot be read ({error.strerror}); check the path and its permissions"
        ) from None
    if not data:
        raise MeshError(f"mesh {name!r}: the file is empty; export it again")
    return data


def scale_of(path: Path, units: str | None) -> float:
    """Return the metres in a unit of the file.

    Raises
    ------
    MeshError
        Units that are unknown, or left out for a format that does not state units.
    """
    if units is None and path.suffix.lower() == ".glb":
        return METRES["m"]  # the unit of glTF
    if units not in METRES:
        given = "none" if units is None else repr(units)
        raise MeshError(
            f"mesh {path.name!r}: units: got {given}, must be one of {', '.join(map(repr, METRES))}: "
            f"{path.suffix.lower()[1:].upper()} files do not say theirs"
        )
    return METRES[units]


def triangles(path: Path, data: bytes, scale: float) -> tuple[FloatArray, IntArray]:
    """Return vertices (V, 3) [m] and faces (F, 3) of the bytes of a mesh file, checked.

    Raises
    ------
    MeshError
        A mesh that is truncated, garbage, not finite, of an unlikely size, not closed, or inside-out.
    """
    _require_whole_stl(path, data)
    if said := mesh_format.wrong(path.suffix.lower(), data):
        raise MeshError(f"mesh {path.name!r}: {said}")
    mesh = _read(path, data)
    _require_finite(path.name, mesh)
    with np.errstate(all="ignore"):
        _require_size(path.name, np.asarray(mesh.vertices, dtype=float) * scale, np.asarray(mesh.faces))
        mesh.merge_vertices()
    vertices, faces = np.asarray(mesh.vertices, dtype=float) * scale, np.asarray(mesh.faces, dtype=np.int64)
    _require_solid(path.name, mesh, vertices)
    return vertices, faces


def _require_whole_stl(path: Path, data: bytes) -> None:
    if path.suffix.lower() != ".stl":
        return
    text = data.lstrip()[:5].lower() == b"solid"
    expected = STL_HEADER + STL_TRIANGLE * int.from_bytes(data[80:84], "little") if len(data) >= STL_HEADER else -1
    if len(data) == expected or (text and b"endsolid" in data.lower()):
        return
    if text:
        raise MeshError(f"mesh {path.name!r}: truncated: its text has no 'endsolid'; export it again")
    raise MeshError(
        f"mesh {path.name!r}: truncated or no STL: got {len(data)} bytes where its header tells of {max(expected, 0)}; "
        "export it again"
    )


def _read(path: Path, data: bytes) -> Any:
    import trimesh  # takes a second or two

    data = mesh_format.as_utf8(data) if path.suffix.lower() == ".obj" else data
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            loaded: Any = trimesh.load(BytesIO(data), file_type=path.suffix.lower()[1:], force="mesh", process=False)
            vertices, faces = np.array(loaded.vertices, dtype=np.float64), np.array(loaded.faces, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise ValueError("vertices without x, y and z")
    except Exception as error:  # readers raise many kinds of errors
        dangles = isinstance(error, LookupError | TypeError | AttributeError)
        reason = ["it refers to what it does not have"] if dangles else str(error).strip().splitlines()
        raise MeshError(
            f"mesh {path.name!r}: truncated, or no {path.suffix.lower()[1:].upper()} file at all "
            f"({(reason or [type(error).__name__])[0][:80]}); export it again"
        ) from None
    if len(faces) == 0:
        raise MeshError(f"mesh {path.name!r}: no triangles in it: empty, truncated or garbage; export it again")
    _require_indices(path.name, faces, len(vertices))
    # Built again from plain arrays: trimesh's readers leave normals, colours and caches that may not fit.
    return trimesh.Trimesh(vertices, faces, process=False)


def _require_indices(name: str, faces: IntArray, count: int) -> None:
    """Raise MeshError for faces with vertices that do not exist, before the faces are used."""
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f"mesh {name!r}: got faces that are no triangles; export it again, triangulated")
    wrong = (faces < 0) | (faces >= count)
    if wrong.any():
        raise MeshError(f"mesh {name!r}: a face names vertex {faces[wrong][0]} of {count}; export it again")


def _require_finite(name: str, mesh: Any) -> None:
    """Raise MeshError for NaN and infinity, which trimesh would silently drop or keep."""
    count = np.count_nonzero(~np.isfinite(np.asarray(mesh.vertices, dtype=float)).all(axis=1))
    if count:
        raise MeshError(f"mesh {name!r}: got {count} vertices that are not finite (NaN); repair it where it was made")


def _require_size(name: str, vertices: FloatArray, faces: IntArray) -> None:
    side = float(np.ptp(vertices[faces.ravel()], axis=0).max())
    if not MIN_MESH_SIDE <= side <= MAX_MESH_SIDE:
        raise MeshError(
            f"mesh {name!r}: got {side:.4g} m across, must be {MIN_MESH_SIDE:g} to {MAX_MESH_SIDE:g} m; check `units` "
            "(a file in millimetres needs units='mm')"
        )


def _require_solid(name: str, mesh: Any, vertices: FloatArray) -> None:
    """Raise MeshError for a surface without a definite inside."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        closed, consistent, volume = bool(mesh.is_watertight), bool(mesh.is_winding_consistent), float(mesh.volume)
    if not closed:
        edges, count = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
        raise MeshError(
            f"mesh {name!r}: not closed: {np.count_nonzero(count != 2)} of its {len(edges)} edges do not join two "
            "faces, so it has no inside; close it (cap the ends, give terrain a base), or use worm3d.Heightfield"
        )
    if not consistent:
        raise MeshError(f"mesh {name!r}: some faces look in, some out; recalculate its normals and export it again")
    if abs(volume) < MIN_ENCLOSED_VOLUME * float(np.ptp(np.asarray(mesh.vertices), axis=0).max()) ** 3:
        raise MeshError(f"mesh {name!r}: encloses no volume; close it around something")
    if volume < 0.0:
        raise MeshError(
            f"mesh {name!r}: inside-out: its faces look inwards (volume {volume:.4g}); flip them and export it again "
            "(that the worm crawls inside is said by solid='outside')"
        )
