"""Commands for meshcat's viewer from pieces, in the same form as from the Python module `meshcat.commands`.

Only the browser viewer of meshcat 0.3.2 is used. The Python package is not used because it imports a web server and
IPython, makes random identifiers, and writes animations as long lists of objects. Here, identifiers are computed from
the paths, so that the same frames give the same bytes. The tracks of an animation are sent as packed arrays, which
three.js also accepts and which take a tenth of the size.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import umsgpack
from numpy.typing import ArrayLike, NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer.colours import as_hex
from worm3d.viewer.piece import Piece

Content = dict[str, Any]
"""A command or a part of it, before it is packed."""

_ROOT = "/meshcat"
_STANDING = np.eye(4).ravel().tolist()
_ARRAY_TYPES = {"<f4": ("Float32Array", 0x17), "<u4": ("Uint32Array", 0x16)}
"""Name in three.js, and type number in meshcat's viewer, of each type of packed arrays."""

ALL_BITS = 23
"""Number of bits after the first of a number as it is sent."""


def packed(content: Content) -> bytes:
    """Return a command as bytes for transmission."""
    message: bytes = umsgpack.packb(content)
    return message


def _show(path: str, geometry: Content, material: Content, order: int = 0) -> Content:
    """Return the command that puts a mesh at a path. Meshes with a higher `order` are drawn later."""
    ids = {part: f"{path}:{part}" for part in ("geometry", "material")}
    command = _object(path, type="Mesh", **ids, matrix=_STANDING, renderOrder=order)
    command["object"]["geometries"] = [{"uuid": ids["geometry"], **geometry}]
    command["object"]["materials"] = [{"uuid": ids["material"], "side": 2, **material}]  # both sides are visible
    command["object"]["textures"] = []
    return command


def _object(path: str, **properties: Any) -> Content:
    """Return the command that puts an object at a path. The object is sent as a scene of three.js."""
    about = {"version": 4.5, "type": "Object"}
    scene = {"metadata": about, "geometries": [], "materials": [], "object": {"uuid": path, **properties}}
    return {"type": "set_object", "object": scene, "path": path}


def _transform(path: str, matrix: FloatArray) -> Content:
    return {"type": "set_transform", "path": path, "matrix": matrix.T.ravel().tolist()}


def _property(path: str, name: str, value: Any) -> Content:
    return {"type": "set_property", "path": path, "property": name, "value": value}


def _packed(vectors: NDArray[Any], form: str = "<f4") -> Content:
    """Return vectors, shape (V, 3), as an attribute of a geometry."""
    name, _ = _ARRAY_TYPES[form]
    return {"itemSize": vectors.shape[1], "type": name, "array": _binary(vectors, form), "normalized": False}


def _binary(values: NDArray[Any], form: str = "<f4") -> Any:
    return umsgpack.Ext(_ARRAY_TYPES[form][1], np.ascontiguousarray(values, dtype=form).tobytes())


def shortened(values: ArrayLike, bits: int) -> NDArray[np.float32]:
    """Return numbers rounded to some bits after the first bit. The other bits are zero and can be compressed."""
    numbers = np.ascontiguousarray(values, dtype="<f4").view("<u4")
    half, kept = (1 << (ALL_BITS - bits)) >> 1, 0xFFFFFFFF << (ALL_BITS - bits) & 0xFFFFFFFF
    return ((numbers + np.uint32(half)) & np.uint32(kept)).view("<f4")


def _track(
    name: str, form: str, time: FloatArray, values: FloatArray, bits: int = ALL_BITS, stepped: bool = False
) -> Content:
    """Return a track of an animation. If the values are constant, the track has only the first key.

    The values are rounded as by `shortened`.
    """
    if (values == values[0]).all():
        time, values = time[:1], values[:1]
    track = {"name": name, "type": form, "times": _binary(time), "values": _binary(shortened(values, bits))}
    return {**track, "interpolation": 2300} if stepped else track  # InterpolateDiscrete in three.js


