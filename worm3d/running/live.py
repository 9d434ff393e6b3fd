"""Live view of a run in a browser.

with worm3d.Live() as live:
    worm3d.simulate(worm, world, actuation=gait, live=live)
"""

from __future__ import annotations

import time
import warnings
import webbrowser
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from worm3d.recorded.energy import Energy
from worm3d.recorded.series import Recorded
from worm3d.results import pictures
from worm3d.running.run import Observer, Run
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import Spelled
from worm3d.viewer.live import LiveView
from worm3d.viewer.pieces import Scales, rounded_up
from worm3d.worlds import World
from worm3d.worlds.scenery import Window, on_ground, scenery

Horizon = Callable[[float, FloatArray], FloatArray | None]
"""Function of the time [s] and the centre of mass, shape (3,) [m], that returns None, or the points through which
a controller expects the centre of mass to move, shape (H, 3) [m]."""

FASTEST = 1e6
"""Largest speed, as simulated time over real time. A higher speed is reduced to this value."""

PICTURES = 30.0
"""Largest number of pictures in a second. With half this value, the motion is seen to jump. With double, the program
would spend a third of its time on pictures."""

SURROUNDED = 3.0
"""Radius of the surroundings that are drawn [body lengths]. They are drawn again when the worm has moved by two thirds
of this radius. With half this value, the edge is seen. With double, terrain is drawn coarsely."""

PATIENT = 0.2
"""Longest time between two looks of a waiting run at the observers [s]."""


class Player(Protocol):
    """Program that answers the controls of the page of a played run."""

    def controls(self) -> Mapping[str, Any]:
        """Return the controls of the page, as `worm3d.viewer.live.LiveView` describes."""

    def state(self) -> Mapping[str, Any]:
        """Return the present values of the controls, and messages for the user."""

    def values(self, run: Run, now: Recorded) -> Mapping[str, ArrayLike]:
        """Return further values of a picture by name, always of the same names and sizes."""

    def path(self, com: FloatArray) -> FloatArray | None:
        """Return the path near the centre of mass, shape (P, 3) [m]. `com` has the shape (3,) [m]. None: no path."""

    def answer(self, run: Run, message: Mapping[str, Any]) -> bool:
        """Obey a message of the page. Return whether the run goes on."""


