"""Figures, movies and meshes without a browser."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib import pyplot as plt
from matplotlib.quiver import Quiver
from matplotlib.text import Text
from numpy.testing import assert_allclose
from PIL import Image

from worm3d.viewer import Frames, colours, meshes, movie, pipe
from worm3d.viewer import figure as drawing
from worm3d.viewer.figure import Projection
from worm3d.viewer.pieces import Scales
from worm3d.viewer.skin import Skin

SIDE = Projection(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.array([0, -1.0, 0]))


def reddish(picture: np.ndarray) -> int:
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    return int(((red > 170) & (red - green > 60) & (red - blue > 60)).sum())


def test_a_png_shows_the_worm_from_both_sides(short: Frames, tmp_path: Path) -> None:
    figure, (side, top) = drawing.figure(short, 10)
    figure.savefig(tmp_path / "worm.png")
    assert side.figure is top.figure is figure
    assert (side.get_ylabel(), top.get_xlabel(), top.get_ylabel()) == (
        "z [m]",
        "along the initial heading [m]",
        "to its left [m]",
    )
    assert side.get_title(loc="left").startswith("t = 1.00 s   mean speed 0.0")
    assert " m/s over 2 s   " in side.get_title(loc="left")
    assert not plt.get_fignums(), "nothing is left open, nothing is shown"
    with Image.open(tmp_path / "worm.png") as image:
        seen = np.asarray(image.convert("RGB"))
    half = len(seen) // 3
    assert reddish(seen[:half]) > 1000
    assert reddish(seen[half:]) > 1000


def test_a_worm_along_x_has_plain_axes(make_crawl: Callable[..., Frames]) -> None:
    worm = make_crawl(duration=1.0, turn=0.0)
    _, (side, top) = drawing.figure(worm, 5)
    assert (top.get_xlabel(), top.get_ylabel()) == ("x [m]", "y [m]")
    assert_allclose(side.get_xlim(), top.get_xlim())
    low, high = side.get_xlim()
    assert low < worm.apexes[..., 0].min() < worm.apexes[..., 0].max() < high


def test_the_title_of_a_narrow_figure_is_not_clipped(make_crawl: Callable[..., Frames]) -> None:
    upright = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    level = make_crawl(duration=10.0, turn=0.0)
    up = {name: getattr(level, name) @ upright for name in ("joints", "apexes", "directors", "com", "contact_force")}
    figure, (side, _) = drawing.figure(replace(level, time=level.time + 1000.0, **up), 100)
    figure.canvas.draw()
    title = next(text for text in side.findobj(Text) if text.get_text().startswith("t = 1004.00 s"))
    assert "an arrow of" in title.get_text()
    assert title.get_window_extent().x1 < figure.bbox.x1


def test_one_scale_in_both_views(short: Frames) -> None:
    figure, both = drawing.figure(short)
    figure.canvas.draw()
    scales = []
    for axes in both:
        box = axes.get_window_extent()
        scales += [box.width / np.ptp(axes.get_xlim()), box.height / np.ptp(axes.get_ylim())]
    assert_allclose(scales, scales[0], rtol=1e-3)


def test_a_long_way_is_followed(make_crawl: Callable[..., Frames]) -> None:
    worm = make_crawl(duration=80.0, fps=2.0, heading=2.0)
    stage = drawing.Stage(worm)
    axes = worm.axes
    for index in (0, 57, 160):
        stage.draw(index)
        seen = worm.apexes[index].reshape(-1, 3) @ axes.T
        for view, row in zip(stage.axes, (2, 1), strict=True):
            for limits, along in ((view.get_xlim(), seen[:, 0]), (view.get_ylim(), seen[:, row])):
                assert limits[0] < along.min() < along.max() < limits[1]


def test_polygons_face_who_sees_them_anticlockwise() -> None:
    square = np.array([[4.0, 2.0, 2.0], [6.0, 2.0, 2.0], [6.0, 2.0, 4.0], [4.0, 2.0, 4.0]])
    turned = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    assert_allclose(SIDE.facing(np.stack([square, square[::-1], square @ turned])), [1.0, -1.0, 0.6], atol=1e-12)


def test_the_worm_is_drawn_with_what_faces_the_viewer(make_crawl: Callable[..., Frames]) -> None:
    frames = make_crawl(duration=2.0, turn=0.0, face_radius=[0.05, 0.04])
    stage = drawing.Stage(frames)
    corners, paint = Skin.of(frames, stage.scales.strain).panels(20)
    volume = np.einsum("pi,pi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) + np.einsum(
        "pi,pi->", corners[:, 0], np.cross(corners[:, 2], corners[:, 3])
    )
    cover = Skin.of(frames, stage.scales.strain)
    whole = trimesh.Trimesh(cover.vertices(20), cover.faces, process=False).volume
    assert_allclose(volume / 6.0, whole, rtol=0.05, err_msg="the panels are closed and look outwards")
    assert (paint[-16:] == colours.FACE).all()
    ahead = Projection(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]))
    shapes, seen = ahead.seen(corners, paint)
    assert len(shapes) == len(seen) < len(corners)
    head = np.abs(seen[-8:] / seen[-8:, :1] - np.array(colours.FACE) / colours.FACE[0]).max()
    assert head < 1e-9, "the head's end face is next to who looks from ahead"
    x, y = np.moveaxis(shapes - shapes.mean(axis=1, keepdims=True), -1, 0)
    area = np.sum(x * np.roll(y, -1, axis=0) - y * np.roll(x, -1, axis=0), axis=0)
    assert (area > -1e-6).all()


def test_arrows_have_the_length_of_what_they_stand_for(short: Frames) -> None:
    stage = drawing.Stage(short)
    stage.draw(10)
    (arrows,) = (each for each in stage.axes[0].collections if isinstance(each, Quiver))
    assert short.contact_force is not None
    assert_allclose(arrows.V, short.contact_force[10, ..., 2].ravel() * 0.2 / stage.scales.force)


def test_the_world_is_cut_where_the_worm_is() -> None:
    line = np.array([[-1.0, 0.0, 0.5], [0.0, 0.0, 0.5], [1.0, 0.0, 0.5]])
    wall = pipe(line, 0.2, sides=64)
    cut = SIDE.cut(wall.vertices, wall.faces, np.array([0.0, 0.0, 0.5]))
    assert_allclose(np.abs(cut[..., 1] - 0.5), 0.2, rtol=2e-3)
    assert_allclose([cut[..., 0].min(), cut[..., 0].max()], [-1.0, 1.0])
    assert not len(SIDE.cut(wall.vertices, wall.faces, np.array([0.0, 1.0, 0.5])))


def test_a_frame_that_does_not_exist_is_refused(short: Frames) -> None:
    with pytest.raises(IndexError):
        drawing.figure(short, 21)
    with pytest.raises(IndexError):
        meshes.scene(short, 21)


def test_a_gif_plays_in_real_time_and_the_worm_moves(short: Frames, tmp_path: Path) -> None:
    figure, axes = movie.write_movie(short, tmp_path / "worm.gif", fps=5)
    assert axes[0].figure is figure
    with Image.open(tmp_path / "worm.gif") as picture:
        assert picture.n_frames == 11
        assert picture.info["duration"] == 200
        frames = []
        for index in (0, 5):
            picture.seek(index)
            frames.append(np.asarray(picture.convert("RGB")))
    assert min(reddish(frame) for frame in frames) > 1000
    changed = (np.abs(frames[0].astype(int) - frames[1]).max(axis=2) > 40).mean()
    assert 0.005 < changed < 0.3


def test_other_endings_and_a_missing_ffmpeg_are_named(
    short: Frames, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ValueError, match=r"movie file: got 'worm.avi', the ending must be .gif or .mp4"):
        movie.write_movie(short, tmp_path / "worm.avi")
    with pytest.raises(ValueError, match=r"fps: got 0, must be a finite number above 0"):
        movie.write_movie(short, tmp_path / "worm.gif", fps=0)
    monkeypatch.setattr(movie.shutil, "which", lambda _: None)
    with pytest.raises(FileNotFoundError, match="install it, or take a name that ends in"):
        movie.write_movie(short, tmp_path / "worm.mp4")


@pytest.mark.skipif(movie.shutil.which("ffmpeg") is None, reason="no ffmpeg on this machine")
def test_an_mp4_is_written_where_ffmpeg_is_found(short: Frames, tmp_path: Path) -> None:
    movie.write_movie(short, tmp_path / "worm.mp4", fps=10)
    assert (tmp_path / "worm.mp4").read_bytes()[4:8] == b"ftyp"
    with pytest.raises(FileNotFoundError, match="nowhere"):
        movie.write_movie(short, tmp_path / "nowhere" / "worm.mp4")
    (tmp_path / "folder.mp4").mkdir()
    with pytest.raises(OSError, match=r"ffmpeg could not write .*folder\.mp4: "):
        movie.write_movie(short, tmp_path / "folder.mp4")


def test_links_and_chambers_are_closed_meshes_around_the_worm(short: Frames) -> None:
    scene = meshes.scene(short, 4)
    names = [name for name in scene.graph.nodes_geometry if name.startswith(("links/", "chambers/"))]
    parts = [scene.geometry[name].copy().apply_transform(scene.graph[name][0]) for name in names]
    assert all(part.is_watertight for part in parts)
    corners = np.concatenate([short.apexes[4].reshape(-1, 3), short.joints[4]])
    bounds = np.array([part.bounds for part in parts])
    assert_allclose(bounds[:, 0].min(axis=0), corners.min(axis=0), atol=0.03)
    assert_allclose(bounds[:, 1].max(axis=0), corners.max(axis=0), atol=0.03)
    colours = {tuple(part.visual.material.baseColorFactor) for part in parts}
    assert len(colours) == 13, "one of the links, one for each chamber"
    worlds = [len(scene.geometry[name].faces) for name in scene.graph.nodes_geometry if name.startswith("world/")]
    assert sorted(worlds) == sorted(len(part.faces) for part in short.world)


def test_a_glb_has_y_up_and_names(short: Frames, tmp_path: Path) -> None:
    (tmp_path / "worm.glb").write_bytes(meshes.glb(short, 20))
    scene = trimesh.load_scene(tmp_path / "worm.glb")
    names = set(scene.graph.nodes_geometry)
    assert {"links/00-L-below-tail", "chambers/05-R", "trail/com", "path/reference", "world/00-ground"} <= names
    chamber = trimesh.transform_points(np.zeros((1, 3)), scene.graph["chambers/02-L"][0])[0]
    x, y, z = short.apexes[20, 2, :2].mean(axis=0)
    assert_allclose(chamber, [x, z, -y], atol=1e-6)


def test_a_glb_has_the_skin_in_its_colours(short: Frames, tmp_path: Path) -> None:
    frames = replace(short, face_radius=np.array([0.05, 0.05]))
    (tmp_path / "worm.glb").write_bytes(meshes.glb(frames, 20))
    scene = trimesh.load_scene(tmp_path / "worm.glb")
    assert {"skin/skin", "faces/tail", "faces/head"} <= set(scene.graph.nodes_geometry)
    skin = scene.geometry["skin/skin"]
    assert skin.is_watertight
    made = Skin.of(frames.take([20]), Scales.of(frames).strain)
    assert_allclose(np.ptp(skin.vertices, axis=0), np.ptp(made.vertices(0), axis=0), rtol=1e-5)
    assert_allclose(skin.visual.vertex_colors[:, :3].mean(axis=0), 255.0 * made.paint(0).mean(axis=0), atol=2.0)
