"""Commands for meshcat's viewer, made from pieces as in `meshcat.commands`; a recorder keeps the commands.

Only the browser viewer of meshcat 0.3.2 is used. The Python side of meshcat imports a web server and IPython, makes
random identifiers, and repeats the key times of an animation in lists of objects. Here identifiers follow from the
paths, so that the same frames give the same bytes. Tracks are sent as packed arrays, which three.js also accepts and
which take a tenth of the size.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import umsgpack
from numpy.typing import NDArray

from worm3d.values.arrays import FloatArray
from worm3d.viewer.colours import as_number
from worm3d.viewer.piece import Piece

Content = dict[str, Any]
"""A part of a command, in the form that is packed."""

_DISCRETE = 2300
"""Value of InterpolateDiscrete in three.js."""
_DOUBLE_SIDE, _VERTEX_COLOURS = 2, 2
"""Values of DoubleSide and VertexColors in three.js."""
_TOP, _BOTTOM = [0.93, 0.95, 0.97], [0.72, 0.76, 0.80]
_ROOT = "/meshcat"
_STANDING = np.eye(4).ravel().tolist()
_ARRAY_TYPES = {"<f4": ("Float32Array", 0x17), "<u4": ("Uint32Array", 0x16)}
"""Types of packed arrays: name in three.js, and the type number in meshcat's viewer."""


FONT = 22
"""Size of a caption's letters, in pixels of a picture 256 wide; longer captions get smaller letters."""

CAPTION_SIZE, CAPTION_AT = 0.6, (0.0, 0.68, -1.0)
"""Side of the square with a caption in the middle; place of the square before the camera, which sees from -0.77 to
0.77."""

_CAMERA = "/Cameras/default/rotated/<object>"


class Window(Protocol):
    """Receiver of commands."""

    def send(self, command: Content) -> None:
        """Take one command."""


class Recorder:
    """A window without a server, which keeps the packed commands in order."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []

    def send(self, command: Content) -> None:
        """Take one command of meshcat."""
        self.messages.append(packed(command))


def packed(content: Content) -> bytes:
    """Return the content of a command in the form for transmission."""
    message: bytes = umsgpack.packb(content)
    return message


def _show(
    path: str, geometry: Content, material: Content, textures: tuple[Content, ...] = (), order: int = 0
) -> Content:
    """Return the command that puts a mesh at a path; meshes with a higher `order` are drawn later."""
    ids = {part: f"{path}:{part}" for part in ("geometry", "material")}
    scene = _object(path, type="Mesh", **ids, matrix=_STANDING, renderOrder=order)
    scene["geometries"] = [{"uuid": ids["geometry"], **geometry}]
    scene["materials"] = [{"uuid": ids["material"], **material}]
    scene["textures"] = list(textures)
    return {"type": "set_object", "object": scene, "path": path}


def _object(path: str, **properties: Any) -> Content:
    """Return a scene of three.js with one object and nothing else."""
    about = {"version": 4.5, "type": "Object"}
    return {"metadata": about, "geometries": [], "materials": [], "object": {"uuid": path, **properties}}


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


def _track(name: str, form: str, time: FloatArray, values: FloatArray, stepped: bool = False) -> Content:
    """Return a track; a track with constant values keeps the first key only."""
    if (values == values[0]).all():
        time, values = time[:1], values[:1]
    track = {"name": name, "type": form, "times": _binary(time), "values": _binary(values)}
    return {**track, "interpolation": _DISCRETE} if stepped else track


def stage(window: Window) -> None:
    """Set light and background, and remove meshcat's grid, axes and near lights."""
    for name in ("Grid", "Axes", "Lights/PointLightNegativeX", "Lights/PointLightPositiveX", "Lights/FillLight"):
        window.send(_property(f"/{name}", "visible", False))
    window.send(_property("/Background", "top_color", _TOP))
    window.send(_property("/Background", "bottom_color", _BOTTOM))
    # These lights reach everywhere; meshcat's lights end ten metres from the origin.
    sky = {"type": "HemisphereLight", "color": 0xFFFFFF, "groundColor": 0x8A7F78, "intensity": 0.2}
    sun = {"type": "DirectionalLight", "color": 0xFFFFFF, "intensity": 0.4, "matrix": [*_STANDING[:12], -2, -3, 4, 1]}
    for name, light in (("Sky", sky), ("Sun", sun)):
        path = f"/Lights/{name}"
        window.send({"type": "set_object", "object": _object(path, **light), "path": path})
        # The viewer makes every object cast shadows, which a sky light cannot do and nobody needs.
        window.send(_property(f"{path}/<object>", "castShadow", False))


def _at(piece: Piece) -> str:
    return f"{_ROOT}/{piece.path}"


