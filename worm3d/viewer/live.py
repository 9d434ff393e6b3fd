"""A live page in a browser: a window for the worm of a run that goes on, and for the wishes of the user.

The page is the page of a finished run. The server is a separate process (`worm3d.viewer.server`).
"""

from __future__ import annotations

import json
import logging
import queue
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from worm3d.values.arrays import FloatArray
from worm3d.viewer import html
from worm3d.viewer.frames import Frames
from worm3d.viewer.pieces import Scales
from worm3d.viewer.server import FRAME, HEADER, PAGE, SCENE, STATE, WORLD
from worm3d.viewer.stream import Stream
from worm3d.viewer.world import WorldMesh

STARTUP = 60.0
"""Longest time to wait for a server to start [s]. An idle machine needs 1 s, and a busy machine many times as long.
With half this value, the view might fail on a busy machine. With double, the user would wait longer for a server that
has failed."""

STOPPED = "live view: the server has stopped: open a new view"
"""Message of an error."""

_LOG = logging.getLogger(__name__)

SERVER = Path(__file__).with_name("server.py")
"""File with the program of the server."""

NOTHING: Mapping[str, Any] = MappingProxyType({})


class LiveView:
    """A page in the browser that shows the current state of the worm, for a `with` statement.

    Parameters
    ----------
    world : sequence of WorldMesh
        Surroundings of the worm, until `surround` replaces them.
    scales : Scales, optional
        Scales of colours and of force arrows.
    title : str
        Title of the page.
    controls : mapping, optional
        Controls of the page: under "keys", the sliders, each a mapping with key, value, low, high, unit and meaning, or
        with choices; under "steers", a text about the arrow keys. Without controls, the page only plays the run.

    Raises
    ------
    ConnectionError
        The server does not start in time.
    """

    def __init__(
        self,
        world: Sequence[WorldMesh] = (),
        *,
        scales: Scales | None = None,
        title: str = "worm3d",
        controls: Mapping[str, Any] | None = None,
    ) -> None:
        self._scales, self._controls = scales or Scales(), controls
        self._around: tuple[Sequence[WorldMesh], FloatArray | None] = (world, None)
        self._stream: Stream | None = None
        self._closed = False
        self._server = Server()
        self.url = self._server.url
        self._send(PAGE, html.live_page(title).encode())

    def show(self, frames: Frames, values: Mapping[str, ArrayLike] = NOTHING) -> None:
        """Show the worm at the first instant of `frames`. `values` are further values for the plots of the page.

        The names and sizes of the values must always be the same.

        Raises
        ------
        ConnectionError
            The view is closed, or the server has stopped.
        """
        self._require_open()
        if self._stream is None:
            self._stream = Stream(frames, self._scales, values, self._controls)
            self._send(SCENE, self._stream.scene())
            self.surround(*self._around)
        self._send(FRAME, self._stream.row(frames, values))

    def surround(self, world: Sequence[WorldMesh], path: FloatArray | None = None) -> None:
        """Replace the surroundings, and the path that the worm has to keep, shape (P, 3) [m]."""
        self._around = (world, path)
        if self._stream is not None:
            self._send(WORLD, self._stream.surroundings(world, path))

    def begin(self, controls: Mapping[str, Any] | None = None) -> None:
        """Forget all frames. The next frame is the first of another run, which may have other controls."""
        self._stream, self._controls = None, controls

    def tell(self, **state: Any) -> None:
        """Send the page a state to show. Browsers that come later get the latest state only."""
        self._send(STATE, json.dumps(state).encode())

    def heard(self, timeout: float = 0.0) -> list[dict[str, Any]]:
        """Return the messages of browsers since the last call. Wait at most `timeout` for the first of them [s].

        Raises
        ------
        ConnectionError
            There is no message, and the server has stopped.
        """
        found: list[dict[str, Any]] = []
        try:
            found.append(self._server.heard.get(timeout > 0.0, timeout))
            while True:
                found.append(self._server.heard.get_nowait())
        except queue.Empty:
            if not found:
                self._server.require_running()
            return found

    @property
    def waits(self) -> bool:
        """Whether there are messages that `heard` would return at once."""
        return not self._server.heard.empty()

    def _require_open(self) -> None:
        if self._closed:
            raise ConnectionError("the live view is closed: open a new one")

    def _send(self, kind: bytes, content: bytes) -> None:
        self._require_open()
        self._server.send(kind, content)

    def close(self) -> None:
        """Stop the server. The method may be called several times."""
        if not self._closed:
            self._closed = True
            self._server.stop()

    def __enter__(self) -> LiveView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Server:
    """A server in a separate process. The server stops when `stop` is called, or when this process ends."""

    def __init__(self, timeout: float = STARTUP) -> None:
        self._process = subprocess.Popen(
            # The server runs as a file, not as a module, because an import of the package would import the simulator.
            # Without -P, Python would search the folder of the server's file first, and import html.py in this folder
            # instead of the standard module html.
            [sys.executable, "-P", str(SERVER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        self.url, self._lines = "", [""]
        self.heard: queue.Queue[dict[str, Any]] = queue.Queue(10_000)
        """Messages of browsers, at most as many as a user can send while the run computes a step."""
        self._ready = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        spoke = self._ready.wait(timeout)
        if not self.url:
            self.stop()
            said = self._lines[-1] or "it said nothing"
            slow = f"has not answered for {timeout:g} s, the machine is too busy: try again later"
            raise ConnectionError(f"live view: the server {f'did not start: {said}' if spoke else slow}")

    def send(self, kind: bytes, content: bytes) -> None:
        """Send a message. ConnectionError if the server has stopped."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(HEADER.pack(kind, len(content)) + content)
            self._process.stdin.flush()
        except (OSError, ValueError) as error:
            raise ConnectionError(STOPPED) from error

    def require_running(self) -> None:
        """Raise ConnectionError if the server has stopped."""
        if self._process.poll() is not None:
            raise ConnectionError(STOPPED)

    def _read(self) -> None:
        """Read all output of the server, because the server would block if nobody read its output."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            kind, _, text = line.decode(errors="replace").strip().partition("=")
            if kind == "heard":
                if not self.heard.full():
                    self.heard.put(json.loads(text))
            elif kind == "dropped":
                _LOG.warning("live view: %s", text)
            elif kind == "url":
                self.url = text
                self._ready.set()
            else:  # tornado's
                self._lines = [*self._lines[-20:], line.decode(errors="replace").strip()]
        self._ready.set()

    def stop(self) -> None:
        """Stop the process, and wait for the end of the process."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(OSError):  # the process may have gone before it read everything
            self._process.stdin.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        self._process.stdout.close()
