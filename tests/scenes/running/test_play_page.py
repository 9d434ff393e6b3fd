"""The page of `worm3d play` by real clicks, keys and drags, at two sizes of the window."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from devtools import Chromium, program

from scenes.models.loading import load_scene
from scenes.running.playing import Player
from worm3d.running.live import Live
from worm3d.viewer.skin import RING_CORNERS

PATIENCE = 60.0
"""How long the page may take for what it is asked [s]; a page without a graphics card takes a second or two."""


class Playing:
    """A scene that is played in a thread until it is told to end."""

    def __init__(self, scene: str) -> None:
        self.player, self.urls, self.goes_on = Player(load_scene(scene)), list[str](), True
        self._thread = threading.Thread(target=self._play)
        self._thread.start()
        wait(lambda: self.urls)

    def _play(self) -> None:
        with Live(began=self.urls.append) as live:
            live.player, live.goes_on = self.player, lambda: self.goes_on
            while self.goes_on:
                self.player.leg(live)

    def end(self) -> None:
        self.goes_on = False
        self._thread.join()


def wait(condition: Any) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "it does not come"
        time.sleep(0.05)


@pytest.fixture
def playing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Playing]:
    monkeypatch.chdir(tmp_path)
    made = Playing("flat")
    yield made
    made.end()


@pytest.fixture(params=[(1280, 800), (400, 700)], ids=["wide", "narrow"])
def page(playing: Playing, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    found = program()
    if found is None:
        pytest.skip("no Chromium here")
    with Chromium(found, tmp_path_factory.mktemp("chromium"), size=request.param) as browser:
        browser.open(playing.urls[0])
        yield browser
        assert not browser.errors, browser.errors


def text(page: Any, name: str) -> str:
    return str(page.value(f"document.getElementById({name!r}).textContent"))


def now(page: Any) -> float:
    return float(page.value("document.documentElement.dataset.time"))


def open_controls(page: Any) -> None:
    if not page.value("document.getElementById('controls').open"):
        page.click("#controls summary")


@pytest.mark.slow
def test_sliders_keys_and_a_pull_change_the_run(page: Any, playing: Playing, tmp_path: Path) -> None:
    gait = lambda: playing.player.scene.settings.gait  # noqa: E731
    open_controls(page)
    x, y = page.place_of('input[name="gait.amplitude"]')
    page.drag((x - 20, y), (x - 8, y))
    wait(lambda: gait().amplitude > 0.25)
    shown = "Number(document.querySelector('input[name=\"gait.amplitude\"]').nextElementSibling.value)"
    wait(lambda: page.value(shown) == pytest.approx(gait().amplitude, rel=1e-3))
    page.press("ArrowLeft")
    wait(lambda: gait().hinge_deg == 5.0)
    page.press("ArrowUp")
    wait(lambda: gait().period_s < 2.0)
    page.click("#save")
    wait(lambda: "saved: " in text(page, "told"))
    (saved,) = tmp_path.glob("flat-*.toml")
    assert load_scene(saved).settings.gait == gait()
    outwards = page.value(
        "(() => { const { position, normal } = viewer.scene_tree.find(['meshcat', 'skin']).object"
        ".getObjectByProperty('isMesh', true).geometry.attributes;"
        f" const ring = Array.from({{ length: {RING_CORNERS} / 2 }}, (_, c) => {18 * RING_CORNERS} + 2 * c);"
        " const at = (of, i) => new MeshCat.THREE.Vector3().fromBufferAttribute(of, i);"
        " const middle = new MeshCat.THREE.Vector3();"
        " ring.forEach((i) => middle.addScaledVector(at(position, i), 1 / ring.length));"
        " return ring.map((i) => at(normal, i).dot(at(position, i).sub(middle).normalize())); })()"
    )
    assert min(outwards) > 0.3, "the skin is seen from outside, also the coarse skin without a graphics card"
    page.click("#controls summary")
    page.press(" ")  # the camera stands too
    wait(lambda: text(page, "play") == "\u25b6")
    page.settle()
    place = page.value(
        "(() => { const p = viewer.controls.target.clone().project(viewer.camera);"
        " return [(0.5 + 0.5 * p.x) * innerWidth, (0.5 - 0.5 * p.y) * innerHeight]; })()"
    )
    forces: list[str] = []

    def held() -> None:
        wait(lambda: text(page, "tag").endswith(" N") and not page.value("document.getElementById('tag').hidden"))
        forces.append(text(page, "tag"))
        assert playing.player._grip is not None
        wait(lambda: seen() == pytest.approx([place[0] + 40, place[1] + 90], abs=3))  # also the last move of the mouse

    def seen() -> Any:
        """Return the place in the window [pixels] to which the spring leads."""
        forward, left, up = playing.player._pointer + playing.player._off  # z is up in the run, and y in the page
        return page.value(
            f"(() => {{ const p = viewer.controls.target.clone().set({forward}, {up}, {-left}).project(viewer.camera);"
            " return [(0.5 + 0.5 * p.x) * innerWidth, (0.5 - 0.5 * p.y) * innerHeight]; })()"
        )

    page.drag(tuple(place), (place[0] + 40, place[1] + 90), ctrl=True, held=held)
    assert float(forces[0].removesuffix(" N")) > 0.05
    wait(lambda: playing.player._grip is None)
    wait(lambda: page.value("document.getElementById('tag').hidden"))


@pytest.mark.slow
def test_the_play_bar_holds_the_run_and_shows_what_was_seen(page: Any, playing: Playing) -> None:
    wait(lambda: now(page) > 1.0)
    page.press(" ")
    wait(lambda: text(page, "play") == "\u25b6")
    page.settle()
    held = now(page)
    time.sleep(0.5)
    assert now(page) == held
    page.press(".")
    wait(lambda: now(page) == pytest.approx(held + 0.01, abs=1e-6))
    page.press("Home")
    wait(lambda: now(page) == 0.0)
    page.click("#live")
    wait(lambda: now(page) == pytest.approx(held + 0.01, abs=1e-6))
    page.click("#play")
    wait(lambda: now(page) > held + 0.3)
    x, y = page.place_of("#time")
    page.drag((x, y), (x - 10, y))
    past = now(page)
    time.sleep(0.5)
    assert now(page) == past, "the past stays, while the run goes on"
    assert playing.player._run is not None
    assert playing.player._run.time(playing.player._run.done) > past
    open_controls(page)
    page.click("#reset")
    wait(lambda: 0.0 < now(page) < past or now(page) < 0.5)


@pytest.mark.slow
def test_two_tabs_a_reload_and_the_tools(page: Any, playing: Playing, tmp_path_factory: pytest.TempPathFactory) -> None:
    wait(lambda: now(page) > 0.5)
    with Chromium(str(program()), tmp_path_factory.mktemp("second")) as other:
        other.open(playing.urls[0])
        other.press(" ")
        wait(lambda: text(page, "play") == "\u25b6")
        wait(lambda: now(other) == now(page))
        page.open(playing.urls[0])
        page.press("Home")
        assert now(page) == 0.0, "a reload has all that was seen"
    if not page.value("document.getElementById('panel').open"):
        page.click("#panel summary")
    if page.value("document.getElementById('plots').hidden"):
        page.click('#tools button[value="plots"]')
    x, y = page.place_of('canvas[data-plot="strain"]')
    page.drag((x, y), (x, y), steps=0)
    middle = page.value("[Number(document.getElementById('time').min), Number(document.getElementById('time').max)]")
    assert now(page) == pytest.approx(sum(middle) / 2, abs=0.05 * middle[1] + 0.02)
    page.click('#tools button[value="plots"]')
    page.click('#tools button[value="still"]')
    wait(lambda: "image/png" in (page.value("document.documentElement.dataset.offered") or ""))
    page.click('#tools button[value="film"]')
    time.sleep(1.0)
    page.click('#tools button[value="film"]')
    wait(lambda: "video/webm" in page.value("document.documentElement.dataset.offered"))
    page.click('#tools button[value="measure"]')
    page.click("#panel summary")
    wide, high = page.value("[innerWidth, innerHeight]")
    for place in ((0.5 * wide, 0.7 * high), (0.6 * wide, 0.75 * high)):
        page.drag(place, place, steps=0)
    assert text(page, "tag").endswith(" mm")
