"""Program of the server of a live page. Only this machine is served. The server stops with its parent process.

The process that runs the worm sends messages to the standard input of this program, each with a header `HEADER`: the
kind of the message, and the number of bytes that follow. The program sends them to all browsers, and keeps all that a
browser needs that comes later: the page, the scene, the surroundings, the latest state, and the frames so far. If there
are too many frames, every second frame of the older half is dropped. Messages of browsers, and remarks, are lines on
the standard output.

The process is never made to wait: a browser that reads slowly misses frames, and a browser that has stopped is dropped.
Requests for another host than this machine, from a page of another origin, or without the token in the address of the
page are refused.
"""

from __future__ import annotations

import asyncio
import functools
import hmac
import json
import secrets
import signal
import struct
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, BinaryIO

from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

HEADER = struct.Struct("<4sI")
"""Kind of a message as four bytes, and the number of bytes that follow."""

PAGE, SCENE, WORLD, FRAME, STATE, MANY = b"page", b"scen", b"worl", b"fram", b"stat", b"many"
"""Kinds of messages. A browser that opens the page gets `MANY`, the frames so far."""

MOST_BROWSERS = 8
"""Largest number of simultaneous browsers. Further browsers are refused.

The server sends each message to each browser. Half as many browsers would be enough for a single user, and twice as
many would make the view slow.
"""

PING_TIMEOUT = 10.0
"""A browser must answer a ping within this time [s]. A browser that does not read its data never answers.

With half this value, slow browsers that are loading a large world would be dropped. With double, browsers that do not
answer would be counted among `MOST_BROWSERS` for longer.
"""

MOST_UNREAD = 1_000_000
"""Number of unread bytes above which a browser gets no more frames. This limit corresponds to about a hundred frames.
With half this value, browsers would miss frames while loading the page. With double, browsers would lag more."""

MOST_FRAMES, MOST_BYTES = 3000, 24_000_000
"""Largest number of frames that are kept, and their largest size. The limit corresponds to 100 s in full detail. With
half these values, the start of a run would soon be coarse, and with double, a page would need a second to open."""

LONGEST_MESSAGE = 65_536
"""Largest size of a message of a browser [byte]. The longest ones are values that a user types."""

LOCAL_HOST_NAMES = ("127.0.0.1", "localhost", "[::1]")
"""Names that a browser may use for this machine."""


class Guarded(RequestHandler):
    """A handler that refuses requests for another host, and requests without the token."""

    def initialize(self, room: Room) -> None:
        """Take the state of the server."""
        self.room = room

    def prepare(self) -> None:
        """Check the request before answering."""
        if self.request.host.lower() not in [f"{name}:{self.room.port}" for name in LOCAL_HOST_NAMES]:
            raise HTTPError(403, "not a name of this machine")
        if not hmac.compare_digest(self.path_args[0].encode(), self.room.token.encode()):
            raise HTTPError(403, "not the token of this page")


class Page(Guarded):
    """Handler of requests for the page."""

    async def get(self, _token: str) -> None:
        """Send the page, as soon as the page is known. The page contains the rules for scripts."""
        headers = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store"}
        for name, value in {**headers, "Content-Security-Policy": "frame-ancestors 'none'"}.items():
            self.set_header(name, value)
        while not self.room.kept[PAGE]:
            await asyncio.sleep(0.01)
        self.finish(self.room.kept[PAGE])


