"""`worm3d view`, `animate` and `export --glb`: results, and runs while they go on, as they are seen."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import time
from pathlib import Path

import pytest
import trimesh
from PIL import Image

from scenes.models.loading import load_scene
from scenes.records.record import Record
from scenes.records.store import save
from scenes.running.runner import simulate

SHORT = ("-o", "run.duration_s=0.2", "-o", "gait.period_s=0.2")


@pytest.fixture(scope="module")
def crawled() -> Record:
    return simulate(load_scene("flat", ["run.duration_s=0.5", "gait.period_s=0.5", "title='Look & see'"]))


@pytest.fixture
def result(crawled: Record, tmp_path: Path) -> Path:
    (tmp_path / "x").mkdir()
    save(crawled, tmp_path / "x" / "result.nc")
    return tmp_path / "x"


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Addresses that were opened in a browser; there is a screen."""
    addresses: list[str] = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.open", lambda address, new: addresses.append(address) or True)
    return addresses


def test_the_page_of_a_result_is_opened(worm3d, result: Path, opened: list[str]) -> None:
    ended = worm3d("view", "x")
    assert (ended.code, ended.out) == (0, "x/viewer.html\n")
    assert opened == [(result / "viewer.html").as_uri()]
    page = (result / "viewer.html").read_text()
    assert "<title>Look &amp; see</title>" in page
    assert '"name":"skin"' in page
    assert worm3d("view", "x/result.nc", "--no-skin", "--no-open").out == "x/viewer.html\n"
    assert len(opened) == 1
    assert '"name":"skin"' not in (result / "viewer.html").read_text()


def test_the_page_of_a_case_does_not_replace_that_of_another(worm3d, result: Path) -> None:
    result.rename(result.with_name("cases"))
    result.with_name("cases").joinpath("result.nc").rename("cases/abc.nc")
    assert worm3d("view", "cases/abc.nc", "--no-open").out == "cases/abc/viewer.html\n"
    assert Path("cases/abc/viewer.html").is_file()


def test_without_a_screen_the_page_is_only_named(
    worm3d, result: Path, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert worm3d("view", "x").out == "x/viewer.html\n"
    assert opened == []


def test_what_has_no_page_is_told(worm3d, result: Path, record: Record, tmp_path: Path) -> None:
    (tmp_path / "y").mkdir()
    save(record, tmp_path / "y" / "result.nc")
    sentence = "planar_published: the model 'planar_published' has no page; 'worm3d export' makes a film"
    assert worm3d("view", "y").complaints == [sentence]
    assert worm3d("view", "y").code == 2
    assert worm3d("view", "nowhere").code == 2
    ended = worm3d("view", "x", "-o", "gait.period_s=3")
    assert (ended.code, len(ended.complaints)) == (2, 1)
    assert "use -o only with --live" in ended.complaints[0]
    assert worm3d("view", "planar_published", "--live").complaints == [
        "planar_published: the model 'planar_published' cannot be watched; 'worm3d run' animates it"
    ]


def test_a_run_is_seen_while_it_goes_on_and_nothing_is_kept(worm3d, tmp_path: Path, opened: list[str]) -> None:
    ended = worm3d("view", "--live", "flat", *SHORT)
    assert ended.code == 0
    begun, over = ended.out.splitlines()
    assert re.fullmatch(r"flat: seen at http://127\.0\.0\.1:\d+/[\w-]{32}/ until the run ends; Ctrl-C stops it", begun)
    assert over == "flat: the run reached its end; nothing was kept, 'worm3d run' keeps it"
    assert len(opened) == 1
    assert not listens(opened[0])
    assert not list(tmp_path.iterdir())
    assert "to be seen at" in worm3d("view", "--live", "flat", *SHORT, "--no-open").out


def test_ctrl_c_ends_a_run_that_is_watched_and_leaves_nothing_behind(script: str, tmp_path: Path) -> None:
    command = [script, "view", "--live", "flat", "-o", "run.duration_s=60", "--no-open"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address is not None
        assert listens(address[0])
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert (process.returncode, err) == (130, "")
    assert out == "flat: stopped by Ctrl-C; nothing was kept, 'worm3d run' keeps it\n"
    assert not listens(address[0])


def test_a_run_that_fails_while_it_is_watched(worm3d) -> None:
    ended = worm3d("view", "--live", "flat", "-o", "run.duration_s=1", "-o", "gait.hinge_deg=170", "--no-open")
    assert (ended.code, len(ended.complaints)) == (3, 1)
    assert ended.complaints[0].startswith("diverged: ")


def listens(url: str) -> bool:
    host, port = url.split("/")[2].split(":")
    with socket.socket() as probe:
        return probe.connect_ex((host, int(port))) == 0


def test_an_animation_of_a_3d_worm(worm3d, result: Path) -> None:
    assert worm3d("animate", "x", "--fps", "10").out == "x/animation.gif\n"
    with Image.open(result / "animation.gif") as picture:
        assert picture.n_frames == 6


def test_a_mesh_at_any_instant(worm3d, result: Path, crawled: Record) -> None:
    assert worm3d("export", "x", "--glb", "a.glb", "--at", "0.123").out == "a.glb\n"
    scene = trimesh.load_scene("a.glb")
    x, y, z = crawled["points"][12, 2, :2].mean(axis=0)
    assert scene.graph["chambers/02-L"][0][:3, 3] == pytest.approx([x, z, -y], abs=1e-6)
    assert worm3d("export", "x", "--glb", "a.glb").complaints == [
        "a.glb exists: choose another name, or replace it with --force"
    ]
    for arguments, sentence in (
        (("--glb", "a.obj"), "a.obj: the name of a mesh must end in .glb"),
        (("--glb", "b.glb", "--at", "7"), "--at: got 7 s, must be between 0 and 0.5 s, where the run is known"),
        (("--csv", "b.csv", "--at", "7"), "export: --at is the instant of a mesh; give --glb FILE too"),
    ):
        ended = worm3d("export", "x", *arguments)
        assert (ended.code, ended.complaints) == (2, [sentence])
    assert not Path("b.glb").exists()
    assert worm3d("export", "x", "--glb", "nowhere/a.glb").code == 1
