"""Live view of a run in a browser.

with worm3d.Live() as live:
    worm3d.simulate(worm, world, actuation=gait, live=live)
"""

from __future__ import annotations

import time
import warnings
import webbrowser
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from worm3d.recorded.status import Status
from worm3d.results import pictures
from worm3d.results.pictures import FPS
from worm3d.running.run import Observer, Run
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import Spelled
from worm3d.viewer.live import LiveView
from worm3d.viewer.pieces import Scales, rounded_up
from worm3d.worlds.scenery import Window, scenery

if TYPE_CHECKING:
    from worm3d.results.result import Result


Horizon = Callable[[float, FloatArray], FloatArray | None]
"""Function of the time [s] and the centre of mass, shape (3,) [m]. It returns None, or the points through which a
controller expects the centre of mass to move, shape (H, 3) [m]."""

FASTEST = 1e6
"""Largest speed, as simulated time over real time. A higher speed is reduced to this value."""


class Live(Spelled):
    """View that shows runs in a browser.

    Use the object in a `with` statement, which stops the server at its end. The view shows the chambers, links and end
    faces of the worm. Only the page of a finished result also has a smooth skin.

    Parameters
    ----------
    speed : float
        Largest speed of the run, as simulated time over real time. The run waits before a picture that would be too
        early. Infinity means no waiting.
    open_browser : bool
        Whether a browser is opened.
    began : callable, optional
        Function that is called with the address of the view after the first picture. By default, the address is
        printed.
    address : str, optional
        Address of a running meshcat server, for example "tcp://127.0.0.1:6000". By default, a server is started.
    horizon : callable, optional
        Function that is called for each picture with the time [s] and the centre of mass, shape (3,) [m]. It returns
        None, or the points to show: the points through which a controller expects the centre of mass to move, shape
        (H, 3) [m].

    Raises
    ------
    ValueError
        The speed is not above 0.
    ConnectionError
        The server does not start or does not answer when a run begins. If the server fails during a run, there is only
        a warning, and the run goes on without the view.
    """

    def __init__(
        self,
        *,
        speed: float = 1.0,
        open_browser: bool = False,
        began: Callable[[str], None] = print,
        address: str | None = None,
        horizon: Horizon | None = None,
    ) -> None:
        above = "above 0 (simulated over real time)"
        arguments.number("speed", speed, gt=0.0, infinite=True, allowed=above)
        arguments.flag("open_browser", open_browser)
        arguments.function("began", began, "a function of the address")
        self.speed = min(speed, FASTEST)
        self.open_browser, self.began, self.address = open_browser, began, address
        self.horizon = horizon
        self._view: LiveView | None = None
        self._rows = 0
        self._clock = 0.0

    def follow(self, run: Run) -> Observer:
        """Show the start of a run, and return an observer that shows the progress."""
        self._begin(run)

        def look(run: Run) -> None:
            try:
                self._show(run.result(Status.DONE))
            except ConnectionError as error:
                warnings.warn(f"{error}; the run goes on unseen", RuntimeWarning, stacklevel=2)
                self.close()

        rows = self.speed / (FPS * run.dt * run.every)  # rows between two pictures, at FPS pictures per second
        # A run that is slower than `speed` would show too few pictures per second. Therefore the number of rows is
        # limited: to one row in a run with a controller, and otherwise to the rows of about 50 steps.
        most = 1.0 if run.driver.controller is not None else 50 / run.every + 1.0
        return Observer(look, run.every * round(min(max(rows, 1.0), most)))

    def _begin(self, run: Run) -> None:
        self.close()
        start = run.result(Status.DONE)
        corners = start.com[0] + 3.0 * start.worm.length * np.array([[-1.0, -1.0, -0.1], [1.0, 1.0, 0.1]])
        places = np.concatenate([corners, start.points[0].reshape(-1, 3)])
        weight = start.worm.mass * float(np.linalg.norm(start.gravity))
        self._view = LiveView(
            scenery(start.world, Window(places, start.worm.length)).meshes,
            address=self.address,
            scales=Scales(strain=max(start.worm.stroke[1], 0.05), force=rounded_up(max(0.5 * weight, 1e-9))),
        )
        if self.open_browser:
            webbrowser.open(self._view.url, new=2)
        self._rows, self._clock = 0, time.monotonic() - float(start.time[0]) / self.speed
        self._show(start)
        self.began(self._view.url)

    def _show(self, result: Result) -> None:
        """Show pictures of the rows that are new since the last call, and wait for the time of each picture."""
        rows = range(self._rows, len(result.time))
        if self._view is None or not rows:
            return
        new = {name: getattr(result, name)[rows.start :] for name in pictures.SERIES}
        frames = pictures.arrays(new, result.worm, None, result.period, fps=FPS / self.speed)
        for k in range(len(frames)):
            wait = self._clock + float(frames.time[k]) / self.speed - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            elif -wait > 2.0 / FPS and k < len(frames) - 1:
                continue  # the picture is late and is skipped
            assert frames.com is not None
            ahead = None if self.horizon is None else self.horizon(float(frames.time[k]), frames.com[k])
            shown = replace(frames.take([k]), horizon=None if ahead is None else ahead[None])
            self._view.show(shown, caption(result, float(frames.time[k])))
        self._rows = rows.stop

    def close(self) -> None:
        """Close the view and stop the server. The method may be called several times."""
        if self._view is not None:
            self._view.close()
            self._view = None

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def caption(result: Result, time: float) -> str:
    """Return a text with the time and the speed of the centre of mass.

    The speed is the mean over the last gait period, because the centre of mass oscillates with each wave.
    """
    last = int(np.searchsorted(result.time, time))
    since = time - result.period if result.period else time - result.dt
    first = min(int(np.searchsorted(result.time, since - 1e-9)), max(last - 1, 0))
    if last == first:
        return f"{time:.2f} s"
    speed = float(np.linalg.norm(result.com[last] - result.com[first]) / (time - result.time[first]))
    return f"{time:.2f} s   {1e3 * speed:.0f} mm/s"
