"""The only place that knows meshcat's Python side: pieces become its commands; a recorder stands in for its window.

meshcat 0.3.2 makes random identities and repeats the key times of an animation in lists of objects. Here identities
are numbered in the order they are sent, so that the same frames give the same bytes, and tracks go as packed arrays,
which three.js takes as well and which are a tenth of the size.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from worm3d.viewer.arrays import FloatArray
from worm3d.viewer.colours import as_number
from worm3d.viewer.piece import Piece

with warnings.catch_warnings():
    # It imports zmq.eventloop.ioloop, which warns of its age.
    warnings.simplefilter("ignore", DeprecationWarning)
    import meshcat
    import umsgpack
    from meshcat.commands import SetAnimation
    from meshcat.geometry import (
        Geometry,
        Mesh,
        MeshBasicMaterial,
        MeshPhongMaterial,
        Object,
        Texture,
        TriangularMeshGeometry,
    )

_DISCRETE = 2300
"""three.js: InterpolateDiscrete."""
_TOP, _BOTTOM = [0.93, 0.95, 0.97], [0.72, 0.76, 0.80]


FONT = 22
"""Of a caption, in pixels of a picture 256 wide; longer ones get a smaller one."""

CAPTION_SIZE, CAPTION_AT = 0.6, (0.0, 0.68, -1.0)
"""Side of the square in whose middle a caption stands; its place before the camera, which sees from -0.77 to 0.77."""


class Window(Protocol):
    """What a `meshcat.Visualizer` sends its commands to."""

    def send(self, command: Any) -> None:
        """Take one command."""


class Recorder:
    """A window without server: keeps the packed commands, in order."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []
        self._identities: dict[str, str] = {}

    def send(self, command: Any) -> None:
        """Take one command of meshcat."""
        self.messages.append(packed(_numbered(command.lower(), self._identities)))


def packed(content: Any) -> bytes:
    """Return the content of a command as it travels."""
    message: bytes = umsgpack.packb(content)
    return message


def _numbered(value: Any, known: dict[str, str]) -> Any:
    """Replace every random identity, wherever it stands, by the number of its first appearance."""
    for identity in _identities(value):
        known.setdefault(identity, f"{len(known):08d}")
    return _replaced(value, known)


