"""Mesh and picture files damaged at random: each is refused with one sentence, or is a closed surface."""

import struct
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from fuzzing import examples, no_hang
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from worm3d import Heightfield, MeshError
from worm3d.worlds import mesh_file

KINDS = ("stl", "obj", "ply", "glb")
NUMBERS = (0, 1, 255, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1)


@cache
def whole(kind: str, form: str) -> bytes:
    """Return a right file: a box, or a ball of 320 triangles, or for some kinds its text form."""
    body = trimesh.creation.box((1.0, 0.7, 0.5)) if form != "ball" else trimesh.creation.icosphere(2, 0.5)
    options = {("stl", "text"): {"file_type": "stl_ascii"}, ("ply", "text"): {"file_type": "ply", "encoding": "ascii"}}
    data = body.export(**options.get((kind, form), {"file_type": kind}))
    return data.encode() if isinstance(data, str) else bytes(data)


@cache
def picture(form: str) -> bytes:
    heights = np.random.default_rng(0).integers(0, 255, (9, 7), dtype=np.uint8)
    file = BytesIO()
    Image.fromarray(heights).save(file, form)
    return file.getvalue()


def damaged(data: bytes, draw: st.DrawFn) -> bytes:
    """Return bytes with a few changes: single ones, a number, a word of the text, a piece lost, doubled or cut off."""
    content = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(len(content) - 1, 0)))
        match draw(st.sampled_from(("byte", "number", "count", "count", "float", "digit", "lose", "double", "cut"))):
            case "byte":
                content[at : at + 1] = bytes([draw(st.integers(0, 255))])
            case "number":
                content[at : at + 4] = struct.pack("<Q", draw(st.sampled_from(NUMBERS)))[:4]
            case "count":  # or an index: what looks like a small number becomes another one
                small = [k for k in range(len(content) - 3) if 0 < int.from_bytes(content[k : k + 4], "little") < 400]
                at = draw(st.sampled_from(small or [0]))
                content[at : at + 4] = struct.pack("<Q", draw(st.sampled_from(NUMBERS)))[:4]
            case "float":
                content[at : at + 4] = struct.pack("<f", draw(st.sampled_from((np.nan, np.inf, 3e38, 1e-38, -1.0))))
            case "digit":
                digits = [k for k, byte in enumerate(content[:4000]) if 48 <= byte <= 57] or [0]
                content[(k := draw(st.sampled_from(digits))) : k + 1] = draw(st.sampled_from((b"9" * 9, b"-1", b"x")))
            case "lose":
                del content[at : at + draw(st.integers(1, 60))]
            case "double":
                content[at:at] = content[at : at + draw(st.integers(1, 60))]
            case "cut":
                del content[at:]
    return bytes(content)


@st.composite
def mesh_bytes(draw: st.DrawFn) -> tuple[str, bytes]:
    kind = draw(st.sampled_from(KINDS))
    return kind, damaged(whole(kind, draw(st.sampled_from(("box", "ball", "text")))), draw)


@examples(80)
@given(mesh_bytes())
def test_damaged_meshes_are_refused_or_closed_surfaces(given: tuple[str, bytes]) -> None:
    kind, data = given
    path = Path(f"fuzzed.{kind}")
    try:
        with no_hang():
            vertices, faces = mesh_file.triangles(path, data, 1.0)
    except MeshError as refused:
        _require_sentence(str(refused), "mesh 'fuzzed.")
        return
    corners = vertices[faces]
    assert np.isfinite(corners).all()
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert 0.0 < volume < 1e9


@st.composite
def picture_bytes(draw: st.DrawFn) -> bytes:
    return damaged(picture(draw(st.sampled_from(("PNG", "TIFF", "JPEG", "BMP", "PPM", "GIF")))), draw)


@examples(60)
@given(data=picture_bytes())
def test_damaged_pictures_are_refused_or_heights_within_the_range(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "fuzzed.png"
    path.write_bytes(data)
    try:
        with no_hang():
            field = Heightfield.from_image(path, 0.1, 0.0, 0.5)
    except ValueError as refused:
        _require_sentence(str(refused))
        return
    assert field.heights.min() >= 0.0
    assert field.heights.max() <= 0.5


def _require_sentence(text: str, begin: str = "") -> None:
    assert text.startswith(begin)
    assert ": " in text
    assert "\n" not in text
    assert len(text) < 400
