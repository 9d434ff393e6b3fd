"""The live view: closed properly, never hanging, on this machine only; and the notebook."""

import asyncio
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tornado.websocket import websocket_connect

from worm3d.viewer import Frames, html, live
from worm3d.viewer.live import LiveView, Server
from worm3d.viewer.pieces import Scales, contact, worm
from worm3d.viewer.server import MOST_BROWSERS
from worm3d.viewer.stream import Stream


@pytest.fixture(scope="module")
def window() -> Iterator[LiveView]:
    with LiveView() as view:
        yield view


def show(view: LiveView, frames: Frames, index: int) -> None:
    view.show(frames.take([index]))


def listens(url: str) -> bool:
    host, port = url.split("/")[2].split(":")
    with socket.socket() as probe:
        return probe.connect_ex((host, int(port))) == 0


def test_it_shows_the_worm_and_leaves_nothing_behind(short: Frames) -> None:
    with LiveView(short.world) as view:
        url = view.url
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{32}/", url)
        with urllib.request.urlopen(url, timeout=5) as answer:
            assert b"MeshCat" in answer.read()
        for index in range(5):
            show(view, short, index)
        with pytest.raises(ValueError, match="got a worm with other parts than at the start: open a new view"):
            view.show(replace(short, face_radius=np.array([0.05, 0.05])))
        view.begin()
        view.show(replace(short, face_radius=np.array([0.05, 0.05])))
    assert not listens(url)
    view.close()
    with pytest.raises(ConnectionError, match="the live view is closed: open a new one"):
        show(view, short, 0)


def test_it_listens_on_this_machine_only(short: Frames) -> None:
    with LiveView() as view:
        outside = _own_address()
        if outside is None:
            pytest.skip("this machine has no other address than 127.0.0.1")
        assert listens(view.url)
        assert not listens(view.url.replace("127.0.0.1", outside))


def _own_address() -> str | None:
    """Return an address of this machine that others can see; nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            return None
        address = str(probe.getsockname()[0])
    return None if address.startswith("127.") else address


def shake_hands(view: LiveView, *headers: str, path: str = "") -> tuple[socket.socket, str]:
    """Ask for a browser's connection, and return it with the first line of the answer."""
    host, port = view.url.split("/")[2].split(":")
    connection = socket.create_connection((host, int(port)), timeout=10)
    line = f"GET {path or urlsplit(view.url).path + 'socket'} HTTP/1.1"
    lines = (line, "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13")
    key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="
    connection.sendall("\r\n".join([*lines, key, *headers, "", ""]).replace("PORT", port).encode())
    return connection, connection.recv(4096).decode("latin-1").splitlines()[0]


@pytest.mark.parametrize("at_once", [True, False])
def test_browsers_that_go_away_do_not_end_it(short: Frames, at_once: bool) -> None:
    with LiveView(short.world) as view:
        show(view, short, 0)
        for _ in range(10):
            browser, answer = shake_hands(view, "Host: 127.0.0.1:PORT")
            assert "101" in answer
            browser.sendall(b"\x81\x80\0\0\0\0")  # a message, empty
            browser.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # closing resets it
            if at_once:
                browser.close()
            for index in range(5):
                show(view, short, index)
            browser.close()
        show(view, short, 5)
        assert listens(view.url)


@pytest.mark.parametrize(
    ("headers", "answer"),
    [
        (("Host: 127.0.0.1:PORT",), "101"),
        (("Host: LOCALHOST:PORT", "Origin: http://localhost:PORT"), "101"),
        (("Host: [::1]:PORT",), "101"),
        (("Host: rebound.example:PORT", "Origin: http://rebound.example:PORT"), "403"),
        (("Host: 127.0.0.1:1",), "403"),
        (("Host: 127.0.0.1",), "403"),
        (("Host: 127.0.0.1:PORT", "Origin: http://elsewhere.example"), "403"),
        (("Host: 127.0.0.1:PORT", "Origin: http://localhost:1"), "403"),
    ],
)
def test_it_answers_by_the_names_of_this_machine_only(window: LiveView, headers: tuple[str, ...], answer: str) -> None:
    connection, line = shake_hands(window, *headers)
    connection.close()
    assert answer in line
    port = window.url.split(":")[2].split("/")[0]
    host = headers[0].removeprefix("Host: ").replace("PORT", port)
    request = urllib.request.Request(window.url, headers={"Host": host})
    if headers[0].endswith(":PORT") and "rebound" not in host:
        with urllib.request.urlopen(request, timeout=10) as page:
            policy = page.headers["Content-Security-Policy"]
            text = page.read().decode()
        assert policy == "frame-ancestors 'none'"
        assert """content="default-src 'none'; base-uri 'none'; form-action 'none'; script-src 'sha256-""" in text
        assert "connect-src 'self'\"" in text
    else:
        with pytest.raises(urllib.error.HTTPError, match="403") as refused:
            urllib.request.urlopen(request, timeout=10)
        refused.value.close()


