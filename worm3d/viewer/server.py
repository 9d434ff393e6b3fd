"""Program of a meshcat server that serves only this machine, and stops with the process that started it.

The unmodified server of meshcat has several faults. It listens on every network interface, and goes on when its parent
process has ended. It answers requests for any host name, so that a page of another host could see the view if its name
is resolved to 127.0.0.1. It stops answering when a browser disconnects during a transmission, and it stores unread data
without limit. The server in this file has none of these faults.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
import threading
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

from tornado.web import Application, HTTPError
from tornado.websocket import WebSocketClosedError

with warnings.catch_warnings():
    # meshcat imports zmq.eventloop.ioloop, which is deprecated and warns.
    warnings.simplefilter("ignore", DeprecationWarning)
    from meshcat.servers import zmqserver

MOST_BROWSERS = 8
"""Largest number of simultaneous browsers. Further browsers are refused.

The server sends each command to each browser. Half as many browsers would be enough for a single user, and twice as
many would make the view slow.
"""

PING_TIMEOUT = 10.0
"""A browser must answer a ping within this time [s]. A browser that does not read its data never answers.

With half this value, slow browsers that are loading a large world would be dropped. With double, browsers that do not
answer would be counted among `MOST_BROWSERS` for longer.
"""

MOST_UNREAD = 32_000_000
"""Largest number of unread bytes, in addition to the first scene. A browser with more is dropped. This limit
corresponds to about a thousand pictures. Half would be enough, and double would waste memory.
"""

LOCAL_HOST_NAMES = ("127.0.0.1", "localhost", "[::1]")
"""Names that a browser may use for this machine."""


class Local:
    """Mixin for handlers. It refuses requests whose host is not a name of this machine."""

    request: Any
    application: Any

    def prepare(self) -> None:
        """Check the request before answering."""
        if self.request.host.lower() not in hosts(self.application.bridge.fileserver_port):
            raise HTTPError(403, "not a name of this machine")


class Files(Local, zmqserver.StaticFileHandlerNoCache):  # type: ignore[misc]  # meshcat has no types
    """Handler of requests for meshcat's page and scripts."""

    def validate_absolute_path(self, root: str, absolute_path: str) -> str | None:
        """Return the path of a file. A path with a null character, which no file can have, is refused as missing."""
        if "\0" in absolute_path:
            raise HTTPError(404)
        found: str | None = super().validate_absolute_path(root, absolute_path)
        return found

    def set_extra_headers(self, path: str) -> None:
        """Add the headers with rules that a browser enforces."""
        super().set_extra_headers(path)
        self.set_header("Content-Security-Policy", _policy(self.application.bridge.fileserver_port))
        self.set_header("X-Content-Type-Options", "nosniff")


class Browser(Local, zmqserver.WebSocketHandler):  # type: ignore[misc]
    """Connection to a browser, which may end at any time. tornado refuses connections from pages of other hosts."""

    _unread, _most, _reads = 0, float("inf"), True

    def prepare(self) -> None:
        """Refuse the connection if there are enough browsers."""
        super().prepare()
        if len(self.bridge.websocket_pool) >= MOST_BROWSERS:
            raise HTTPError(503, reason=f"{MOST_BROWSERS} browsers look on already: close one of them")

    def open(self) -> None:
        """Send the scene. Its size does not count towards `MOST_UNREAD`."""
        super().open()
        self._most = self._unread + MOST_UNREAD
        self._ask()

    def _ask(self) -> None:
        """Send a ping, and drop the browser if no answer comes."""
        self._reads = False
        with suppress(WebSocketClosedError):
            self.ping()
            self.bridge.ioloop.call_later(PING_TIMEOUT, self._look)

    def _look(self) -> None:
        if self in self.bridge.websocket_pool:
            self._ask() if self._reads else self._drop(f"it read nothing for {PING_TIMEOUT:g} s")

    def on_pong(self, data: bytes) -> None:
        """Record that the browser reads."""
        self._reads = True

    def on_message(self, message: object) -> None:
        """Ignore a message of the browser. meshcat would take a picture in it for the answer to a request."""

    def on_close(self) -> None:
        """Remove the browser from the pool."""
        self.bridge.websocket_pool.discard(self)

    def write_message(self, *arguments: Any, **options: Any) -> None:
        """Send a message if the browser still reads."""
        if self._unread > self._most:
            self._drop(f"it left {self._unread / 1e6:.3g} MB unread")
            return
        size = len(arguments[0])
        self._unread += size
        try:
            super().write_message(*arguments, **options).add_done_callback(functools.partial(self._sent, size))
        except WebSocketClosedError:
            self.on_close()

    def _sent(self, size: int, sent: Any) -> None:
        """Record the end of a transmission. An error is ignored because the connection is then closed anyway."""
        self._unread, self._reads = self._unread - size, True
        with suppress(Exception):
            sent.exception()

    def _drop(self, why: str) -> None:
        """End the connection and print the reason, without a closing message, which would wait behind unread data."""
        self.on_close()
        _say(f"dropped=a browser was dropped: {why}")
        self.ws_connection.stream.close()


class LocalBridge(zmqserver.ZMQWebSocketBridge):  # type: ignore[misc]
    """meshcat's server with these handlers, listening on 127.0.0.1."""

    def make_app(self) -> Any:
        """Return the application."""
        files = {"path": zmqserver.VIEWER_ROOT, "default_filename": zmqserver.VIEWER_HTML}
        app: Any = Application([(r"/static/(.*)", Files, files), (r"/", Browser, {"bridge": self})])
        app.bridge, app.listen = self, functools.partial(app.listen, address="127.0.0.1")
        return app

    def forward_to_websockets(self, frames: list[bytes]) -> None:
        """Send a command to all browsers. Browsers may leave during the loop."""
        for browser in tuple(self.websocket_pool):
            browser.write_message(frames[2], binary=True)


def main() -> None:
    """Run the server. The first lines of output are the addresses for commands and for browsers."""
    bridge = LocalBridge()
    threading.Thread(target=_stop_with_parent, args=(bridge.ioloop,), daemon=True).start()
    _say(f"zmq_url={bridge.zmq_url}\nweb_url={bridge.web_url}")
    bridge.run()


def hosts(port: int) -> list[str]:
    """Return the hosts that a browser on this machine may request."""
    return [f"{name}:{port}" for name in LOCAL_HOST_NAMES]


@functools.cache
def _policy(port: int) -> str:
    page = Path(zmqserver.VIEWER_ROOT, zmqserver.VIEWER_HTML).read_text("utf-8")
    found: str = _beside("policy").of_server(page, hosts(port))
    return found


def _beside(name: str) -> Any:
    """Import a module next to this file without the package, which would import the simulator."""
    specification = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _stop_with_parent(loop: Any) -> None:
    sys.stdin.buffer.read()
    loop.add_callback(loop.stop)


if __name__ == "__main__":
    main()
