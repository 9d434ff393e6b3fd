"""Live view of the simulated worm in a browser, through a meshcat server."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import zmq

from worm3d.viewer import pieces, recorder
from worm3d.viewer.frames import Frames
from worm3d.viewer.pieces import Scales
from worm3d.viewer.world import WorldMesh

STARTUP = 60.0
"""Longest time to wait for a server to start [s]. An idle machine needs 1 s, and a busy machine many times as long.
With half this value, the view might fail on a busy machine. With double, the user would wait longer for a server that
has failed."""

UNANSWERED = 200
"""Largest number of commands that are sent before their answers are read. The server drops answers if there are more
than a thousand."""

_LOG = logging.getLogger(__name__)

SERVER = Path(__file__).with_name("server.py")
"""File with the program of the server."""


class LiveView:
    """A window in the browser that shows the current state of the worm. Use it in a `with` statement.

    The window shows chambers, links and end faces, because these only have to be moved. A skin, as on the page of a
    result, would have to be sent again for each picture.

    Parameters
    ----------
    world : sequence of WorldMesh
        Surroundings of the worm, which are sent only once.
    address : str, optional
        Address of the command socket of a running meshcat server, for example "tcp://127.0.0.1:6000". By default, a new
        server is started, and `close` stops it.
    scales : Scales, optional
        Scales of colours and of force arrows.
    timeout : float
        Longest time to wait for an answer of the server [s].

    Raises
    ------
    ConnectionError
        The server does not start, or does not answer, in time.
    """

    def __init__(
        self,
        world: Sequence[WorldMesh] = (),
        *,
        address: str | None = None,
        scales: Scales | None = None,
        timeout: float = 10.0,
    ) -> None:
        self._scales = scales or Scales()
        self._placed: set[str] = set()
        self._shown = 0
        self._closed = False
        self._server = Server() if address is None else None
        with ExitStack() as opened:
            if self._server is not None:
                opened.callback(self._server.stop)
                address = self._server.address
            self._window = opened.enter_context(closing(Connection(str(address), timeout)))
            self.url = self._window.ask("url")
            placed = (command for piece in pieces.world(tuple(world)) for command in recorder.place(piece))
            self._window.send(*recorder.stage(), *placed)
            self._window.settle()
            self._opened = opened.pop_all()

    def show(self, frames: Frames, caption: str = "") -> None:
        """Show the worm at the first instant of `frames`, and a caption at the top of the picture.

        Raises
        ------
        ConnectionError
            The view is closed, or the server has stopped or does not answer.
        """
        if self._closed:
            raise ConnectionError("the live view is closed: open a new one")
        if self._server is not None and not self._server.running:
            raise ConnectionError("live view: meshcat's server has stopped: open a new view")
        parts = [*pieces.worm(frames, self._scales), *pieces.contact(frames, self._scales), *pieces.way(frames)]
        if not self._placed:
            self._window.send(recorder.stand(frames.axes, frames.body_length))
        for part in parts:
            # The server stores every colour that it receives until the piece is placed again.
            stale = part.tint is not None and self._shown % 500 == 0
            if stale or part.path not in self._placed:
                self._window.send(*recorder.place(part))
            self._window.send(*recorder.move(part))
        paths = {part.path for part in parts}
        self._window.send(*(recorder.remove(path) for path in sorted(self._placed - paths)))
        self._placed = paths
        self._shown += 1
        self._window.send(recorder.look_at(frames.centre[0]))
        if caption:
            self._window.send(*recorder.caption(caption))
        self._window.settle()

    def close(self) -> None:
        """Close the connection, and stop the server if this view has started it.

        The method may be called several times.
        """
        self._closed = True
        self._opened.close()

    def __enter__(self) -> LiveView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Connection:
    """A connection to a meshcat server, with a timeout for answers.

    Commands are sent without waiting for each answer, because waiting would take most of the time.
    """

    def __init__(self, address: str, timeout: float) -> None:
        self._address = address
        self._unanswered = 0
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.SNDTIMEO, round(1000 * timeout))
        self._socket.setsockopt(zmq.RCVTIMEO, round(1000 * timeout))
        try:
            self._socket.connect(address)
        except zmq.ZMQError as error:
            self.close()
            raise ConnectionError(
                f"live view: got the address {address!r}, must be like 'tcp://127.0.0.1:6000'"
            ) from error

    def ask(self, question: str) -> str:
        """Return the answer to a request of a single word, for example "url"."""
        self.settle()
        self._put([question.encode()])
        return self._answer().decode()

    def send(self, *commands: recorder.Content) -> None:
        """Send commands of meshcat."""
        for command in commands:
            self._put([command["type"].encode(), command["path"].encode(), recorder.packed(command)])
            if self._unanswered >= UNANSWERED:
                self.settle()

    def settle(self) -> None:
        """Wait until all commands have been answered."""
        while self._unanswered:
            self._answer()

    def _put(self, message: list[bytes]) -> None:
        with self._patience():
            self._socket.send_multipart([b"", *message])
        self._unanswered += 1

    def _answer(self) -> bytes:
        with self._patience():
            answer = self._socket.recv_multipart()
        self._unanswered -= 1
        return answer[-1]

    @contextmanager
    def _patience(self) -> Iterator[None]:
        try:
            yield
        except zmq.Again as error:
            raise ConnectionError(
                f"live view: no meshcat server answers at {self._address}: check the address, or leave it out"
            ) from error

    def close(self) -> None:
        """Close the socket, and drop unanswered commands."""
        self._socket.close()
        self._context.term()


class Server:
    """A meshcat server in a process of its own. The server stops when `stop` is called, or when this process ends."""

    def __init__(self, timeout: float = STARTUP) -> None:
        self._process = subprocess.Popen(
            # The server runs as a file, not as a module, because an import of the package would import the simulator.
            # Without -P, Python would search the folder of the server's file first, and import html.py in this folder
            # instead of the standard module html.
            [sys.executable, "-P", str(SERVER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._lines: list[str] = []
        self._ready = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        spoke = self._ready.wait(timeout)
        address = [line.removeprefix("zmq_url=") for line in self._lines if line.startswith("zmq_url=")]
        if not address:
            self.stop()
            said = " ".join(self._lines[-1:]) or "it said nothing"
            slow = f"has not answered for {timeout:g} s, the machine is too busy: try again later"
            raise ConnectionError(f"live view: meshcat's server {f'did not start: {said}' if spoke else slow}")
        self.address = address[0]

    def _read(self) -> None:
        """Read all output of the server, because the server would block if nobody read its output.

        The first lines of the output are the addresses.
        """
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines = [*self._lines[-20:], line.strip()]
            if line.startswith("dropped="):  # other lines are tornado's and meshcat's
                _LOG.warning("live view: %s", line.removeprefix("dropped=").strip())
            if line.startswith("web_url="):
                self._ready.set()
        self._ready.set()

    @property
    def running(self) -> bool:
        """Whether the process is alive."""
        return self._process.poll() is None

    def stop(self) -> None:
        """Stop the process, and wait until it is gone."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        self._process.stdout.close()
