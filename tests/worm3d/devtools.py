"""A headless Chromium by its DevTools protocol: pages are opened, clicked on, typed at and looked at.

It speaks over a pipe (--remote-debugging-pipe): no port, no library. Input goes in as the browser's own events, so that
focus, capture and default actions are those of a user.
"""

from __future__ import annotations

import base64
import fcntl
import io
import json
import os
import select
import shutil
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--disable-dev-shm-usage", "--hide-scrollbars"),
    # The network is off: no name is found, and what goes out goes to a port where nobody is; the live view is here.
    *("--proxy-server=127.0.0.1:9", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost"),
)
WIDE, HIGH = 900, 600
PATIENCE = 60.0
"""How long an answer may take [s]; a page is there within one or two."""

KEYS = {
    " ": ("Space", 32),
    "Tab": ("Tab", 9),
    "Home": ("Home", 36),
    "Escape": ("Escape", 27),
    "End": ("End", 35),
    ".": ("Period", 190),
} | {name: (name, code) for code, name in enumerate(("ArrowLeft", "ArrowUp", "ArrowRight", "ArrowDown"), start=37)}
"""Code and number of keys."""

Picture = NDArray[np.int64]
"""Red, green, blue of every pixel, shape (high, wide, 3)."""


def program() -> str | None:
    """Return a browser of this machine."""
    return next((found for name in PROGRAMS if (found := shutil.which(name))), None)


class Chromium:
    """A browser with one page; use it in a `with` statement."""

    def __init__(self, program: str, home: Path, *, size: tuple[int, int] = (WIDE, HIGH), scale: float = 1.0) -> None:
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        # Out of the way of 3 and 4, where the browser expects them.
        away = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (theirs_in, theirs_out)]
        actions = [
            *((os.POSIX_SPAWN_DUP2, end, number) for number, end in enumerate(away, start=3)),
            *((os.POSIX_SPAWN_OPEN, number, os.devnull, os.O_WRONLY, 0) for number in (1, 2)),
        ]
        command = [program, *FLAGS, f"--user-data-dir={home}", "--remote-debugging-pipe", "about:blank"]
        self._process = os.posix_spawn(program, command, os.environ, file_actions=actions, setsid=True)
        for end in (theirs_in, theirs_out, *away):
            os.close(end)
        self._heard, self._last = b"", 0
        self.errors: list[str] = []
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.ask(f"{domain}.enable")
        self.ask(
            "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=scale, mobile=False
        )

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call a method of the protocol for the page, and return the answer."""
        return self._ask(method, self._session, **parameters)

    def _ask(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        self._last += 1
        message = {"id": self._last, "method": method, "params": parameters} | (
            {"sessionId": session} if session else {}
        )
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self._out, data) :]
        while True:
            answer = self._message()
            if answer.get("id") == self._last:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return dict(answer["result"])
            self._note(answer)

    def _message(self) -> dict[str, Any]:
        deadline = time.monotonic() + PATIENCE
        while b"\0" not in self._heard:
            ready, _, _ = select.select([self._in], [], [], max(deadline - time.monotonic(), 0.0))
            data = os.read(self._in, 1 << 20) if ready else b""
            assert data, "the browser has gone, or does not answer"
            self._heard += data
        message, self._heard = self._heard.split(b"\0", 1)
        return dict(json.loads(message))

    def _note(self, event: dict[str, Any]) -> None:
        """Keep what the page complains of."""
        details = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            thrown = details["exceptionDetails"]
            self.errors.append(thrown.get("exception", {}).get("description") or thrown["text"])
        elif event.get("method") == "Runtime.consoleAPICalled" and details["type"] in ("error", "warning"):
            self.errors.append(" ".join(str(part.get("value")) for part in details["args"]))
        elif event.get("method") == "Log.entryAdded" and details["entry"]["level"] == "error":
            self.errors.append(details["entry"]["text"])

    def open(self, page: Path | str, state: str = "") -> None:
        """Open a file or an address afresh, and wait until the viewer is ready."""
        self.ask("Page.navigate", url="about:blank")
        self.errors.clear()
        self.ask("Page.navigate", url=(page.as_uri() if isinstance(page, Path) else page) + f"#{state}")
        deadline = time.monotonic() + PATIENCE
        while self.value("document.documentElement?.dataset.state || ''") not in ("ready", "failed"):
            assert time.monotonic() < deadline, "the page does not get ready"
            time.sleep(0.02)
        self.settle()

    def go(self, state: str) -> None:
        """Give the page that is open another state, and wait until it has it."""
        there = json.dumps(f"#{state}")
        self.value(
            f"location.hash === {there} || new Promise(done => {{"
            f" addEventListener('hashchange', () => done(0), {{ once: true }}); location.hash = {there}; }})"
        )
        self.settle()

    def value(self, expression: str) -> Any:
        """Return the value of a JavaScript expression, a promise's when it is kept."""
        answer = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def settle(self) -> None:
        """Wait until what has been asked for is drawn."""
        self.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))")

    def picture(self) -> Picture:
        """Return what is seen."""
        self.settle()
        with Image.open(io.BytesIO(self.png())) as image:
            return np.asarray(image.convert("RGB"), dtype=np.int64)

    def png(self) -> bytes:
        """Return what is seen, as a file."""
        return base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"])

    def place_of(self, selector: str) -> tuple[float, float]:
        """Return the middle of an element; it has to be there and seen."""
        rectangle = f"document.querySelector({json.dumps(selector)}).getBoundingClientRect().toJSON()"
        box = self.value(rectangle)
        assert min(box["width"], box["height"]) > 0, f"{selector} is not seen"
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def click(self, selector: str) -> None:
        """Click on the middle of an element with the mouse."""
        self.drag(self.place_of(selector), self.place_of(selector), steps=0)

    def drag(
        self,
        start: tuple[float, float],
        end: tuple[float, float],
        *,
        steps: int = 12,
        ctrl: bool = False,
        held: Callable[[], None] | None = None,
    ) -> None:
        """Press the left button at one place of the window, and let it go at another [pixels].

        `held` is called before the button is let go.
        """
        self._mouse("mouseMoved", start, "none", ctrl)
        self._mouse("mousePressed", start, "left", ctrl)
        for k in range(1, steps + 1):
            share = k / steps
            place = tuple((1 - share) * a + share * b for a, b in zip(start, end, strict=True))
            self._mouse("mouseMoved", place, "left", ctrl)
        if held is not None:
            held()
        self._mouse("mouseReleased", end, "left", ctrl)
        self.settle()

    def _mouse(self, kind: str, place: tuple[float, ...], button: str, ctrl: bool = False) -> None:
        held = int(button == "left" and kind != "mouseReleased")
        self.ask(
            "Input.dispatchMouseEvent",
            type=kind,
            x=place[0],
            y=place[1],
            button=button,
            buttons=held,
            clickCount=1,
            modifiers=2 * int(ctrl),
        )

    def press(self, key: str, *, alt: bool = False) -> None:
        """Press a key and let it go."""
        code, number = KEYS[key]
        event = {"key": key, "code": code, "windowsVirtualKeyCode": number, "modifiers": int(alt)}
        self.ask("Input.dispatchKeyEvent", type="keyDown", **event, **({"text": key} if len(key) == 1 else {}))
        self.ask("Input.dispatchKeyEvent", type="keyUp", **event)
        self.settle()

    def close(self) -> None:
        """End the browser and all its processes."""
        os.close(self._out)
        os.close(self._in)
        with suppress(ProcessLookupError):
            os.killpg(self._process, signal.SIGKILL)
        os.waitpid(self._process, 0)

    def __enter__(self) -> Chromium:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