def test_a_server_that_dies_is_told(short: Frames) -> None:
    with LiveView() as view:
        show(view, short, 0)
        view._server._process.kill()
        view._server._process.wait()
        with pytest.raises(ConnectionError, match="server has stopped: open a new view"):
            show(view, short, 1)


def test_the_server_does_not_survive_its_parent(tmp_path: Path) -> None:
    script = "import time; from worm3d.viewer.live import LiveView; print(LiveView().url, flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        url = parent.stdout.readline().strip()
        assert listens(url)
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
    deadline = time.monotonic() + 60.0
    while listens(url) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not listens(url)


def test_the_notebook_shows_the_page_without_a_server(short: Frames) -> None:
    view = html.NotebookView(html.html(short), height=300)
    cell = view._repr_html_()
    source = re.search(r'srcdoc="([^"]*)"', cell)
    assert source is not None
    assert unescape(source[1]) == view.page
    assert "height: 300px" in cell
    assert len(repr(view)) < 100


@pytest.mark.parametrize("module", ["", ".html", ".world", ".frames", ".pieces"])
def test_imports_are_cheap(module: str) -> None:
    heavy = "meshcat IPython matplotlib trimesh scipy zmq tornado PIL"
    script = (
        "import sys, worm3d; before = set(sys.modules)\n"
        f"import worm3d.viewer{module}; new = set(sys.modules) - before; "
        f"print([name for name in {heavy!r}.split() if name in new])"
    )
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"


def test_a_large_request_is_refused_before_it_is_read(window: LiveView) -> None:
    host, port = window.url.split("/")[2].split(":")
    with socket.create_connection((host, int(port)), timeout=10) as connection:
        connection.sendall(f"POST / HTTP/1.1\r\nHost: {host}:{port}\r\nContent-Length: 10000000\r\n\r\n".encode())
        assert b"400" in connection.recv(4096).splitlines()[0]


@pytest.mark.parametrize("token", ["", "static", "%00", "x" * 32, "%2e%2e/%2e%2e"])
def test_without_the_token_nothing_is_served(window: LiveView, token: str) -> None:
    """Neither the page nor a connection, also with a part of the token."""
    base, right = window.url.rsplit("/", 2)[:2]
    for name in {token, right[:-1], right + "x"}:
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(f"{base}/{name}/", timeout=5)
        refused.value.close()
        assert refused.value.code in (403, 404), name
        connection, line = shake_hands(window, "Host: 127.0.0.1:PORT", path=f"/{name}/socket")
        connection.close()
        assert "403" in line or "404" in line, line


