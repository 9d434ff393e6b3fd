"""What a browser shows of the page, without a network: seen by a headless Chromium, asserted on the picture."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from worm3d.viewer import Frames, write_html

pytestmark = pytest.mark.slow

WIDE, HIGH = 900, 600


@pytest.fixture(scope="module")
def viewer(short: Frames, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "viewer.html"
    write_html(short, path, title="a crawling worm")
    return path


def middle_of_red(scene: NDArray[np.int64]) -> float:
    """Return the column around which the pixels are that are as red as a contracted chamber [pixels]."""
    red, green, blue = np.moveaxis(scene, -1, 0)
    strong = (red > 150) & (red - blue > 90) & (red - green > 90)
    assert strong.sum() > 300
    return float(np.nonzero(strong)[1].mean())


def test_the_worm_is_seen_and_moves(browser: Any, viewer: Path) -> None:
    # A camera that stands still, and nothing else that moves.
    alone = "camera=side&hide=forces,anchors,trail,horizon"
    first, later = (browser.picture(viewer, f"t={t}&{alone}") for t in (0.0, 1.0))
    for picture in (first, later):
        assert picture.shape == (HIGH, WIDE, 3)
        assert 0.01 < browser.worm_share(picture) < 0.3, "a worm, and no giant"
    changed = np.abs(browser.scene(first) - browser.scene(later)).max(axis=2) > 30
    assert 0.01 < changed.mean() < 0.3, "the worm moved, the rest stood still"
    assert abs(middle_of_red(browser.scene(first)) - middle_of_red(browser.scene(later))) > 150, (
        "another part of it is contracted"
    )


@pytest.mark.parametrize(("state", "there"), [("t=1", True), ("t=1&bare=1", False)])
def test_the_playback_bar_is_seen_unless_a_bare_picture_is_wanted(
    browser: Any, viewer: Path, state: str, there: bool
) -> None:
    bar = browser.picture(viewer, state)[HIGH - 56 : HIGH - 10]
    button = np.abs(bar[:, 20:62] - [0x34, 0x40, 0x4F]).max(axis=2) < 8
    assert (button.mean() > 0.3) == there


@pytest.mark.parametrize("camera", ["side", "top", "inside"])
def test_every_camera_sees_the_worm(browser: Any, viewer: Path, camera: str) -> None:
    picture = browser.picture(viewer, f"t=1&camera={camera}&hide=forces,anchors,horizon")
    assert 0.01 < browser.worm_share(picture) < 0.6
    middle = browser.scene(picture)[150:400, 150:550]
    assert np.ptp(middle.reshape(-1, 3), axis=0).max() > 100


def test_layers_can_be_switched_off_and_the_world_made_clear(browser: Any, viewer: Path) -> None:
    empty = browser.picture(viewer, "hide=links,chambers,forces,anchors,trail,path,horizon&world=0")
    assert browser.worm_share(empty) == 0
    assert np.ptp(browser.scene(empty)[:, 300], axis=0).max() < 80, "only the background"


def time_shown(document: str) -> float:
    time = re.search(r'data-time="([\d.]+)"', document)
    assert time is not None
    return float(time[1])


def test_it_plays_and_tells_time_and_speed(browser: Any, viewer: Path) -> None:
    assert any(time_shown(browser.document(viewer, "play=1")) > 0.0 for _ in range(5)), "few frames, or none, are drawn"
    document = browser.document(viewer, "t=1.5")
    assert 'data-state="ready"' in document
    assert time_shown(document) == 1.5
    assert re.search(r'id="speed">speed [\d.]+ m/s<', document)
    assert "a crawling worm" in document
    for label in (
        "side",
        "top",
        "follow",
        "inside",
        "links",
        "chambers",
        "contact forces",
        "anchored",
        "trail",
        "path",
    ):
        assert label in document


def test_the_skin_and_a_still_are_seen(browser: Any, make_crawl: Callable[..., Frames], tmp_path: Path) -> None:
    worm = make_crawl(duration=1.0, contact_force=None, anchored=None)
    write_html(worm, tmp_path / "skin.html", skin=True)
    first, later = (browser.picture(tmp_path / "skin.html", f"t={t}&hide=links,chambers") for t in (0.0, 0.95))
    for picture in (first, later):
        assert browser.worm_share(picture) > 0.01
    assert (np.abs(browser.scene(first) - browser.scene(later)).max(axis=2) > 10).mean() > 0.005
    write_html(worm.take([3]), tmp_path / "still.html")
    still = browser.picture(tmp_path / "still.html", "")
    assert browser.worm_share(still) > 0.01