def stage() -> list[Content]:
    """Return the commands that set light and background, and remove meshcat's grid, axes and near lights."""
    removed = ("Grid", "Axes", "Lights/PointLightNegativeX", "Lights/PointLightPositiveX", "Lights/FillLight")
    # These lights reach everywhere; meshcat's lights end ten metres from the origin.
    sky = {"type": "HemisphereLight", "color": 0xFFFFFF, "groundColor": 0x8A7F78, "intensity": 0.2}
    sun = {"type": "DirectionalLight", "color": 0xFFFFFF, "intensity": 0.4, "matrix": [*_STANDING[:12], -2, -3, 4, 1]}
    return [
        *(_property(f"/{name}", "visible", False) for name in removed),
        _property("/Background", "top_color", [0.93, 0.95, 0.97]),
        _property("/Background", "bottom_color", [0.72, 0.76, 0.80]),
        _object("/Lights/Sky", **sky),
        _object("/Lights/Sun", **sun),
        # The viewer makes every object cast shadows, but a sky light cannot do so.
        _property("/Lights/Sky/<object>", "castShadow", False),
        _property("/Lights/Sun/<object>", "castShadow", False),
    ]


def _at(piece: Piece) -> str:
    return f"{_ROOT}/{piece.path}"


def place(piece: Piece) -> list[Content]:
    """Return the commands that place the mesh of a piece with its pose in the first frame."""
    shown = _show(_at(piece), _geometry(piece), _material(piece), order=int(piece.on_top))
    return [shown] if piece.position is None else [shown, _transform(_at(piece), piece.matrix(0))]


def _geometry(piece: Piece) -> Content:
    attributes = {"position": _packed(piece.mesh.vertices)}
    if piece.paint is not None:
        attributes["color"] = _packed(piece.paint)
    return {"type": "BufferGeometry", "data": {"attributes": attributes, "index": _packed(piece.mesh.faces, "<u4")}}


def _material(piece: Piece) -> Content:
    clear = piece.opacity < 1.0
    return {
        "type": "MeshPhongMaterial",
        "color": int(as_hex(piece.colour_at(0))[1:], 16) if piece.paint is None else 0xFFFFFF,
        "vertexColors": 0 if piece.paint is None else 2,  # VertexColors in three.js
        "reflectivity": 0.5,
        "opacity": piece.opacity,
        # Pieces on top are drawn last, together with transparent pieces.
        "transparent": clear or piece.on_top,
        "depthTest": not piece.on_top,
        "depthWrite": not clear,
        "specular": 0 if piece.layer == "world" else 0x111111,
    }


def animate(pieces: list[Piece], time: FloatArray, bits: int = ALL_BITS) -> Content:
    """Return the command with the motion of all pieces, which must have been placed before.

    The times have the shape (T,) and start at 0 [s]. The motion is rounded to `bits` bits, as by `shortened`.
    """
    tracks = {_at(piece): _moves(piece, time, bits) for piece in pieces}
    tracks |= {f"{_at(piece)}/<object>": _looks(piece, time, bits) for piece in pieces}
    # With one key per second, times are in seconds.
    clips = [{"path": path, "clip": {"fps": 1, "name": "default", "tracks": of}} for path, of in tracks.items() if of]
    options = {"play": False, "repetitions": 1}
    return {"type": "set_animation", "animations": clips, "options": options, "path": ""}


def _moves(piece: Piece, time: FloatArray, bits: int) -> list[Content]:
    tracks = []
    if piece.position is not None:
        tracks.append(_track(".position", "vector3", time, piece.position, bits))
    if piece.turn is not None:
        tracks.append(_track(".quaternion", "quaternion", time, quaternions(piece.turn), bits))
    if piece.scale is not None:
        tracks.append(_track(".scale", "vector3", time, piece.scale, bits, piece.stepped))
    return tracks


def quaternions(axes: FloatArray) -> FloatArray:
    """Return the quaternions of rotation matrices, shape (..., 4), without loss of accuracy at any angle.

    The matrices have the shape (..., 3, 3).
    """
    m = axes
    diagonal = np.stack([m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    trace = diagonal.sum(axis=-1)
    # The squares of 2 x, 2 y, 2 z and 2 w. The row of the largest square is used below.
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


def _looks(piece: Piece, time: FloatArray, bits: int) -> list[Content]:
    return [] if piece.tint is None else [_track(".material.color", "color", time, piece.tint, bits)]


def script() -> str:
    """Return the script of meshcat's viewer, which includes three.js, from the installed package."""
    spec = find_spec("meshcat")
    assert spec is not None  # a requirement of worm3d
    assert spec.origin is not None
    return (Path(spec.origin).parent / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")
