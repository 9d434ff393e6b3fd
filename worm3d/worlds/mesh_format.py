"""Checks of the bytes of an STL, OBJ or GLB file before the file is read, so that error messages name the cause.

A GLB file has a header (magic, version, length), a chunk of JSON text, and a chunk of binary data (Khronos Group,
glTF 2.0 Specification, section 4).
"""

from __future__ import annotations

import json
from typing import Any

MAGIC = {b"glTF": "a GLB file", b"ply\n": "a PLY file", b"ply\r": "a PLY file", b"PK\x03\x04": "a zip file"}
"""Kinds of files that are recognised by their first four bytes."""

HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_")
"""Prefixes of the names of glTF extensions that do not change the shape of a mesh."""


def wrong(kind: str, data: bytes) -> str:
    """Return a text with the fault in the bytes of a file and the remedy, or an empty text if no fault is found.

    `kind` is the extension of the file without the dot.
    """
    checks = {"stl": _wrong_stl, "obj": _wrong_obj, "glb": _wrong_glb}
    return checks[kind](data) if kind in checks else ""


def as_utf8(data: bytes) -> bytes:
    """Return a text encoded in UTF-8.

    Text that is not valid UTF-8 is decoded as Latin-1, which some programs use for names and comments.
    """
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1").encode()
    return data


def _wrong_stl(data: bytes) -> str:
    expected = 84 + 50 * int.from_bytes(data[80:84], "little")  # a header and the triangles
    if data.lstrip()[:5].lower() == b"solid" and len(data) != expected:
        return "" if b"endsolid" in data.lower() else "truncated: its text has no 'endsolid'; export it again"
    if len(data) != expected:
        return f"truncated or no STL: got {len(data)} bytes where its header tells of {expected}; export it again"
    return ""


def _wrong_obj(data: bytes) -> str:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "a text in UTF-16, must be one in UTF-8 or ASCII; save it so"
    if b"\0" not in data and data.count(b"\x7f") + sum(data.count(bytes([c])) for c in range(1, 9)) == 0:
        return ""
    found = MAGIC.get(data[:4], "binary")
    return f"{found}, must be the text of an OBJ file; give it the extension of its format, or export it as OBJ"


def _wrong_glb(data: bytes) -> str:
    if data.lstrip()[:1] == b"{":
        return "glTF as text, must be a binary GLB file; export it as .glb"
    begin = 20  # after the headers of the file (12 bytes) and of the first chunk (8 bytes)
    if data[:4] != b"glTF" or len(data) < begin:
        return "no GLB file: it does not begin with 'glTF'; give it the extension of its format, or export it as GLB"
    version, length, size = (int.from_bytes(data[k : k + 4], "little") for k in (4, 8, 12))
    if version != 2:
        return f"got version {version} of glTF, must be 2; export it again"
    if length > len(data):
        return f"truncated: got {len(data)} bytes where its header tells of {length}; export it again"
    try:
        said = json.loads(data[begin : begin + size])
    except (ValueError, RecursionError):
        return "damaged: its first part is no JSON; export it again"
    return _wrong_json(said) if isinstance(said, dict) else "damaged: its JSON is no object; export it again"


def _wrong_json(said: dict[str, Any]) -> str:
    needs = [str(name) for name in _listed(said, "extensionsRequired") if not str(name).startswith(HARMLESS)]
    if needs:
        return f"needs the glTF extension {', '.join(needs)[:80]}, which is not read; export it without compression"
    if any(not str(buffer.get("uri", "data:")).startswith("data:") for buffer in _objects(said, "buffers")):
        return "has its data in another file, must have them in itself; export it as one .glb"
    parts = [part for mesh in _objects(said, "meshes") for part in _objects(mesh, "primitives")]
    if not parts:
        return "no mesh in it, only a scene without shapes; export it with its meshes"
    if not any(part.get("mode", 4) in (4, 5, 6) for part in parts):  # triangles, strips and fans of triangles
        return "no triangles in it, only points or lines; export its surface"
    if not all("POSITION" in part["attributes"] for part in parts if isinstance(part.get("attributes"), dict)):
        return "a mesh in it has no positions (POSITION); export it again"
    return ""


def _listed(said: dict[str, Any], name: str) -> list[Any]:
    found = said.get(name)
    return found if isinstance(found, list) else []


def _objects(said: dict[str, Any], name: str) -> list[dict[str, Any]]:
    return [each for each in _listed(said, name) if isinstance(each, dict)]
