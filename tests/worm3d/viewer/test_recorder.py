"""meshcat's commands without its server: the same bytes every time, in the right order, small and quick."""

import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import umsgpack
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from worm3d.viewer import Frames, WorldMesh, write_html
from worm3d.viewer import html as page
from worm3d.viewer.frames import instants
from worm3d.viewer.pieces import LAYERS, Scales, contact, way, world, worm
from worm3d.viewer.skin import Skin

HERE = Path(__file__).parent


def commands(frames: Frames, *more: Any) -> list[dict[str, Any]]:
    scales = Scales.of(frames)
    parts = [*worm(frames, scales), *contact(frames, scales), *way(frames), *world(frames.world), *more]
    return [umsgpack.unpackb(message) for message in page.commands(frames, parts)]


def at_rate(frames: Frames, fps: float) -> Frames:
    return frames.take(instants(frames.time, fps))


def floats(packed: Any, width: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    return np.frombuffer(packed.data, dtype="<f4").reshape(-1, width)


def test_objects_come_first_then_poses_and_the_animation_at_the_end(short: Frames) -> None:
    everything = replace(short, face_radius=[0.05, 0.05])
    sent = commands(everything, Skin.of(everything, 0.3).piece())
    assert [command["type"] for command in sent].count("set_animation") == 1
    assert sent[-1]["type"] == "set_animation"
    assert sent[-1]["options"]["play"] is False
    objects = {command["path"] for command in sent if command["type"] == "set_object"}
    moved = {clip["path"].removesuffix("/<object>") for clip in sent[-1]["animations"]}
    assert moved <= objects
    assert {path.split("/")[2] for path in objects if path.startswith("/meshcat/")} == set(LAYERS)


def test_the_pose_of_the_first_frame_is_set_or_the_file_opens_on_giants(short: Frames) -> None:
    sent = commands(short)
    poses = {command["path"]: command["matrix"] for command in sent if command["type"] == "set_transform"}
    scaled = [
        clip for clip in sent[-1]["animations"] if any(track["name"] == ".scale" for track in clip["clip"]["tracks"])
    ]
    assert len(scaled) > 12
    for clip in scaled:
        matrix = np.reshape(poses[clip["path"]], (4, 4)).T
        assert np.linalg.norm(matrix[:3, :3], axis=0).max() < 0.5
        position = next(track for track in clip["clip"]["tracks"] if track["name"] == ".position")
        assert_allclose(floats(position["values"], 3)[0], matrix[:3, 3], atol=1e-6)


def test_tracks_say_what_the_frames_say(short: Frames) -> None:
    clips = {clip["path"]: clip["clip"] for clip in commands(short)[-1]["animations"]}
    ball = {track["name"]: track for track in clips["/meshcat/chambers/04-L"]["tracks"]}
    assert_allclose(floats(ball[".position"]["times"], 1)[:, 0], short.time, atol=1e-6)
    assert_allclose(floats(ball[".position"]["values"], 3), short.apexes[:, 4, :2].mean(axis=1), atol=1e-6)
    turned = Rotation.from_quat(floats(ball[".quaternion"]["values"], 4)).as_matrix()
    tangent = np.diff(short.joints[:, 4:6], axis=1)[:, 0]
    assert_allclose(turned[..., 1], tangent / np.linalg.norm(tangent, axis=1, keepdims=True), atol=1e-6)
    (tint,) = clips["/meshcat/chambers/04-L/<object>"]["tracks"]
    assert (tint["name"], tint["type"]) == (".material.color", "color")
    assert len(floats(tint["values"], 3)) == len(short)
    dot = {track["name"]: track for track in clips["/meshcat/anchors/000"]["tracks"]}
    assert dot[".scale"]["interpolation"] == 2300, "an apex sticks or it does not"


def test_the_skin_is_painted_and_other_pieces_have_their_own_colour(short: Frames) -> None:
    cover = Skin.of(short, 0.3).piece()
    sent = commands(short, cover)
    (mesh,) = (command["object"] for command in sent if command["path"] == "/meshcat/skin/skin" and "object" in command)
    (geometry,), (material,) = mesh["geometries"], mesh["materials"]
    assert cover.paint is not None
    assert_allclose(floats(geometry["data"]["attributes"]["color"]["array"], 3), cover.paint, atol=1e-6)
    assert (material["vertexColors"], material["color"]) == (2, 0xFFFFFF)
    others = [command["object"] for command in sent if "object" in command and "skin" not in command["path"]]
    assert not any("color" in g["data"]["attributes"] for o in others for g in o["geometries"] if "data" in g)


def test_the_same_frames_give_the_same_bytes(short: Frames, tmp_path: Path) -> None:
    write_html(short, tmp_path / "a.html")
    write_html(short, tmp_path / "b.html")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


@pytest.mark.parametrize("seed", ["1", "2"])
def test_another_process_gives_the_same_bytes(make_crawl: Callable[..., Frames], tmp_path: Path, seed: str) -> None:
    script = f"""
import importlib.util
spec = importlib.util.spec_from_file_location("synthetic", {str(HERE / "conftest.py")!r})
synthetic = importlib.util.module_from_spec(spec)
spec.loader.exec_module(synthetic)
from worm3d.viewer import write_html
write_html(synthetic.crawl(duration=1.0), {str(tmp_path / "there.html")!r})
"""
    subprocess.run([sys.executable, "-c", script], check=True, env={"PYTHONHASHSEED": seed})
    write_html(make_crawl(duration=1.0), tmp_path / "here.html")
    assert (tmp_path / "there.html").read_bytes() == (tmp_path / "here.html").read_bytes()


def test_no_port_and_no_process(short: Frames, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a picture needs no server")

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(subprocess, "Popen", refuse)
    write_html(short, tmp_path / "viewer.html")


def test_ten_seconds_are_small_and_take_no_more_commands_than_one(
    make_crawl: Callable[..., Frames], tmp_path: Path
) -> None:
    frames = make_crawl(duration=10.0, fps=100.0)
    assert len(commands(frames)) == len(commands(at_rate(frames, 10.0)))
    write_html(at_rate(frames, 25.0), tmp_path / "viewer.html")
    assert (tmp_path / "viewer.html").stat().st_size < 5e6
    write_html(at_rate(frames, 25.0), tmp_path / "without.html", skin=False)
    assert (tmp_path / "without.html").stat().st_size < 4e6


def test_names_and_titles_cannot_break_the_page(make_crawl: Callable[..., Frames]) -> None:
    wall = WorldMesh("</script>/a{{script}}", np.eye(3), np.array([[0, 1, 2]]))
    text = page.html(make_crawl(duration=1.0, world=(wall,)), title="<b>{{meshcat}}</b>")
    assert text.count("</script>") == 4
    assert "&lt;b&gt;{{meshcat}}&lt;/b&gt;" in text


def test_the_page_loads_nothing(make_crawl: Callable[..., Frames]) -> None:
    text = page.html(make_crawl(duration=1.0))
    own = text.split("<script>")[0] + text.split("</script>")[-1]
    for word in ("http:", "https:", "src=", "@import", "url("):
        assert word not in own
    assert "fetch(" not in text.rsplit("<script>", 1)[1]


def test_a_missing_folder_is_named(make_crawl: Callable[..., Frames], tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere"):
        write_html(make_crawl(duration=1.0), tmp_path / "nowhere" / "viewer.html")
