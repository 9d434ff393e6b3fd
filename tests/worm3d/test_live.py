"""A run that is watched is the same run, and leaves no port and no process behind."""

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import worm3d
from control import gaits
from worm3d.running import live as module
from worm3d.viewer import Frames


def crawl(**more: object) -> worm3d.Result:
    given = {"duration": 0.6, **more}
    return worm3d.simulate(worm3d.Worm(), worm3d.Plane(), actuation=gaits.TravellingWave(period=0.5), **given)  # type: ignore[arg-type]


def listens(url: str) -> bool:
    host, port = url.split("/")[2].split(":")
    with socket.socket() as probe:
        return probe.connect_ex((host, int(port))) == 0


def test_a_run_that_is_watched_is_the_same_run_in_real_time() -> None:
    seen: list[str] = []
    done: list[float] = []
    crawl()  # compiled
    with worm3d.Live(speed=0.5, began=seen.append) as live:
        start = time.monotonic()
        watched = crawl(live=live, observer=lambda t, view: done.append(t))
        took = time.monotonic() - start
        assert listens(seen[0])
    assert not listens(seen[0])
    np.testing.assert_allclose(done, 0.1 * np.arange(7.0), err_msg="every tenth step, and the start")
    assert took >= 1.2, "0.6 s at half the speed"
    assert_array_equal(watched.joints, crawl().joints)


def test_every_picture_is_one_of_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[np.ndarray] = []
    speeds: list[float] = []
    energies: list[np.ndarray] = []
    show = module.LiveView.show

    def look(view: module.LiveView, frames: Frames, values: Mapping[str, Any]) -> None:
        shown.append(frames.joints[0])
        speeds.append(values["speed"])
        energies.append(values["energy"])
        show(view, frames, values)

    monkeypatch.setattr(module.LiveView, "show", look)
    with worm3d.Live(speed=1e9, began=lambda url: None) as live:
        result = crawl(live=live, duration=20.0)
    assert 3 <= len(shown) < 500, "it does not wait for pictures"
    rows = [int(np.argmax((result.joints == joints).all(axis=(1, 2)))) for joints in shown]
    assert rows[0] == 0
    assert rows[-1] == 2000
    assert rows == sorted(rows)
    # The speed is the mean over the last period of 0.5 s, from the last picture before it.
    begin = max(row for row in rows if row <= 1950)
    moved = np.linalg.norm(result.com[2000] - result.com[begin]) / (0.01 * (2000 - begin))
    np.testing.assert_allclose(speeds[-1], moved, rtol=1e-9)
    work, lost = result.energy.work_contract.sum(), result.energy.friction_loss.sum()
    np.testing.assert_allclose(energies[-1], [work, lost], rtol=1e-9)


@pytest.mark.parametrize("speed", [1.0, 8.0])
def test_the_page_holds_a_run_takes_steps_and_sets_its_speed(speed: float) -> None:
    """Two steps of a held run, also of one that is fast before, and then it goes on ten times as fast as real time."""
    done: list[tuple[float, float]] = []
    crawl()  # compiled
    with worm3d.Live(speed=speed, began=lambda url: None) as live:

        def ask() -> None:
            assert live._view is not None
            for message in ({"do": "hold"}, {"do": "step"}, {"do": "step"}, {"do": "speed", "value": 10}, {"do": "go"}):
                time.sleep(0.5)
                live._view._server.heard.put(message)

        asks = threading.Thread(target=ask)

        def look(t: float, view: worm3d.View) -> None:
            if not done:
                asks.start()
            done.append((t, time.monotonic()))

        result = crawl(duration=8.0, live=live, observer=look, every=1)
        asks.join()
    assert result.status is worm3d.Status.DONE
    waits = np.diff([clock for _, clock in done])
    longest = np.sort(np.argsort(waits)[-3:])
    assert (waits[longest] > 0.3).all(), "held until the first step, between both, and until it goes on"
    assert list(np.diff(longest)) == [1, 1], "each step is one time step"
    (begin, began), (end, ended) = done[longest[-1] + 1], done[-1]
    assert ended - began >= 0.9 * (end - begin) / 10.0
    assert_array_equal(result.joints, crawl(duration=8.0).joints)


def test_an_interrupted_run_closes_its_view() -> None:
    seen: list[str] = []

    def interrupt(t: float, view: worm3d.View) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), worm3d.Live(began=seen.append) as live:
        crawl(live=live, observer=interrupt)
    assert not listens(seen[0])


def test_a_run_goes_on_when_its_view_dies() -> None:
    with worm3d.Live(began=lambda url: None) as live:

        def kill(t: float, view: worm3d.View) -> None:
            if live._view is not None:
                assert live._view._server is not None
                live._view._server.stop()

        with pytest.warns(RuntimeWarning, match="server has stopped: open a new view; the run goes on unseen"):
            result = crawl(live=live, observer=kill)
    assert result.status is worm3d.Status.DONE


def test_a_held_run_goes_on_when_its_view_dies() -> None:
    """Also if there is nothing to send, so that no transmission fails."""
    with worm3d.Live(began=lambda url: None) as live:
        late = time.monotonic() + 20.0
        live.goes_on = lambda: time.monotonic() < late

        def ask() -> None:
            assert live._view is not None
            live._view._server.heard.put({"do": "hold"})
            time.sleep(0.5)
            live._view._server._process.kill()

        asks = threading.Thread(target=ask)

        def look(t: float, view: worm3d.View) -> None:
            if t == 0.0:
                asks.start()

        with pytest.warns(RuntimeWarning, match="the run goes on unseen"):
            result = crawl(live=live, observer=look)
        asks.join()
    assert result.status is worm3d.Status.DONE


def test_a_speed_that_is_none_is_named() -> None:
    with pytest.raises(ValueError, match=r"speed: got 0, must be above 0 \(simulated over real time\)"):
        worm3d.Live(speed=0)


def test_the_address_is_printed_if_nobody_asks_for_it() -> None:
    code = (
        "import worm3d\n"
        "with worm3d.Live(speed=1e9) as live:\n"
        "    worm3d.simulate(worm3d.Worm(), worm3d.Plane(), duration=0.1, live=live)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("http://127.0.0.1:")


def test_the_page_lets_a_run_that_is_only_watched_end_to_begin_again() -> None:
    with worm3d.Live(speed=1e6, began=lambda url: None) as live:

        def look(t: float, view: worm3d.View) -> None:
            if abs(t - 0.3) < 1e-9:
                assert live._view is not None
                live._view._server.heard.put({"do": "reset"})

        result = crawl(duration=20.0, live=live, observer=look)
        assert (result.status, live.again) == (worm3d.Status.INTERRUPTED, True)
