from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from scenes import models
from scenes.language.errors import DiscError, MissingPartError, SceneError
from scenes.models.loading import load_scene
from scenes.models.worm.view import scene_of
from scenes.records.record import Record
from scenes.running import drawing
from scenes.running.runner import simulate

MODEL = models.get("planar_published")


def test_every_figure_is_a_picture_with_labelled_axes(record: Record, tmp_path: Path) -> None:
    paths = drawing.plot(record, MODEL, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in paths)
    for path in paths:
        with Image.open(path) as picture:
            assert len(picture.convert("RGB").getcolors(100_000) or []) > 20
    for draw in MODEL.figures.values():
        _, axes = draw(record)
        assert axes.get_xlabel() == "time [s]"
        assert axes.get_ylabel()


@pytest.mark.parametrize("name", ["planar_published", "planar_linkage"])
def test_no_title_is_clipped(record: Record, tmp_path: Path, name: str) -> None:
    """However long: it is broken into lines."""
    if name == "planar_linkage":
        record = simulate(load_scene("planar_wave", ["run.duration_s=0.1"]))
    object.__setattr__(record, "title", "Distance, cost of transport and much else of worms by number of segments")
    for stem, draw in models.get(name).figures.items():
        figure, _ = draw(record)
        drawing.save_figure(figure, tmp_path / f"{stem}.png")
        wide = figure.bbox.width
        for text in (*(axes.title for axes in figure.axes), *figure.texts):
            box = text.get_window_extent(FigureCanvasAgg(figure).get_renderer())
            assert 0.0 <= box.x0 <= box.x1 <= wide, stem


def test_the_animation_moves(record: Record, tmp_path: Path) -> None:
    path = drawing.animate(record, MODEL, tmp_path / "a.gif")
    with Image.open(path) as movie:
        assert movie.n_frames == 5  # 0.2 s at 20 frames a second
        frames = []
        for n in (0, movie.n_frames - 1):
            movie.seek(n)
            frames.append(np.asarray(movie.convert("RGB"), dtype=int))
    assert np.abs(frames[0] - frames[1]).max() > 100
    assert [p.name for p in tmp_path.iterdir()] == ["a.gif"]


def test_a_thinned_record_is_coloured_by_the_activation_of_its_instants() -> None:
    overrides = ["run.duration_s=1", "run.record_every=20"]
    record = simulate(load_scene("planar_published", overrides))
    movie = MODEL.animate(record)
    assert movie.activation.shape == (6, 6)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(movie.activation[1:], record["activation"][19::20])  # type: ignore[attr-defined]


def test_mp4_needs_ffmpeg(record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingPartError, match=r"MP4 needs the program ffmpeg, .* install it") as caught:
        drawing.animate(record, MODEL, tmp_path / "a.mp4")
    assert caught.value.exit_code == 4
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.avi", "a"])
def test_other_endings(record: Record, tmp_path: Path, name: str) -> None:
    with pytest.raises(SceneError, match=r"the name of an animation must end in \.gif or \.mp4"):
        drawing.animate(record, MODEL, tmp_path / name)


def test_a_missing_folder_is_a_disc_error(record: Record, tmp_path: Path) -> None:
    with pytest.raises(DiscError, match=r"^cannot write .*a\.gif: no such file or directory$"):
        drawing.animate(record, MODEL, tmp_path / "none" / "a.gif")


def test_a_run_with_parts_that_are_not_known_here_says_so(record: Record) -> None:
    other = replace(record, model="worm", scene='model = "worm"\n[world]\nkind = "inch"\n')
    with pytest.raises(SceneError) as error:
        scene_of(other)
    first, second = error.value.lines
    assert first.endswith("made with parts that are not known here; modules of one's own are to be imported before")
    assert second.startswith("line 3: world.kind: got 'inch'")
