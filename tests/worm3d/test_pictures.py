"""Results become pictures: what is shown is what was simulated."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

import worm3d
from control import gaits
from worm3d.results import pictures
from worm3d.viewer import plane


@pytest.fixture(scope="module")
def crawled() -> worm3d.Result:
    return worm3d.simulate(
        worm3d.Worm(), worm3d.Plane(), worm3d.Friction(), gaits.TravellingWave(hinge=0.3), duration=3.0, dt=0.01
    )


def test_frames_show_the_worm_as_it_was(crawled: worm3d.Result) -> None:
    frames = pictures.frames_of(crawled)
    rows = np.arange(0, 301, 4)
    assert_allclose(frames.time, crawled.time[rows])
    assert_array_equal(frames.joints, crawled.joints[rows])
    assert_array_equal(frames.contacts, crawled.points[rows])
    assert_array_equal(frames.contact_force, crawled.contact_force[rows])
    assert_allclose(frames.chamber_strain, crawled.chamber_strain[rows])
    assert frames.period == 2.0
    assert [mesh.name for mesh in frames.world] == ["ground", "tiles"]
    assert frames.path is None
    assert frames.centreline is None


def test_anchors_are_contacts_that_carry_load_and_do_not_slide(crawled: worm3d.Result) -> None:
    frames = pictures.frames_of(crawled, fps=100.0)
    assert frames.anchored is not None
    assert frames.contact_force is not None
    loaded = np.linalg.norm(frames.contact_force, axis=3) > 0.0
    loaded[0] = frames.anchored[0]  # before the first step loads are known, forces are not
    assert not (frames.anchored & ~loaded).any()
    assert 0.1 < frames.anchored[loaded].mean() < 0.9
    moved = np.linalg.norm(np.diff(frames.apexes, axis=0), axis=3)
    stuck = (frames.anchored[1:] & frames.anchored[:-1])[:, :, :6]
    slid = (loaded[1:] & loaded[:-1])[:, :, :6] & ~stuck
    assert stuck.sum() > 100
    assert moved[stuck].max() < 1e-5 < 1e-4 < moved[slid].mean()


def test_faces_that_stick_are_anchors_too() -> None:
    one, none = np.ones((1, 1, 6)), np.zeros((1, 1, 6))
    series = {
        "normal_load": none,
        "slip": none,
        "joint_load": np.array([[1.0, 2.0]]),
        "joint_slip": np.array([[0.0, 0.1]]),
    }
    assert_array_equal(pictures.anchored(series)[0, 0], [*[False] * 6, True, False])
    series |= {"normal_load": one, "joint_slip": np.array([[0.1, 0.0]])}
    assert_array_equal(pictures.anchored(series)[0, 0], [*[True] * 6, False, True])


def test_long_runs_and_long_worms_have_fewer_frames(crawled: worm3d.Result) -> None:
    def frames(worm: worm3d.Worm, duration: float) -> int:
        time = np.arange(0.0, duration + 0.005, 0.01)
        return len(pictures.rows_shown(time, worm.segments, None, None))

    assert frames(worm3d.Worm(), 10.0) == 251
    assert frames(worm3d.Worm(), 1000.0) == 2001
    assert frames(worm3d.Worm(segments=100), 10.0) == 121


def test_every_ending_is_written(crawled: worm3d.Result, tmp_path: Path) -> None:
    worm3d.draw(crawled, tmp_path / "a.html", title="My <worm>")
    assert "<title>My &lt;worm&gt;</title>" in (tmp_path / "a.html").read_text()
    worm3d.draw(crawled, tmp_path / "a.PNG", at=1.0)
    with Image.open(tmp_path / "a.PNG") as picture:
        assert picture.width > 500
    worm3d.draw(crawled, tmp_path / "a.gif", fps=4)
    with Image.open(tmp_path / "a.gif") as picture:
        assert (picture.n_frames, picture.info["duration"]) == (13, 250)
    worm3d.draw(crawled, tmp_path / "a.glb", at=1.23)
    scene = trimesh.load_scene(tmp_path / "a.glb")
    chamber = trimesh.transform_points(np.zeros((1, 3)), scene.graph["chambers/02-L"][0])[0]
    x, y, z = crawled.points[123, 2, :2].mean(axis=0)
    assert_allclose(chamber, [x, z, -y], atol=1e-6)


def test_what_cannot_be_drawn_is_named(crawled: worm3d.Result, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"picture file: got 'a.jpg', the ending must be one of .html, .png, .gif"):
        worm3d.draw(crawled, tmp_path / "a.jpg")
    with pytest.raises(ValueError, match=r"at: got 3.1 s, must be between 0 and 3 s, where the run is known"):
        worm3d.draw(crawled, tmp_path / "a.png", at=3.1)
    with pytest.raises(ValueError, match=r"path: got NoneType, must be the path of a file"):
        worm3d.draw(crawled, None)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"result: got int, must be a worm3d.Result"):
        worm3d.draw(3, "a.png")  # type: ignore[arg-type]
    with pytest.raises(FileNotFoundError, match="nowhere"):
        worm3d.draw(crawled, tmp_path / "nowhere" / "a.html")


def test_a_reference_and_a_horizon_are_shown_at_the_same_instants(crawled: worm3d.Result) -> None:
    ahead = crawled.com[:, None] + np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]])
    frames = pictures.frames_of(crawled, fps=10.0, reference=[[0, 0, 0], [1, 0, 0]], horizon=ahead)
    assert frames.horizon is not None
    assert_allclose(frames.horizon[..., :2], ahead[::10, :, :2])
    assert_allclose(frames.horizon[..., 2], pictures.PATH_ABOVE, atol=1e-4)
    assert_allclose(frames.path, [[0, 0, pictures.PATH_ABOVE], [1, 0, pictures.PATH_ABOVE]], atol=1e-4)


def test_the_trail_lies_on_the_ground_as_the_path_does(crawled: worm3d.Result) -> None:
    frames = pictures.frames_of(crawled, fps=10.0, reference=crawled.com)
    assert frames.trail is not None
    assert frames.com is not None
    assert frames.path is not None
    assert_array_equal(frames.trail[:, :2], frames.com[:, :2])
    assert_allclose(frames.trail[:, 2], pictures.TRAIL_ABOVE, atol=1e-4)
    assert_allclose(frames.path[::10, 2], pictures.PATH_ABOVE, atol=1e-4)
    assert_array_equal(frames.com, crawled.com[::10])
    assert frames.face_radius is not None
    assert_array_equal(frames.face_radius, [0.05, 0.05])
    joints = np.linalg.norm(crawled.points[:, [0, -1], [6, 7]] - crawled.joints[:, [0, -1]], axis=2)
    assert_allclose(joints, 0.05, rtol=1e-4, err_msg="the discs that are drawn are those that touch")


@pytest.mark.parametrize(
    ("worm", "world"),
    [
        (worm3d.Worm.planar(), worm3d.ClampedGround()),
        (worm3d.Worm.planar(mass=0.1, half_height=0.05, k_torsion=10.0), worm3d.Plane()),
        (worm3d.Worm(segments=1, length=0.2, mass=0.01), worm3d.Plane()),
        (worm3d.Worm(), None),
    ],
)
def test_every_worm_can_be_shown(worm: worm3d.Worm, world: worm3d.Plane | None, tmp_path: Path) -> None:
    result = worm3d.simulate(worm, world, actuation=gaits.TravellingWave(amplitude=0.1), duration=0.2)
    worm3d.draw(result, tmp_path / "a.html")
    worm3d.draw(result, tmp_path / "a.png")


def test_a_notebook_shows_a_result_and_a_script_opens_it(
    crawled: worm3d.Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = crawled._repr_html_()
    assert cell.startswith("<p>the run reached its end: ")
    assert f"distance_m = {crawled.distance:.6g}" in cell
    assert re.search(r'<iframe srcdoc="&lt;!DOCTYPE html&gt;', cell)
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda address, new: opened.append(address))
    page = worm3d.show(crawled, skin=True).open()
    assert opened == [page.as_uri()]
    assert '"name":"skin"' in page.read_text()
    page.unlink()


def test_other_surroundings_can_be_put_into_frames(crawled: worm3d.Result, tmp_path: Path) -> None:
    bigger = plane(np.zeros(3), np.array([0.0, 0.0, 1.0]), length=20.0, width=20.0, tile=1.0)
    frames = replace(pictures.frames_of(crawled), world=bigger)
    pictures.write(frames, tmp_path / "a.glb")
    assert "world/00-ground" in trimesh.load_scene(tmp_path / "a.glb").graph.nodes_geometry