def _looking_on(url: str) -> tuple[socket.socket, bytes]:
    """Return a browser's connection that never reads what it is sent, and the first line of the answer."""
    host, port = url.split("/")[2].split(":")
    browser = socket.create_connection((host, int(port)), timeout=10.0)
    lines = (f"GET {urlsplit(url).path}socket HTTP/1.1", f"Host: {host}:{port}")
    lines += ("Upgrade: websocket", "Connection: Upgrade")
    lines += ("Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "", "")
    browser.sendall("\r\n".join(lines).encode())
    return browser, browser.recv(12)


@pytest.mark.slow
def test_browsers_that_never_read_do_not_slow_the_view(short: Frames, caplog: pytest.LogCaptureFixture) -> None:
    with LiveView() as view:
        show(view, short, 0)
        alone = _time_of(view, short, 20)
        found = [_looking_on(view.url) for _ in range(100)]
        answers = [answer for _, answer in found]
        assert answers.count(b"HTTP/1.1 101") == MOST_BROWSERS
        assert answers.count(b"HTTP/1.1 503") == 100 - MOST_BROWSERS
        _time_of(view, short, 20)
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline and caplog.text.count("a browser was dropped") < MOST_BROWSERS:
            show(view, short, 1)
            time.sleep(0.2)
        assert caplog.text.count("a browser was dropped: it read nothing for 10 s") == MOST_BROWSERS
        assert _time_of(view, short, 20) < 5.0 * alone + 1.0
        browser, answer = _looking_on(view.url)
        assert answer == b"HTTP/1.1 101", "there is room again"
        for each, _ in (*found, (browser, answer)):
            each.close()


def test_rows_of_a_stream_have_the_poses_of_the_pieces(short: Frames) -> None:
    scales = Scales.of(short)
    stream = Stream(short.take([0]), scales, {})
    frames = short.take([len(short) - 1])
    row = np.frombuffer(stream.row(frames, {}), "<f4")

    def field(name: str, width: int) -> np.ndarray:
        first, size = stream.fields[name]
        return row[first : first + size].reshape(-1, width)

    moving = [*worm(frames, scales), *contact(frames, scales)]
    for layer in {"links", "chambers"} | {part.layer for part in moving}:
        parts = [part for part in moving if part.layer == layer]
        for name, width in (("position", 3), ("scale", 3), ("tint", 3)):
            given = [getattr(part, name) for part in parts]
            if given[0] is not None:
                np.testing.assert_allclose(field(f"{layer}.{name}", width), np.concatenate(given), atol=1e-6)
        if parts[0].turn is not None:
            turns = Rotation.from_quat(field(f"{layer}.quaternion", 4)).as_matrix()
            np.testing.assert_allclose(turns, np.concatenate([part.turn for part in parts]), atol=1e-6)


def test_a_worm_is_let_go_when_the_browser_that_pulls_it_goes_away(short: Frames) -> None:
    """And not when another one does."""

    async def browse(url: str) -> None:
        puller, other = [await websocket_connect(f"ws{url.removeprefix('http')}socket") for _ in range(2)]
        await puller.write_message(json.dumps({"do": "grab", "value": [0.0, 0.0, 0.0]}))
        await asyncio.sleep(0.1)
        other.close()
        await asyncio.sleep(0.3)
        heard.append([each["do"] for each in view.heard(0.0)])
        puller.close()
        await asyncio.sleep(0.3)
        heard.append([each["do"] for each in view.heard(0.0)])

    heard: list[list[str]] = []
    with LiveView() as view:
        show(view, short, 0)
        asyncio.run(browse(view.url))
    assert heard == [["grab"], ["let_go"]]


def _time_of(view: LiveView, frames: Frames, count: int) -> float:
    began = time.perf_counter()
    for k in range(count):
        show(view, frames, k % 5)
    return time.perf_counter() - began


def test_a_server_that_is_only_slow_is_told_from_one_that_does_not_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    slow, broken, silent = (tmp_path / f"{name}.py" for name in ("slow", "broken", "silent"))
    slow.write_text("import sys\nsys.stdin.read()\n")
    broken.write_text("import this_is_not_there\n")
    silent.write_text("import os, sys\nos.close(1)\nos.close(2)\nsys.stdin.read()\n")
    monkeypatch.setattr(live, "SERVER", slow)
    with pytest.raises(
        ConnectionError, match=r"has not answered for 0\.5 s, the machine is too busy: try again later$"
    ):
        Server(timeout=0.5)
    monkeypatch.setattr(live, "SERVER", broken)
    with pytest.raises(
        ConnectionError, match=r"did not start: ModuleNotFoundError: No module named .this_is_not_there.$"
    ):
        Server()
    monkeypatch.setattr(live, "SERVER", silent)
    with pytest.raises(ConnectionError, match=r"did not start: it said nothing$"):
        Server()
