"""A run that is watched is the same run, and leaves no port and no process behind."""

import socket
import subprocess
import sys
import time

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
    captions: list[object] = []
    show = module.LiveView.show

    def look(view: module.LiveView, frames: Frames, caption: str) -> None:
        shown.append(frames.joints[0])
        captions.append(caption)
        show(view, frames, caption)

    monkeypatch.setattr(module.LiveView, "show", look)
    with worm3d.Live(speed=1e9, began=lambda url: None) as live:
        result = crawl(live=live)
    assert 3 <= len(shown) < 61, "it does not wait for pictures"
    rows = [int(np.argmax((result.joints == joints).all(axis=(1, 2)))) for joints in shown]
    assert rows[0] == 0
    assert rows[-1] == 60
    assert rows == sorted(rows)
    assert captions == [module.caption(result, float(result.time[row])) for row in rows]


def test_the_caption_has_time_and_speed() -> None:
    """Over the period before: 0.5 s; a worm without a gait, over a step."""
    result = crawl(duration=2.0)
    moved = np.linalg.norm(result.com[150] - result.com[100]) / 0.5
    assert module.caption(result, 0.0) == "0.00 s"
    assert module.caption(result, 1.5) == f"1.50 s   {1e3 * moved:.0f} mm/s"
    assert 1e3 * moved > 20.0
    fall = worm3d.simulate(worm3d.Worm(), None, duration=0.1)
    assert module.caption(fall, 0.1) == f"0.10 s   {1e3 * 9.81 * 0.095:.0f} mm/s"


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
