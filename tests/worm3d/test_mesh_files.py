"""Mesh files that cannot be a world: one sentence each that says what is wrong and what to do."""

import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from worm3d import Mesh, MeshError
from worm3d.worlds import mesh as module
from worm3d.worlds import mesh_file

BOX = trimesh.creation.box((1.0, 0.7, 0.5))
KINDS = ("stl", "obj", "ply", "glb")


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_folder", lambda: tmp_path / "grids")


def box(kind: str) -> bytes:
    data = BOX.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


def refused(path: Path, sentence: str, units: str | None = "m", **more: object) -> None:
    with pytest.raises(MeshError, match=sentence) as caught:
        Mesh(path, units, **more)  # type: ignore[arg-type]
    text = str(caught.value)
    assert text.startswith(f"mesh {path.name!r}: ")
    assert "\n" not in text
    assert len(text) < 300


@pytest.mark.parametrize("kind", KINDS)
def test_empty_truncated_and_garbage(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"mesh.{kind}"
    path.write_bytes(b"")
    refused(path, "the file is empty; export it again")
    path.write_bytes(np.random.default_rng(0).bytes(999))
    refused(
        path,
        r"(truncated or no STL|truncated, or no \w+ file at all|no triangles|binary, must|no GLB).*export it",
    )
    path.write_bytes(box(kind)[: len(box(kind)) * 2 // 3])
    refused(path, r"truncated|no triangles in it|not closed")
    path.write_text("this is a text\n" * 20)
    refused(path, r"(truncated|no triangles in it|no GLB file).*export it")


def test_a_cut_text_stl(tmp_path: Path) -> None:
    path = tmp_path / "box.stl"
    text = BOX.export(file_type="stl_ascii")
    path.write_text(text)
    assert Mesh(path, "m", cell=0.1).distance(np.zeros(3)) < 0.0
    path.write_text(text[: len(text) // 2])
    refused(path, "truncated: its text has no 'endsolid'; export it again")


def test_missing_files_and_unknown_kinds(tmp_path: Path) -> None:
    refused(tmp_path / "gone.stl", r"there is no such file in '.*'; check the path")
    refused(tmp_path / "part.step", r"unknown extension '.step', must be one of .stl, .obj, .ply, .glb; export it")
    refused(tmp_path / "noext", r"unknown extension ''")
    (tmp_path / "folder.stl").mkdir()
    refused(tmp_path / "folder.stl", r"cannot be read \(.*\); check the path")


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_vertices_that_are_not_finite(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"nan.{kind}"
    if kind == "obj":
        path.write_text(box("obj").decode().replace("v ", "v nan ", 1))
    else:
        broken = trimesh.Trimesh(np.where(np.arange(8)[:, None] == 3, np.nan, BOX.vertices), BOX.faces, process=False)
        path.write_bytes(broken.export(file_type="ply"))
    refused(path, r"got 1 vertices that are not finite \(NaN\); repair it")


def test_inside_out_open_and_mixed(tmp_path: Path) -> None:
    for name, faces, sentence in (
        ("inverted", BOX.faces[:, ::-1], r"inside-out: its faces look inwards \(volume -0.35\); flip them"),
        ("open", BOX.faces[1:], r"not closed: 3 of its 18 edges do not join two faces, so it has no inside; close it"),
        ("mixed", np.vstack([BOX.faces[:1, ::-1], BOX.faces[1:]]), r"some faces look in, some out; recalculate"),
    ):
        path = tmp_path / f"{name}.stl"
        path.write_bytes(trimesh.Trimesh(BOX.vertices, faces, process=False).export(file_type="stl"))
        refused(path, sentence)
    flat = trimesh.Trimesh(BOX.vertices * [1.0, 1.0, 0.0], BOX.faces, process=False)
    (tmp_path / "flat.ply").write_bytes(flat.export(file_type="ply"))
    refused(tmp_path / "flat.ply", r"encloses no volume|not closed")


def test_units_and_sizes(tmp_path: Path) -> None:
    path = tmp_path / "box.stl"
    path.write_bytes(box("stl"))
    refused(path, r"units: got none, must be one of 'm', 'cm', 'mm', 'in', 'ft': STL files do not say theirs", None)
    refused(path, r"units: got 'furlong', must be one of 'm'", "furlong")
    refused(path, r"got 0.001 m across, must be 0.01 to 1000 m; check `units`", "mm")
    kilometres = BOX.copy()
    kilometres.apply_scale(2500.0)
    path.write_bytes(kilometres.export(file_type="stl"))
    refused(
        path, r"got 2500 m across, must be 0.01 to 1000 m; check `units` \(a file in millimetres needs units='mm'\)"
    )
    assert Mesh(path, "mm").distance(np.array([0.0, 0.0, 0.725])) == pytest.approx(0.1, abs=1e-3)


def test_a_grid_too_large_for_memory(tmp_path: Path) -> None:
    path = tmp_path / "box.stl"
    path.write_bytes(box("stl"))
    refused(path, r"cells of 0.0001 m make 3.5\de\+11 nodes \(1.\d*e\+06 MB\), at most 8e\+06 are", cell=1e-4)
    with pytest.raises(MeshError) as caught:
        Mesh(path, "m", cell=1e-4)
    advised = float(str(caught.value).split("cell=")[1].split(" ")[0])
    assert 0.003 < advised < 0.005


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"solid": "wall"}, r"solid: got 'wall', must be 'inside' or 'outside'"),
        ({"up": "x"}, r"up: got 'x', must be 'z' or 'y'"),
        ({"cell": 0.0}, r"cell: got 0.0 m, must be finite and above 0"),
        ({"position": (0.0, np.nan, 0.0)}, r"position: got nan, every value must be finite"),
        ({"grip": -1.0}, r"grip: got -1.0, must be finite and at least 0"),
    ],
)
def test_settings_out_of_range(settings: dict[str, object], sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "box.stl"
    path.write_bytes(box("stl"))
    with pytest.raises(ValueError, match=sentence):
        Mesh(path, "m", **settings)  # type: ignore[arg-type]


def test_trimesh_is_not_imported_before_a_file_is_read() -> None:
    program = "import sys, worm3d; worm3d.Mesh, worm3d.Heightfield; assert 'trimesh' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True)


GLB = BOX.export(file_type="glb")
SIZE = int.from_bytes(GLB[12:16], "little")


def glb(content: Any = None, version: int = 2, **changes: Any) -> bytes:
    """Return a GLB file with other JSON, or the box's JSON with some entries changed (None: left out)."""
    if content is None:
        content = json.loads(GLB[20 : 20 + SIZE]) | changes
        content = {name: value for name, value in content.items() if value is not None}
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + GLB[20 + SIZE :]
    return b"glTF" + struct.pack("<II", version, 12 + len(body)) + body


def primitive(**changes: Any) -> list[Any]:
    (mesh,) = json.loads(GLB[20 : 20 + SIZE])["meshes"]
    return [{"primitives": [mesh["primitives"][0] | changes]}]


@pytest.mark.parametrize(
    ("name", "data", "sentence"),
    [
        ("a.obj", BOX.export(file_type="stl"), "binary, must be the text of an OBJ file"),
        ("a.obj", GLB, "a GLB file, must be the text of an OBJ file"),
        ("a.obj", BOX.export(file_type="ply"), "a PLY file, must be the text of an OBJ file"),
        ("a.obj", bytes(500), "binary, must be the text of an OBJ file"),
        ("a.obj", BOX.export(file_type="obj").encode("utf-16"), "a text in UTF-16, must be one in UTF-8"),
        ("a.glb", GLB[:400], "truncated: got 400 bytes where its header tells of 960"),
        ("a.glb", b"{}", "glTF as text, must be a binary GLB file"),
        ("a.glb", BOX.export(file_type="stl"), "no GLB file: it does not begin with 'glTF'"),
        ("a.glb", glb(version=1), "got version 1 of glTF, must be 2"),
        ("a.glb", glb([]), "damaged: its JSON is no object"),
        ("a.glb", glb({}), "no mesh in it, only a scene without shapes"),
        ("a.glb", glb(meshes=None), "no mesh in it, only a scene without shapes"),
        ("a.glb", glb(meshes=primitive(mode=1)), "no triangles in it, only points or lines"),
        ("a.glb", glb(meshes=primitive(attributes={})), r"a mesh in it has no positions \(POSITION\)"),
        ("a.glb", glb(buffers=[{"byteLength": 9, "uri": "b.bin"}]), "has its data in another file"),
        ("a.glb", glb(accessors=[]), "it refers to what it does not have"),
        (
            "a.glb",
            glb(extensionsRequired=["KHR_draco_mesh_compression"]),
            "needs the glTF extension KHR_draco_mesh_compression, which is not read; export it without compression",
        ),
    ],
)
def test_the_cause_is_told_of_files_of_another_kind(name: str, data: bytes, sentence: str) -> None:
    with pytest.raises(MeshError, match=f"^mesh '{name}': .*{sentence}") as refused:
        mesh_file.triangles(Path(name), data, 1.0)
    assert "\n" not in str(refused.value)


def test_what_changes_no_shape_is_read() -> None:
    """Names in Latin-1, as some programs write them, and materials that a GLB file asks for."""
    latin = b"# ma\xeftre\n" + BOX.export(file_type="obj").encode()
    for name, data in (("a.obj", latin), ("a.glb", glb(extensionsRequired=["KHR_materials_unlit"]))):
        vertices, faces = mesh_file.triangles(Path(name), data, 1.0)
        assert (len(vertices), len(faces)) == (8, 12)
