"""A connection to a meshcat server, and a server of our own: neither waits for ever, nothing is left behind."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import zmq

from worm3d.viewer import recorder

UNANSWERED = 200
"""Commands under way at a time; the server drops answers beyond a thousand."""
SERVER = Path(__file__).with_name("server.py")
"""The program of the server, run as a file."""


class Connection:
    """A connection to a meshcat server that gives up after a while instead of waiting for ever.

    Commands do not wait for their answers one by one, which would take most of the time.
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
        """Return the answer to a question of one word."""
        self.settle()
        self._put([question.encode()])
        return self._answer().decode()

    def send(self, command: recorder.Content) -> None:
        """Send one command of meshcat."""
        self._put([command["type"].encode(), command["path"].encode(), recorder.packed(command)])
        if self._unanswered >= UNANSWERED:
            self.settle()

    def settle(self) -> None:
        """Wait until everything has been answered."""
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
        """Close the socket; what is still under way is dropped."""
        self._socket.close()
        self._context.term()


class Server:
    """A meshcat server of our own; it also stops when this process ends, however that happens."""

    def __init__(self, timeout: float) -> None:
        self._process = subprocess.Popen(
            # As a file: the package would bring the simulator along. -P: its neighbours are not to be imported.
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
        self._ready.wait(timeout)
        address = [line.removeprefix("zmq_url=") for line in self._lines if line.startswith("zmq_url=")]
        if not address:
            self.stop()
            raise ConnectionError("live view: meshcat's server did not start:\n" + "\n".join(self._lines[-5:]))
        self.address = address[0]

    def _read(self) -> None:
        """Read all it says, or it would wait for us; the address is said first."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines = [*self._lines[-20:], line.strip()]
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
