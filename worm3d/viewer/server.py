"""meshcat's server as a process of its own: on this machine only, and not longer than whoever started it.

Started as it is, it listens on every network interface and survives its parent. Started here, by running this file,
it listens on 127.0.0.1 and stops when its standard input closes.
"""

from __future__ import annotations

import functools
import sys
import threading
import warnings
from typing import Any


def main() -> None:
    """Serve; print the addresses for commands and for the browser, a line each."""
    with warnings.catch_warnings():
        # It imports zmq.eventloop.ioloop, which warns of its age.
        warnings.simplefilter("ignore", DeprecationWarning)
        from meshcat.servers.zmqserver import ZMQWebSocketBridge

    class LocalBridge(ZMQWebSocketBridge):  # type: ignore[misc]  # meshcat has no types
        def make_app(self) -> Any:
            app = super().make_app()
            app.listen = functools.partial(app.listen, address="127.0.0.1")
            return app

    bridge = LocalBridge()
    threading.Thread(target=_stop_with_parent, args=(bridge.ioloop,), daemon=True).start()
    sys.stdout.write(f"zmq_url={bridge.zmq_url}\nweb_url={bridge.web_url}\n")
    sys.stdout.flush()
    bridge.run()


def _stop_with_parent(loop: Any) -> None:
    sys.stdin.buffer.read()
    loop.add_callback(loop.stop)


if __name__ == "__main__":
    main()