class Browser(Guarded, WebSocketHandler):
    """Connection to a browser, which may end at any time. tornado refuses connections from pages of other hosts."""

    _unread, _reads, _pulls = 0, True, False

    def prepare(self) -> None:
        """Refuse the connection if there are enough browsers."""
        super().prepare()
        if len(self.room.browsers) >= MOST_BROWSERS:
            raise HTTPError(503, reason=f"{MOST_BROWSERS} browsers look on already: close one of them")

    def open(self, *_: str) -> None:
        """Send all that the browser needs."""
        self.room.browsers.add(self)
        for kind in (SCENE, WORLD, STATE):
            if kind in self.room.kept:
                self.send(kind, self.room.kept[kind])
        if self.room.frames:
            self.send(MANY, b"".join(self.room.frames))
        self._ask()

    def send(self, kind: bytes, content: bytes) -> None:
        """Send a message. Frames are left out while the browser has not read earlier frames."""
        if kind == FRAME and self._unread > MOST_UNREAD:
            return
        self._unread += len(content)
        try:
            sent = self.write_message(kind + content, binary=True)
        except WebSocketClosedError:
            self.on_close()
        else:
            sent.add_done_callback(functools.partial(self._sent, len(content)))

    def _sent(self, size: int, sent: Any) -> None:
        """Record the end of a transmission, and whether the browser reads.

        The end of a small transmission only shows that the buffers of the system had room. An error is ignored because
        the connection is then closed anyway.
        """
        self._reads |= self._unread > MOST_UNREAD
        self._unread -= size
        with suppress(Exception):
            sent.exception()

    def _ask(self) -> None:
        """Send a ping, and drop the browser if no answer comes."""
        self._reads = False
        with suppress(WebSocketClosedError):
            self.ping()
            IOLoop.current().call_later(PING_TIMEOUT, self._look)

    def _look(self) -> None:
        if self in self.room.browsers:
            self._ask() if self._reads else self._drop(f"it read nothing for {PING_TIMEOUT:g} s")

    def on_pong(self, data: bytes) -> None:
        """Record that the browser reads."""
        self._reads = True

    def on_message(self, message: str | bytes) -> None:
        """Hand on a message that is an object in JSON."""
        with suppress(ValueError, RecursionError):
            if isinstance(given := json.loads(message), dict):
                self._pulls = given.get("do") in ("grab", "pull") or (self._pulls and given.get("do") != "let_go")
                _say(f"heard={json.dumps(given)}")

    def on_close(self) -> None:
        """Remove the browser, and release a worm that the browser pulls."""
        self.room.browsers.discard(self)
        if self._pulls:
            self._pulls = False
            _say('heard={"do": "let_go"}')

    def _drop(self, why: str) -> None:
        """End the connection and print the reason, without a closing message, which would wait behind unread data."""
        self.on_close()
        _say(f"dropped=a browser was dropped: {why}")
        stream = getattr(self.ws_connection, "stream", None)
        if stream is not None:
            stream.close()


class Room:
    """State of the server: the messages so far, and the connected browsers."""

    def __init__(self) -> None:
        self.token, self.port = secrets.token_urlsafe(24), 0
        self.browsers: set[Browser] = set()
        self.kept: dict[bytes, bytes] = {PAGE: b""}
        self.frames: list[bytes] = []
        self.read, self.taken = 0, 0  # numbers of messages; each is counted by one thread

    def take(self, kind: bytes, content: bytes) -> None:
        """Keep a message and send the message to all browsers. Browsers may leave during the loop."""
        self.taken += 1
        if kind == FRAME:
            self.frames.append(content)
            if len(self.frames) > min(MOST_FRAMES, MOST_BYTES // len(content)):
                half = len(self.frames) // 2
                self.frames = self.frames[:half:2] + self.frames[half:]
        else:
            self.kept[kind] = content
        if kind == SCENE:
            self.frames = []
            self.kept.pop(WORLD, None)
        for browser in tuple(self.browsers) if kind != PAGE else ():
            browser.send(kind, content)


def main() -> None:
    """Run the server. The first line of output is the address of the page."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the other process, which then ends this one
    room, loop = Room(), IOLoop.current()
    routes = [(r"/([^/]+)/", Page, {"room": room}), (r"/([^/]+)/socket", Browser, {"room": room})]
    application = Application(routes, websocket_max_message_size=LONGEST_MESSAGE)
    server = HTTPServer(application, max_body_size=LONGEST_MESSAGE)
    sockets = bind_sockets(0, "127.0.0.1")
    room.port = sockets[0].getsockname()[1]
    server.add_sockets(sockets)
    threading.Thread(target=_listen, args=(room, loop), daemon=True).start()
    _say(f"url=http://127.0.0.1:{room.port}/{room.token}/")
    loop.start()


def _listen(room: Room, loop: IOLoop) -> None:
    """Read messages until the other process ends. A server that lags behind leaves out frames."""
    for kind, content in _messages(sys.stdin.buffer):
        if kind != FRAME or room.read - room.taken < 100:
            room.read += 1
            loop.add_callback(room.take, kind, content)
    loop.add_callback(loop.stop)


def _messages(source: BinaryIO) -> Iterator[tuple[bytes, bytes]]:
    while len(header := source.read(HEADER.size)) == HEADER.size:
        kind, size = HEADER.unpack(header)
        yield kind, source.read(size)


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