class Live(Spelled):
    """View that shows runs in a browser.

    Use the object in a `with` statement, which stops the server at the end. The page looks like the page of a finished
    result, and has the pictures so far. The page can pause the run, take single steps, and change the speed.

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
    horizon : callable, optional
        Function that is called for each picture with the time [s] and the centre of mass, shape (3,) [m], and returns
        None or the points to show: the points through which a controller expects the centre of mass to move, shape
        (H, 3) [m].
    title : str
        Title of the page.

    Raises
    ------
    ValueError
        The speed is not above 0.
    ConnectionError
        The server does not start when a run begins. If the server fails during a run, there is only a warning, and the
        run goes on without the view.
    """

    def __init__(
        self,
        *,
        speed: float = 1.0,
        open_browser: bool = False,
        began: Callable[[str], None] = print,
        horizon: Horizon | None = None,
        title: str = "worm3d",
    ) -> None:
        above = "above 0 (simulated over real time)"
        arguments.number("speed", speed, gt=0.0, infinite=True, allowed=above)
        arguments.flag("open_browser", open_browser)
        arguments.function("began", began, "a function of the address")
        arguments.instance("title", title, str, "a text")
        self.speed = min(speed, FASTEST)
        self.open_browser, self.began, self.title = open_browser, began, title
        self.horizon = horizon
        self.player: Player | None = None
        self.goes_on: Callable[[], bool] = lambda: True
        """Function that returns False to end a run that is held."""
        self.held = self.again = False
        """held, again: whether the run waits, and whether the page has ended the run to begin again."""
        self._view: LiveView | None = None
        self._world: World | None = None
        self._shown = self._drawn = -np.inf
        self._steps = self._heard = 0
        self._told: dict[str, Any] = {}
        self._keys: list[str] = []

    def follow(self, run: Run) -> Observer:
        """Show the start of a run, and return an observer that shows the progress."""
        self._begin(run)

        def look(run: Run) -> bool:
            try:
                return self._look(run)
            except ConnectionError as error:
                warnings.warn(f"{error}; the run goes on unseen", RuntimeWarning, stacklevel=2)
                self.close()
                return True

        self._observer = Observer(look, self._steps_between(run))
        return self._observer

    def _steps_between(self, run: Run) -> int:
        """Return the number of steps between two looks: a row if the run waits, otherwise five looks for each picture.

        A run that is slower than `speed` would show too few pictures per second. Therefore the number of rows is
        limited: to one row in a run with a controller, and otherwise to the rows of about 50 steps.
        """
        rows = self.speed / (5.0 * PICTURES * run.dt * run.every)
        most = 1.0 if self.held or run.driver.controller is not None else 50 / run.every + 1.0
        return run.every * round(min(max(rows, 1.0), most))

    def _begin(self, run: Run) -> None:
        now, opens, player = run.recorded_now(), self._view is None, self.player
        if self._view is None:
            weight = now.worm.mass * float(np.linalg.norm(run.plant.gravity))
            scales = Scales(strain=max(now.worm.stroke[1], 0.05), force=rounded_up(max(0.5 * weight, 1e-9)))
            self._view = LiveView(scales=scales, title=self.title)
        controls = None if player is None else player.controls()
        keys = [each["key"] for each in controls["keys"]] if controls else []
        if opens or run.plant.world != self._world or now.time[0] < self._shown or keys != self._keys:
            self._view.begin(controls)
            self._world, self._keys = run.plant.world, keys
            self._energy, self._way = np.zeros(2), deque[tuple[float, FloatArray]]()
            self._surround(now)
        self._row, self._shown, self._told = run.done // run.every, float(now.time[0]), {}
        self._restart(run)
        self._show(run, now)
        self._tell()
        if opens:
            if self.open_browser:
                webbrowser.open(self._view.url, new=2)
            self.began(self._view.url)

    def _surround(self, now: Recorded) -> None:
        """Show the part of the world around the worm, and the path to keep."""
        assert self._view is not None
        size = SURROUNDED * now.worm.length
        places = np.concatenate([now.com[0] + size * np.array([[-1.0, -1.0, -0.1], [1.0, 1.0, 0.1]]), now.joints[0]])
        around = scenery(self._world, Window(places, now.worm.length))
        self._view.surround(around.meshes, None if self.player is None else self.player.path(now.com[0]))
        self._around = now.com[0]

    def _restart(self, run: Run) -> None:
        """Let the present instant be due now."""
        self._clock = time.monotonic() - run.time(run.done) / self.speed

    def _wait(self, run: Run) -> float:
        """Return the time until the present instant is due; negative values mean that the run is late [s]."""
        return self._clock + run.time(run.done) / self.speed - time.monotonic()

    def _look(self, run: Run) -> bool:
        """Show the run if a picture is due, and answer the page until then. Return whether the run goes on."""
        if self._view is None:  # the view has failed or was closed
            return True
        late, last = -self._wait(run), run.done == run.steps
        if late > 2.0 / PICTURES:  # as many pictures as there is time for
            due = time.monotonic() - self._drawn > 1.0 / PICTURES
        else:
            due = run.time(run.done) - self._shown >= 0.999 * self.speed / PICTURES
        if due or last or self.held:
            self._show(run, run.recorded_now())
        if late > 10.0 / PICTURES:  # the machine is too slow, and would race if it could later
            self._restart(run)
        self._steps = max(self._steps - 1, 0)
        while (waits := self.held and not self._steps) or self._wait(run) > 0.0 or self._view.waits:
            heard = self._view.heard(PATIENT if waits else min(max(self._wait(run), 0.0), PATIENT))
            answers = [self._answer(run, message) for message in heard]
            self._tell()
            if not (all(answers) and self.goes_on()):
                return False
            if heard:
                self._show(run, run.recorded_now())
            if self.held:
                self._restart(run)
        return True

    def _answer(self, run: Run, message: Mapping[str, Any]) -> bool:
        """Obey a message of the page. Return whether the run goes on."""
        do, value, number = (message.get(name) for name in ("do", "value", "id"))
        self._heard = number if isinstance(number, int) and abs(number) < 2**24 else 0
        if do in ("hold", "go"):
            self.held, self._steps = do == "hold", 0
        elif do == "step":
            self.held, self._steps = True, self._steps + 1
        elif do == "speed" and isinstance(value, int | float) and 0.0 < value <= FASTEST:
            self.speed = float(value)
        elif self.player is not None:
            return self.player.answer(run, message)
        elif do == "reset":
            self.again = True
            return False
        self._restart(run)
        self._observer.every = self._steps_between(run)
        return True

    def _tell(self) -> None:
        """Tell the page the state of the run after a change."""
        assert self._view is not None
        more = {} if self.player is None else self.player.state()
        state = {"held": self.held, "speed": min(self.speed, FASTEST), **more}
        if state != self._told:
            self._view.tell(**state)
            self._told = state

    def _show(self, run: Run, now: Recorded) -> None:
        """Show a picture of the present instant."""
        assert self._view is not None
        self._tell()
        series = {name: getattr(now, name) for name in pictures.SERIES}
        frames = pictures.arrays(series, now.worm, None, run.period)
        t, com = float(now.time[0]), now.com[0]
        ahead = None if self.horizon is None else self.horizon(t, com)
        trail = on_ground(self._world, now.com, now.worm.length, above=pictures.TRAIL_ABOVE * now.worm.length)
        frames = replace(frames, horizon=None if ahead is None else ahead[None], trail=trail)
        if np.linalg.norm(com - self._around) > 2.0 / 3.0 * SURROUNDED * now.worm.length:
            self._surround(now)
        more = {} if self.player is None else self.player.values(run, now)
        values = {"speed": self._speed(run, t, com), "energy": self._energies(run), "heard": self._heard, **more}
        self._view.show(frames, values)
        self._shown, self._drawn = t, time.monotonic()

    def _speed(self, run: Run, t: float, com: FloatArray) -> float:
        """Return the mean speed of the centre of mass over the last period, since the speed oscillates in a wave [m/s].

        Without a period, return the mean speed since the last picture.
        """
        if not self._way or t > self._way[-1][0]:
            self._way.append((t, com))
        while len(self._way) > 2 and self._way[1][0] <= t - (run.period or 0.0) + 1e-9:
            self._way.popleft()
        begin, place = self._way[0]
        return float(np.linalg.norm(com - place) / (t - begin)) if t > begin else 0.0

    def _energies(self, run: Run) -> FloatArray:
        """Return the work of the actuators and the loss to friction since the first picture, shape (2,) [J]."""
        row = run.done // run.every
        if row > self._row:
            new = Energy.of(run.records.fields(slice(self._row + 1, row + 1))["energy"])
            self._energy = self._energy + np.array([new.work_contract.sum(), new.friction_loss.sum()])
            self._row = row
        return self._energy

    def close(self) -> None:
        """Close the view and stop the server. The method may be called several times."""
        if self._view is not None:
            self._view.close()
            self._view = None

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
