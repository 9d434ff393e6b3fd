"""What a browser shows of the page, and what it does when one clicks and types, without a network."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from devtools import HIGH, WIDE, Picture
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from worm3d.viewer import Frames, write_html
from worm3d.viewer.live import LiveView
from worm3d.viewer.pieces import Scales
from worm3d.viewer.skin import Skin

CAMERAS = ("side", "top", "follow", "inside")

SCENE = (520.0, 300.0)
"""A place of the scene beside the panel and above the bar [pixels]."""


@pytest.fixture(scope="module")
def shown(short: Frames) -> Frames:
    return replace(short, face_radius=[0.05, 0.05], reference_speed=np.full(len(short), 0.06))


@pytest.fixture(scope="module")
def viewer(shown: Frames, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "viewer.html"
    write_html(shown, path, title="a crawling worm")
    return path


@pytest.fixture(scope="module")
def turning(make_crawl: Callable[..., Frames], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a page of a worm that goes round a half circle of three body lengths across."""
    straight = make_crawl(duration=12.0, fps=5.0, turn=0.0, contact_force=None, anchored=None)
    angle = np.pi / 12.0 * straight.time
    place = 1.5 * np.stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle], axis=1)
    turn = np.zeros((len(angle), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1] = (
        np.cos(angle),
        -np.sin(angle),
        np.sin(angle),
        np.cos(angle),
    )
    turn[:, 2, 2] = 1.0

    def there(points: NDArray[np.float64], moves: bool = True) -> NDArray[np.float64]:
        shape = points.shape
        flat = points.reshape(len(angle), -1, 3)
        middle = straight.centre[:, None] * [1.0, 1.0, 0.0] * moves
        return (np.einsum("tij,tpj->tpi", turn, flat - middle) + moves * place[:, None]).reshape(shape)

    frames = replace(
        straight,
        joints=there(straight.joints),
        apexes=there(straight.apexes),
        directors=there(straight.directors, moves=False),
        com=there(straight.centre[:, None])[:, 0],
    )
    path = tmp_path_factory.mktemp("turning") / "viewer.html"
    write_html(frames, path)
    return path


def middle_of_red(scene: Picture) -> float:
    """Return the column around which the pixels are that are as red as a contracted chamber [pixels]."""
    red, green, blue = np.moveaxis(scene, -1, 0)
    strong = (red > 150) & (red - blue > 90) & (red - green > 90)
    assert strong.sum() > 300
    return float(np.nonzero(strong)[1].mean())


def time_shown(browser: Any) -> float:
    return float(browser.value("document.documentElement.dataset.time"))


def camera(browser: Any) -> dict[str, Any]:
    """Return where the camera is, and what it looks at, with z up [m]."""
    place = "(v => [v.x, -v.z, v.y])"
    said = f"{{place: {place}(viewer.camera.position), to: {place}(viewer.controls.target)}}"
    return {name: np.array(value) for name, value in browser.value(f"({said})").items()}


def test_the_worm_is_seen_and_moves(browser: Any, viewer: Path) -> None:
    # A camera that stands still, and nothing else that moves.
    alone = "camera=side&hide=forces,anchors,trail,horizon"
    first, later = (browser.look(viewer, f"t={t}&{alone}") for t in (0.0, 1.0))
    for picture in (first, later):
        assert picture.shape == (HIGH, WIDE, 3)
        assert 0.01 < browser.worm_share(picture) < 0.3, "a worm, and no giant"
    changed = np.abs(browser.scene(first) - browser.scene(later)).max(axis=2) > 30
    assert 0.01 < changed.mean() < 0.3, "the worm moved, the rest stood still"
    assert abs(middle_of_red(browser.scene(first)) - middle_of_red(browser.scene(later))) > 150, (
        "another part of it is contracted"
    )


@pytest.mark.slow
@pytest.mark.parametrize(("state", "there"), [("t=1", True), ("t=1&bare=1", False)])
def test_the_playback_bar_is_seen_unless_a_bare_picture_is_wanted(
    browser: Any, viewer: Path, state: str, there: bool
) -> None:
    bar = browser.look(viewer, state)[HIGH - 56 : HIGH - 10]
    button = np.abs(bar[:, 20:62] - [0x34, 0x40, 0x4F]).max(axis=2) < 8
    assert (button.mean() > 0.3) == there


@pytest.mark.slow
def test_every_camera_sees_the_worm(browser: Any, viewer: Path) -> None:
    browser.open(viewer, "t=1&hide=forces,anchors,horizon")
    for name in CAMERAS:
        browser.click(f'#cameras button[value="{name}"]')
        picture = browser.picture()
        assert 0.01 < browser.worm_share(picture) < 0.6, name
        middle = browser.scene(picture)[150:400, 150:550]
        assert np.ptp(middle.reshape(-1, 3), axis=0).max() > 100, name
    assert not browser.errors, browser.errors


@pytest.mark.slow
def test_layers_are_switched_by_clicks_and_the_world_made_clear(browser: Any, viewer: Path) -> None:
    browser.open(viewer, "camera=follow&world=0")
    names = browser.value("[...document.querySelectorAll('#layers input')].map(box => box.value)")
    shown = browser.value("[...document.querySelectorAll('#layers input:checked')].map(box => box.value)")
    assert set(names) - set(shown) == {"links", "chambers"}, "the skin covers these"
    assert browser.worm_share(browser.picture()) > 0.01
    for name in shown:
        browser.click(f'#layers input[value="{name}"]')
    empty = browser.picture()
    assert browser.worm_share(empty) == 0
    assert np.ptp(browser.scene(empty)[:, 300], axis=0).max() < 80, "only the background"
    browser.click('#layers input[value="chambers"]')
    assert browser.worm_share(browser.picture()) > 0.01
    opacity = "viewer.scene_tree.find(['meshcat', 'skin', 'skin', '<object>']).object.material.opacity"
    assert browser.value(opacity) < 0.6, "one sees through the skin what it covers"
    browser.click('#layers input[value="chambers"]')
    assert browser.value(opacity) == 1
    assert not browser.errors, browser.errors


@pytest.mark.slow
def test_the_page_bends_the_skin_as_it_was_made(browser: Any, viewer: Path, shown: Frames) -> None:
    cover = Skin.of(shown, Scales.of(shown).strain)
    geometry = "viewer.scene_tree.find(['meshcat', 'skin', 'skin', '<object>']).object.geometry"
    browser.open(viewer)
    for frame in (0, 7, len(shown) - 1):
        browser.go(f"t={shown.time[frame]}")
        for name, made in (("position", cover.vertices(frame)), ("color", cover.paint(frame))):
            drawn = np.reshape(browser.value(f"Array.from({geometry}.attributes.{name}.array)"), (-1, 3))
            assert_allclose(drawn, made, atol=1e-5)
    browser.go(f"t={0.5 * (shown.time[7] + shown.time[8])}")
    drawn = np.reshape(browser.value(f"Array.from({geometry}.attributes.position.array)"), (-1, 3))
    assert_allclose(drawn, 0.5 * (cover.vertices(7) + cover.vertices(8)), atol=1e-5, err_msg="between two frames")


@pytest.mark.slow
def test_the_end_faces_are_seen(browser: Any, viewer: Path) -> None:
    browser.open(viewer, "t=1&camera=inside&hide=forces,anchors,horizon,trail,path")
    with_faces = browser.scene(browser.picture())
    browser.click('#layers input[value="faces"]')
    without = browser.scene(browser.picture())
    assert (np.abs(with_faces - without).max(axis=2) > 30).mean() > 0.005, "the head's disc is looked at from ahead"


@pytest.mark.slow
def test_it_plays_and_tells_time_and_speed(browser: Any, viewer: Path) -> None:
    browser.open(viewer)
    assert time_shown(browser) == 0.0
    browser.click("#play")
    until(browser, "Number(document.documentElement.dataset.time) > 0")
    browser.click("#play")
    stopped = time_shown(browser)
    browser.settle()
    assert time_shown(browser) == stopped
    browser.go("t=0.5")
    said = browser.value("document.getElementById('panel').innerText")
    assert re.search(r"speed 0\.0\d+ m/s\n+mean of 0\.00 to 1\.50 s", said), "near the ends the mean is over less time"
    assert "reference 0.0600 m/s" in said
    document = browser.value("document.documentElement.outerHTML")
    for label in ("a crawling worm", "side", "top", "follow", "links", "chambers", "skin", "end faces"):
        assert label in document
    for label in ("contact forces", "anchored", "trail (centre of mass)", "path to keep to", "horizon"):
        assert label in document
    assert "scene tree" not in document


CLICKED = ("#panel summary", "#clock", '#layers input[value="trail"]', '#cameras button[value="top"]')
CLICKED += ("#opacity input", "#time", "#loop", "#play", "#rate")


@pytest.mark.slow
def test_keys_work_whatever_was_clicked(browser: Any, viewer: Path) -> None:
    browser.open(viewer)
    browser.value("viewer.renderer.render = () => 0")  # what is drawn does not matter, and takes most of the time
    boxes = "[...document.querySelectorAll('input[type=checkbox]')].map(box => box.checked)"
    settings = f"[{boxes}, document.getElementById('rate').value, document.querySelector('#opacity input').value]"
    playing = "document.getElementById('play').getAttribute('aria-label') === 'Pause'"
    for clicked in (None, *CLICKED):
        if clicked:
            browser.value("document.getElementById('panel').open = true")
            browser.click(clicked)
        if clicked == "#rate":
            browser.press("Escape")  # the list is open
        if browser.value(playing):
            browser.press(" ")
        before = browser.value(settings)
        for key, there in (("Home", 0.0), ("ArrowRight", 0.1), ("End", 2.0), ("ArrowLeft", 1.9)):
            browser.press(key)
            assert time_shown(browser) == pytest.approx(there, abs=1e-3), f"{key} after a click on {clicked}"
        browser.press("Home")  # near the end, a film that is not repeated may end before the question
        browser.press(" ")
        assert browser.value(playing), clicked
        browser.press(" ")
        assert not browser.value(playing), clicked
        assert browser.value(settings) == before, f"{clicked}: keys changed more than the time"
    assert not browser.errors, browser.errors


@pytest.mark.slow
def test_who_goes_to_a_control_by_the_tab_key_operates_it_by_keys(browser: Any, viewer: Path) -> None:
    browser.open(viewer)
    for _ in range(30):
        browser.press("Tab")
        if browser.value("document.activeElement.value") == "trail":
            break
    box = "document.querySelector('#layers input[value=trail]').checked"
    assert browser.value(box)
    browser.press(" ")
    assert not browser.value(box)
    assert time_shown(browser) == 0.0
    browser.click("#clock")
    browser.press("ArrowRight", alt=True)
    assert time_shown(browser) == 0.0, "the browser's own keys stay its own"


@pytest.mark.slow
def test_the_other_controls_do_what_they_say(browser: Any, viewer: Path) -> None:
    browser.open(viewer, "t=1.8")
    opacity = "viewer.scene_tree.find(['meshcat', 'world', '00-ground', '<object>']).object.material.opacity"
    assert browser.value(opacity) == 1
    x, y = browser.place_of("#opacity input")
    browser.drag((x, y), (x - 100.0, y), steps=2)
    assert browser.value(opacity) == 0
    browser.click("#loop")
    browser.click("#play")
    until(browser, "document.getElementById('play').getAttribute('aria-label') === 'Play'")
    assert time_shown(browser) == pytest.approx(2.0), "it is not repeated"
    browser.click("#loop")
    browser.click("#play")
    until(
        browser,
        "Number(document.documentElement.dataset.time) > 0 && Number(document.documentElement.dataset.time) < 1",
    )
    x, y = browser.place_of("#time")
    browser.drag((x, y), (x, y), steps=0)
    assert time_shown(browser) == pytest.approx(1.0, abs=0.05)
    until(browser, "document.getElementById('play').getAttribute('aria-label') === 'Play'")
    browser.click("#panel summary")
    assert browser.value("document.getElementById('panel').open") is False
    for _ in range(30):
        browser.press("Tab")
        if browser.value("document.activeElement.id") == "rate":
            break
    browser.press("ArrowDown")
    assert browser.value("document.getElementById('rate').value") == "2"
    assert not browser.errors, browser.errors


def until(browser: Any, condition: str) -> None:
    """Wait until a condition holds on the page."""
    for _ in range(500):
        if browser.value(condition):
            return
        browser.settle()
    raise AssertionError(f"never: {condition}")


@pytest.mark.slow
def test_the_camera_stays_above_the_ground(browser: Any, viewer: Path) -> None:
    browser.open(viewer, "t=1")
    for name in ("side", "top", "follow"):
        browser.click(f'#cameras button[value="{name}"]')
        for _ in range(3):
            before = camera(browser)
            browser.drag(SCENE, (SCENE[0] + 30.0, 20.0), steps=4)
            after = camera(browser)
            assert after["place"][2] > 0.01, f"{name}: it is above"
            away = [float(np.linalg.norm(seen["place"] - seen["to"])) for seen in (before, after)]
            assert away[1] == pytest.approx(away[0], rel=1e-6), f"{name}: it does not come nearer"
        assert after["place"][2] < 0.3, f"{name}: it did come down"


@pytest.mark.slow
def test_cameras_keep_the_worm_in_a_bend(browser: Any, turning: Path) -> None:
    browser.open(turning, "hide=trail")
    for name, sideways, ahead_at_most in (("side", -0.95, 0.1), ("follow", -0.7, 0.6)):
        browser.go("t=0")
        browser.click(f'#cameras button[value="{name}"]')
        for t in (0.0, 3.0, 6.0, 9.0, 12.0):
            browser.go(f"t={t}")
            seen, angle = camera(browser), np.pi / 12.0 * t
            ahead = np.array([np.cos(angle), np.sin(angle), 0.0])
            left = np.array([-ahead[1], ahead[0], 0.0])
            from_worm = (seen["place"] - seen["to"]) / np.linalg.norm(seen["place"] - seen["to"])
            assert from_worm @ left < sideways, f"{name} at {t} s: from the right"
            assert abs(from_worm @ ahead) < ahead_at_most, f"{name} at {t} s"
            picture = browser.picture()
            assert 0.01 < browser.worm_share(picture) < 0.4
            red, green, blue = np.moveaxis(browser.scene(picture)[:, [0, -1]], -1, 0)
            assert not ((red - blue > 60) & (red - green > 40)).any(), f"{name} at {t} s: the whole worm is seen"


@pytest.mark.slow
def test_chambers_without_a_skin_and_a_still_are_seen(
    browser: Any, make_crawl: Callable[..., Frames], tmp_path: Path
) -> None:
    worm = make_crawl(duration=1.0, contact_force=None, anchored=None)
    write_html(worm, tmp_path / "bare.html", skin=False)
    first, later = (browser.look(tmp_path / "bare.html", f"t={t}") for t in (0.0, 0.95))
    for picture in (first, later):
        assert browser.worm_share(picture) > 0.01
    assert (np.abs(browser.scene(first) - browser.scene(later)).max(axis=2) > 10).mean() > 0.005
    write_html(worm.take([3]), tmp_path / "still.html")
    assert browser.worm_share(browser.look(tmp_path / "still.html", "")) > 0.01


def test_the_page_runs_no_script_but_its_own(browser: Any, viewer: Path, tmp_path: Path) -> None:
    foreign = "<script>document.title = 'taken over'</script><img src='https://elsewhere.example/' onerror='die()'>"
    changed = viewer.read_text("utf-8").replace('<div id="meshcat-pane">', foreign + '<div id="meshcat-pane">')
    (tmp_path / "changed.html").write_text(changed, "utf-8")
    browser.open(tmp_path / "changed.html", "")
    assert browser.value("document.title") == "a crawling worm"
    assert len([error for error in browser.errors if "Content Security Policy" in error]) >= 3, "script, image, handler"


@pytest.mark.slow
def test_the_live_page_shows_the_worm_and_keeps_to_its_policy(browser: Any, short: Frames) -> None:
    with LiveView(short.world) as view:
        view.show(short)
        for name in ("127.0.0.1", "localhost"):
            browser.open(view.url.replace("127.0.0.1", name))
            assert browser.worm_share(browser.picture()) > 0.005
            assert not browser.errors, browser.errors