def place(window: Window, piece: Piece) -> None:
    """Send the mesh of a piece and the pose of the piece in the first frame."""
    window.send(_show(_at(piece), _geometry(piece), _material(piece), order=int(piece.on_top)))
    if piece.position is not None:
        window.send(_transform(_at(piece), piece.matrix(0)))


def _geometry(piece: Piece) -> Content:
    attributes = {"position": _packed(piece.mesh.vertices)}
    if piece.paint is not None:
        attributes["color"] = _packed(piece.paint)
    return {"type": "BufferGeometry", "data": {"attributes": attributes, "index": _packed(piece.mesh.faces, "<u4")}}


def _material(piece: Piece) -> Content:
    clear = piece.opacity < 1.0
    return {
        "type": "MeshPhongMaterial",
        "color": as_number(piece.colour_at(0)) if piece.paint is None else 0xFFFFFF,
        "vertexColors": 0 if piece.paint is None else _VERTEX_COLOURS,
        "reflectivity": 0.5,
        "side": _DOUBLE_SIDE,
        "opacity": piece.opacity,
        # Pieces on top are drawn last, together with transparent pieces.
        "transparent": clear or piece.on_top,
        "depthTest": not piece.on_top,
        "depthWrite": not clear,
        "specular": 0 if piece.layer == "world" else 0x111111,
    }


def move(window: Window, piece: Piece) -> None:
    """Send the pose and the colour of a piece in the piece's first frame."""
    window.send(_transform(_at(piece), piece.matrix(0)))
    if piece.tint is not None:
        window.send(_property(_at(piece), "color", [*piece.colour_at(0), piece.opacity]))


def remove(window: Window, path: str) -> None:
    """Remove a piece."""
    window.send({"type": "delete", "path": f"{_ROOT}/{path}"})


def caption(window: Window, text: str) -> None:
    """Write a line of text at the top of the picture, instead of the last line."""
    path, picture = f"{_CAMERA}/caption", f"{_CAMERA}/caption:text"
    square = {"type": "PlaneGeometry", "width": CAPTION_SIZE, "height": CAPTION_SIZE}
    material = {
        "type": "MeshBasicMaterial",
        "map": picture,
        "side": _DOUBLE_SIDE,
        "transparent": True,
        "depthTest": False,
    }
    texture = {"uuid": picture, "type": "_text", "text": text, "font_size": FONT, "font_face": "sans-serif"}
    window.send(_show(path, square, material, (texture,)))
    place = np.eye(4)
    place[:3, 3] = CAPTION_AT
    window.send(_transform(path, place))


def look_at(window: Window, place: FloatArray) -> None:
    """Move everything so that a place, shape (3,) [m], becomes the origin, the point that the camera orbits and faces.

    The page's camera always turns about the origin: a camera that moved along with the worm would look back.
    """
    transform = np.eye(4)
    transform[:3, 3] = -place
    window.send(_transform(_ROOT, transform))


def stand(window: Window, axes: FloatArray, body_length: float) -> None:
    """Put the camera behind, to the right and above the point that the camera orbits; `axes` as in `Frames`."""
    x, y, z = (body_length * np.array([-0.45, -0.8, 0.5]) @ axes).tolist()
    window.send(_property(_CAMERA, "position", [x, z, -y]))


def animate(window: Window, pieces: list[Piece], time: FloatArray) -> None:
    """Send the motion of all pieces, at times (T,) from 0 [s]; the pieces have to be placed before."""
    tracks = {_at(piece): _moves(piece, time) for piece in pieces}
    tracks |= {f"{_at(piece)}/<object>": _looks(piece, time) for piece in pieces}
    # One key per second, so that times are in seconds.
    clips = [{"path": path, "clip": {"fps": 1, "name": "default", "tracks": of}} for path, of in tracks.items() if of]
    window.send(
        {"type": "set_animation", "animations": clips, "options": {"play": False, "repetitions": 1}, "path": ""}
    )


def _moves(piece: Piece, time: FloatArray) -> list[Content]:
    tracks = []
    if piece.position is not None:
        tracks.append(_track(".position", "vector3", time, piece.position))
    if piece.quaternion is not None:
        tracks.append(_track(".quaternion", "quaternion", time, piece.quaternion))
    if piece.scale is not None:
        tracks.append(_track(".scale", "vector3", time, piece.scale, piece.stepped))
    return tracks


def _looks(piece: Piece, time: FloatArray) -> list[Content]:
    return [] if piece.tint is None else [_track(".material.color", "color", time, piece.tint)]


def script() -> str:
    """Return meshcat's viewer, three.js included, from meshcat's wheel."""
    spec = find_spec("meshcat")
    assert spec is not None  # a requirement of worm3d
    assert spec.origin is not None
    return (Path(spec.origin).parent / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")
