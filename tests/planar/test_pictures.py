"""Figures and the animation of planar runs show what the arrays say."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from PIL import Image

from planar import animation, figures, published


def test_centre_of_mass_starts_at_zero_and_names_its_units() -> None:
    time = np.linspace(0.0, 1.0, 11)
    figure, axes = figures.centre_of_mass(time, {"a": 3.0 + time, "b": 2.0 * time})
    assert_allclose(axes.lines[0].get_ydata(), time, atol=1e-12)
    assert axes.get_xlabel() == "time [s]"
    assert "[m]" in axes.get_ylabel()
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["a", "b"]
    assert axes.figure is figure


def test_cost_is_drawn_in_its_unit() -> None:
    _, axes = figures.cumulative_cost(np.arange(3.0), {"a": np.array([0.0, 5.0, 9.0])})
    assert_allclose(axes.lines[0].get_ydata(), [0.0, 5.0, 9.0])
    assert "[J/m]" in axes.get_ylabel()


def test_activation_is_drawn_at_its_segment() -> None:
    values = np.array([[0.0, 1.0], [2.0, -2.0]])
    _, axes = figures.activation(np.array([0.0, 1.0]), values, quantity="force", unit="N")
    assert_allclose(axes.lines[0].get_ydata(), [0.0, 0.45])
    assert_allclose(axes.lines[1].get_ydata(), [1.225, 0.55])
    assert "highest force: 2 N" in axes.get_title()


def test_costs_decades_apart_share_a_logarithmic_axis() -> None:
    _, axes = figures.cumulative_cost(np.arange(3.0), {"a": np.array([0.0, 5.0, 9e3])}, logarithmic=True)
    assert axes.get_yscale() == "log"


def test_energy_tells_what_comes_in_is_stored_and_lost() -> None:
    time = np.arange(3.0)
    _, axes = figures.energy_ledger(time, {"work": 2.0 * time}, {"elastic": 0.5 * time}, {"friction": 1.5 * time})
    assert [line.get_linestyle() for line in axes.lines] == ["-", "--", ":"]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["in: work (4 J)", "stored: elastic (1 J)", "lost: friction (3 J)"]
    assert axes.get_ylabel() == "energy [J]"


def test_space_time_has_the_tail_below_and_a_short_impact_does_not_hide_the_rest() -> None:
    time = np.arange(1000.0)
    load = np.tile([1.0, 2.0], (1000, 1))
    load[500] = 1e6
    figure, last = figures.space_time({"load [N]": (time, load), "force [N]": (time, -load)}, "segment")
    (picture,) = figure.axes[0].collections
    assert_allclose(picture.get_array()[:, 0], [1.0, 2.0])
    assert picture.get_clim() == (0.0, 2.0)
    (signed,) = last.collections
    assert signed.get_clim() == (-2.0, 2.0)
    assert last.get_xlabel() == "time [s]"
    assert {axes.get_ylabel() for axes in figure.axes} >= {"segment", "load [N]", "force [N]"}


def test_cases_are_drawn_in_order_and_gaps_are_named() -> None:
    axes = Figure().subplots()
    figures.case_panel(axes, np.array([3.0, 1.0, 2.0]), np.array([30.0, 10.0, np.nan]), "period [s]", "distance [m]")
    assert_allclose(axes.lines[0].get_xdata(), [1.0, 2.0, 3.0])
    assert_allclose(axes.lines[0].get_ydata(), [10.0, np.nan, 30.0])
    assert [(text.get_text(), text.get_position()[0]) for text in axes.texts] == [("none", 2.0)]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("period [s]", "distance [m]")


@pytest.fixture
def movie() -> animation.Movie:
    run = published.simulate(n=3, steps=100)
    net, activation = run.net, np.vstack([np.zeros(3), run.activation])
    return animation.Movie(
        run.time, run.q[:, net.main], run.q[:, net.top], run.q[:, net.bottom], activation, ground=-0.2
    )


def test_movie_plays_in_real_time(movie: animation.Movie, tmp_path: Path) -> None:
    movie.save(tmp_path / "worm.gif", fps=10)
    with Image.open(tmp_path / "worm.gif") as picture:
        assert picture.n_frames == 11
        assert picture.info["duration"] == 100
        picture.seek(0)
        first = np.asarray(picture.convert("RGB"))
        picture.seek(9)
        later = np.asarray(picture.convert("RGB"))
    red = (later[..., 0] > 200) & (later[..., 1] < 150)
    assert red.sum() > 100, "an active segment is red"
    assert (first != later).any()


@pytest.mark.parametrize("fps", [7, 20, 30, 45])
def test_a_gif_lasts_as_long_as_the_run(movie: animation.Movie, tmp_path: Path, fps: int) -> None:
    movie.save(tmp_path / "worm.gif", fps=fps)
    with Image.open(tmp_path / "worm.gif") as picture:
        shown = 0
        for frame in range(picture.n_frames):
            picture.seek(frame)
            shown += picture.info["duration"]
    assert abs(shown - 1000) <= 2 * 1000 / fps


@pytest.mark.parametrize("scale", [1e-10, 1.0, 1e10])
def test_the_picture_keeps_its_size_and_follows_the_worm(scale: float) -> None:
    time = np.arange(3.0)
    moved = np.array([[[0.0, 0.0]], [[20.0, 0.0]], [[-9.0, 5.0]]])
    main = scale * (np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]) + moved)
    top = 0.5 * (main[:, 1:] + main[:, :-1]) + [0.0, 0.1 * scale]
    bottom = top - [0.0, 0.2 * scale]
    shown = animation.Movie(time, main, top, bottom, np.zeros((3, 2)), ground=-0.1 * scale)
    for frame in range(3):
        figure = shown.draw(frame)
        left, right = figure.axes[0].get_xlim()
        assert left <= main[frame, :, 0].min() < main[frame, :, 0].max() <= right
        width, height = figure.get_size_inches() * figure.dpi
        assert width == 800
        assert 100 < height < 600


def test_drawn_corners_are_those_of_the_run(movie: animation.Movie) -> None:
    figure = movie.draw(50)
    bodies = figure.axes[0].collections[-2]
    for path, corners in zip(bodies.get_paths(), movie.corners[50], strict=True):
        assert_allclose(path.vertices[:4], corners)


def test_other_endings_and_a_missing_ffmpeg_are_named(
    movie: animation.Movie, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ValueError, match=r"got 'worm.avi', the ending must be .gif or .mp4"):
        movie.save(tmp_path / "worm.avi")
    monkeypatch.setattr(animation.shutil, "which", lambda name: None)
    with pytest.raises(FileNotFoundError, match="install it, or take a name that ends in"):
        movie.save(tmp_path / "worm.mp4")
