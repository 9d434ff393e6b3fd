"""Pictures of an episode: frames as arrays, without a display, and the live page."""

from __future__ import annotations

from itertools import repeat

import numpy as np

from scenes.running.viewing import open_in_browser
from worm3d.recorded.status import Status
from worm3d.results.pictures import SERIES, arrays
from worm3d.running.live import Live
from worm3d.running.run import Observer, Run
from worm3d.values.arrays import FloatArray
from worm3d.viewer.figure import Stage
from worm3d.viewer.movie import Picture as Picture
from worm3d.viewer.movie import pictures

ROWS = 40
"""Largest number of instants of the trail in a picture."""


class Camera:
    """Pictures of one episode, side view above top view, which follow the worm and all have the same size."""

    def __init__(self) -> None:
        self._stage: Stage | None = None

    def picture(self, run: Run, path: FloatArray | None) -> Picture:
        """Return the present picture of a run, shape (height, width, 3).

        Parameters
        ----------
        run : Run
        path : ndarray, shape (P, 3), or None
            Path that the worm has to follow [m].
        """
        result = run.result(Status.DONE)
        rows = np.unique(np.linspace(0, len(result.time) - 1, ROWS).round().astype(int))
        series = {name: getattr(result, name)[rows] for name in SERIES}
        frames = arrays(series, result.worm, result.world, result.period, reference=path)
        if self._stage is None:
            self._stage = Stage(frames, follows=True)
            self._pictures = pictures(self._stage, repeat(-1))
        self._stage.show(frames)
        return next(self._pictures)


class Page:
    """The live page of an environment, which shows one episode after another.

    Raises
    ------
    ConnectionError
        The page cannot be served.
    """

    def __init__(self) -> None:
        self._live = Live(began=_told)
        self._observer: Observer | None = None

    def begin(self, run: Run) -> None:
        """Show the start of an episode."""
        self._observer = self._live.follow(run)

    def show(self, run: Run) -> None:
        """Show the motion since the last call, in real time."""
        assert self._observer is not None
        self._observer.look(run)

    def close(self) -> None:
        """End the page."""
        self._live.close()


def _told(address: str) -> None:
    if not open_in_browser(address):
        print(f"to be seen at {address}")  # noqa: T201  # there is no other output