def _identities(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        if "uuid" in value:
            yield value["uuid"]
        for part in value.values():
            yield from _identities(part)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for part in value:
            yield from _identities(part)


def _replaced(value: Any, known: dict[str, str]) -> Any:
    if isinstance(value, dict):
        return {key: _replaced(part, known) for key, part in value.items()}
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [_replaced(part, known) for part in value]
    return known.get(value, value) if isinstance(value, str) else value


class _Mesh(Mesh):  # type: ignore[misc]  # meshcat has no types
    """A mesh that may be drawn after all others."""

    def __init__(self, piece: Piece) -> None:
        super().__init__(_geometry(piece), _material(piece))
        self.on_top = piece.on_top

    def lower(self) -> dict[str, Any]:
        result: dict[str, Any] = super().lower()
        result["object"]["renderOrder"] = int(self.on_top)
        return result


class _Light(Object):  # type: ignore[misc]  # meshcat has no types
    """A light that reaches everywhere; those of meshcat end ten metres from the origin."""

    def __init__(self, **properties: Any) -> None:
        super().__init__(Geometry(), None)
        self.properties = properties

    def lower(self) -> dict[str, Any]:
        return {
            "metadata": {"version": 4.5, "type": "Object"},
            "geometries": [],
            "materials": [],
            "object": {"uuid": self.uuid, **self.properties},
        }


class _Text(Texture):  # type: ignore[misc]  # meshcat has no types
    """A picture of a line of text, which meshcat's viewer makes and its Python side does not know."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.text = text

    def lower(self, _object_data: dict[str, Any]) -> dict[str, Any]:
        return {"uuid": self.uuid, "type": "_text", "text": self.text, "font_size": FONT, "font_face": "sans-serif"}


class _Square(Geometry):  # type: ignore[misc]  # meshcat has no types
    """A square that looks along z, for a picture; meshcat's viewer knows it and its Python side does not."""

    def __init__(self, side: float) -> None:
        super().__init__()
        self.side = side

    def lower(self, _object_data: dict[str, Any]) -> dict[str, Any]:
        return {"uuid": self.uuid, "type": "PlaneGeometry", "width": self.side, "height": self.side}


class _Property:
    """A property by its exact name; meshcat's own command writes names in small letters, which three.js does not."""

    def __init__(self, path: str, name: str, value: Any) -> None:
        self._content = {"type": "set_property", "path": path, "property": name, "value": value}

    def lower(self) -> dict[str, Any]:
        return self._content


class _Tracks:
    """An animation of packed tracks; stands in for `meshcat.animation.Animation`."""

    def __init__(self) -> None:
        self._clips: list[dict[str, Any]] = []

    def add(self, path: str, tracks: list[dict[str, Any]]) -> None:
        # One key a second, so that times are in seconds.
        self._clips.append({"path": f"/meshcat/{path}", "clip": {"fps": 1, "name": "default", "tracks": tracks}})

    def lower(self) -> list[dict[str, Any]]:
        return self._clips


def _track(name: str, kind: str, time: FloatArray, values: FloatArray, stepped: bool = False) -> dict[str, Any]:
    """Return a track; one whose values never change keeps its first key only."""
    if (values == values[0]).all():
        time, values = time[:1], values[:1]
    track = {"name": name, "type": kind, "times": _floats(time), "values": _floats(values)}
    return {**track, "interpolation": _DISCRETE} if stepped else track


def _floats(values: FloatArray) -> Any:
    return umsgpack.Ext(0x17, np.ascontiguousarray(values, dtype=np.float32).tobytes())


def stage(window: Window) -> None:
    """Set light and background, and take away meshcat's grid, axes and near lights."""
    top = meshcat.Visualizer(window=window)
    for name in ("Grid", "Axes", "Lights/PointLightNegativeX", "Lights/PointLightPositiveX", "Lights/FillLight"):
        top[f"/{name}"].set_property("visible", False)
    top["/Background"].set_property("top_color", _TOP)
    top["/Background"].set_property("bottom_color", _BOTTOM)
    sky = {"type": "HemisphereLight", "color": 0xFFFFFF, "groundColor": 0x8A7F78, "intensity": 0.2}
    sun = {
        "type": "DirectionalLight",
        "color": 0xFFFFFF,
        "intensity": 0.4,
        "matrix": [*np.eye(4).ravel()[:12], -2, -3, 4, 1],
    }
    for name, light in (("Sky", sky), ("Sun", sun)):
        top[f"/Lights/{name}"].set_object(_Light(**light))
        # The viewer makes every object cast shadows, which a sky cannot and nobody needs.
        window.send(_Property(f"/Lights/{name}/<object>", "castShadow", False))


def place(window: Window, piece: Piece) -> None:
    """Send the mesh of a piece and where it is in the first frame."""
    node = meshcat.Visualizer(window=window)[piece.path]
    node.set_object(_Mesh(piece))
    if piece.position is not None:
        node.set_transform(piece.matrix(0))


def _geometry(piece: Piece) -> Any:
    return TriangularMeshGeometry(piece.mesh.vertices, piece.mesh.faces, piece.paint)


def _material(piece: Piece) -> Any:
    clear = piece.opacity < 1.0
    return MeshPhongMaterial(
        color=as_number(piece.colour_at(0)) if piece.paint is None else 0xFFFFFF,
        vertexColors=piece.paint is not None,
        opacity=piece.opacity,
        # What is seen through everything comes last, with what is clear.
        transparent=clear or piece.on_top,
        depthTest=not piece.on_top,
        depthWrite=not clear,
        specular=0 if piece.layer == "world" else 0x111111,
    )


def move(window: Window, piece: Piece) -> None:
    """Send where a piece is, and its colour, in the first frame of it."""
    node = meshcat.Visualizer(window=window)[piece.path]
    node.set_transform(piece.matrix(0))
    if piece.tint is not None:
        node.set_property("color", [*piece.colour_at(0), piece.opacity])


def remove(window: Window, path: str) -> None:
    """Take a piece away."""
    meshcat.Visualizer(window=window)[path].delete()


def caption(window: Window, text: str) -> None:
    """Write a line of text at the top of the picture, in the place of the last one."""
    picture = MeshBasicMaterial(map=_Text(text), transparent=True, depthTest=False)
    node = meshcat.Visualizer(window=window)["/Cameras/default/rotated/<object>/caption"]
    node.set_object(Mesh(_Square(CAPTION_SIZE), picture))
    place = np.eye(4)
    place[:3, 3] = CAPTION_AT
    node.set_transform(place)


def look_at(window: Window, place: FloatArray) -> None:
    """Move everything so that a place, shape (3,) [m], is where the camera looks and what it turns about, the origin.

    The page's camera turns about the origin wherever it is: one that moved along would look back.
    """
    transform = np.eye(4)
    transform[:3, 3] = -place
    meshcat.Visualizer(window=window).set_transform(transform)


def stand(window: Window, axes: FloatArray, body_length: float) -> None:
    """Put the camera behind, to the right and above of what it turns about; `axes` as in `Frames`."""
    x, y, z = body_length * np.array([-0.45, -0.8, 0.5]) @ axes
    camera = meshcat.Visualizer(window=window)["/Cameras/default/rotated/<object>"]
    camera.set_property("position", [x, z, -y])


def animate(window: Window, pieces: list[Piece], time: FloatArray, play: bool) -> None:
    """Send how all pieces move; they have to be placed before, or three.js does not find their shapes.

    Parameters
    ----------
    time : ndarray, shape (T,)
        Of the frames, from 0 [s].
    """
    tracks = _Tracks()
    for piece in pieces:
        moves = _moves(piece, time)
        if moves:
            tracks.add(piece.path, moves)
        looks = _looks(piece, time)
        if looks:
            tracks.add(f"{piece.path}/<object>", looks)
    window.send(SetAnimation(tracks, play=play))


def _moves(piece: Piece, time: FloatArray) -> list[dict[str, Any]]:
    tracks = []
    if piece.position is not None:
        tracks.append(_track(".position", "vector3", time, piece.position))
    if piece.quaternion is not None:
        tracks.append(_track(".quaternion", "quaternion", time, piece.quaternion))
    if piece.scale is not None:
        tracks.append(_track(".scale", "vector3", time, piece.scale, piece.stepped))
    return tracks


def _looks(piece: Piece, time: FloatArray) -> list[dict[str, Any]]:
    return [] if piece.tint is None else [_track(".material.color", "color", time, piece.tint)]


def script() -> str:
    """Return meshcat's viewer, three.js included, as it comes in its wheel."""
    return (Path(meshcat.viewer_assets_path()) / "dist" / "main.min.js").read_text(encoding="utf-8")
