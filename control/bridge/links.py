"""Links that carry packets: UDP, a serial line, and a link with delay, jitter and loss for simulated robots.

The address of a link is `udp://HOST:PORT`, or `serial:DEVICE` with the rate in bit/s behind an optional @, for example
`serial:/dev/ttyACM0@1000000`.
"""

from __future__ import annotations

import heapq
import os
import select
import socket
import sys
import time
from contextlib import suppress
from itertools import count
from typing import Any, Protocol

import numpy as np

from control.bridge.framing import Frames, framed
from control.bridge.packets import LARGEST

BAUD = 1_000_000
"""Default rate of a serial line [bit/s]. A worm of 6 segments needs 300 000 bit/s for 100 packets a second each way."""
ADDRESSES = "must be udp://HOST:PORT, such as udp://127.0.0.1:7001, or serial:DEVICE, such as serial:/dev/ttyACM0"
NEEDS_SERIAL = "serial: pyserial is not installed; pip install 'worm3d[bridge]'"

Received = list[tuple[bytes, Any]]
"""Packets, each with the address that it came from; None on a serial line."""


class Link(Protocol):
    """Carrier of packets. No method waits longer than it was told, and none raises an error while the line is cut."""

    peer: Any
    """Address that packets are sent to."""

    def send(self, data: bytes) -> bool:
        """Send a packet; return whether the line took it."""

    def receive(self, timeout: float) -> Received:
        """Return the packets that have arrived. Wait for the first one for at most `timeout` [s]."""

    def close(self) -> None:
        """Release the line."""


def opened(address: str, *, listen: bool = False) -> Link:
    """Open a link. With `listen`, a UDP link waits at the address, otherwise it sends to the address.

    Raises
    ------
    ValueError
        The address is not valid.
    OSError
        The port or device cannot be used.
    ImportError
        A serial line needs pyserial on this system.
    """
    scheme, _, place = address.partition(":")
    host, _, port = place.removeprefix("//").rpartition(":")
    if scheme == "udp" and host and port.isdigit() and int(port) < 65536:
        return Udp(host, int(port), listen=listen)
    device, _, baud = place.partition("@")
    if scheme == "serial" and device and (not baud or baud.isdigit()):
        return (
            Serial(device, int(baud or BAUD)) if sys.platform != "win32" else WindowsSerial(device, int(baud or BAUD))
        )
    raise ValueError(f"address: got {address!r}, {ADDRESSES}")


class Udp:
    """Packets as datagrams."""

    def __init__(self, host: str, port: int, *, listen: bool = False) -> None:
        family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind)
        self._socket.setblocking(False)
        self.peer: Any = None if listen else place
        if listen:
            self._socket.bind(place)
        self.port = int(self._socket.getsockname()[1]) if listen else port

    def send(self, data: bytes) -> bool:
        """Send a packet; return whether the line took it."""
        if self.peer is None:
            return False
        with suppress(OSError):  # the cable is out, or nobody listens there
            return self._socket.sendto(data, self.peer) == len(data)
        return False

    def receive(self, timeout: float) -> Received:
        """Return the packets that have arrived. Wait for the first one for at most `timeout` [s]."""
        select.select([self._socket], [], [], max(0.0, timeout))
        found: Received = []
        with suppress(OSError):
            while len(found) < 100:  # a flood must not keep the caller from its deadline
                found.append(self._socket.recvfrom(LARGEST))
        return found

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class Serial:
    """Packets as frames on a serial line, by the file of its device."""

    peer: Any = None

    def __init__(self, device: str, baud: int = BAUD) -> None:
        import termios
        import tty

        speed = getattr(termios, f"B{baud}", None)
        if speed is None:
            known = ", ".join(sorted((name[1:] for name in vars(termios) if name[1:].isdigit()), key=int))
            raise ValueError(f"serial: got a rate of {baud} bit/s, must be one of {known}")
        self._file = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        with suppress(termios.error):  # a pipe or socket has no rate
            tty.setraw(self._file)
            *flags, _, _, characters = termios.tcgetattr(self._file)
            termios.tcsetattr(self._file, termios.TCSANOW, [*flags, speed, speed, characters])
        self._frames = Frames()

    def send(self, data: bytes) -> bool:
        """Send a packet; return whether the line took it."""
        frame = framed(data)
        with suppress(OSError):  # a part of a frame is refused by its checksum
            return os.write(self._file, frame) == len(frame)
        return False

    def receive(self, timeout: float) -> Received:
        """Return the packets that have arrived. Wait for the first one for at most `timeout` [s]."""
        until, data = time.monotonic() + timeout, b""
        while not data and select.select([self._file], [], [], max(0.0, until - time.monotonic()))[0]:
            try:
                data = os.read(self._file, 16 * LARGEST)
            except OSError:  # the other end is gone: there is always something to read, an error
                time.sleep(max(0.0, until - time.monotonic()))
                break
        return [(packet, None) for packet in self._frames.feed(data)]

    def close(self) -> None:
        """Close the device."""
        os.close(self._file)


class WindowsSerial:
    """Packets as frames on a serial line, by pyserial."""

    peer: Any = None

    def __init__(self, device: str, baud: int = BAUD) -> None:
        try:
            import serial
        except ImportError as error:
            raise ImportError(NEEDS_SERIAL) from error
        self._port = serial.Serial(device, baud, timeout=0.0, write_timeout=0.0)
        self._frames = Frames()

    def send(self, data: bytes) -> bool:
        """Send a packet; return whether the line took it."""
        frame = framed(data)
        with suppress(OSError):  # also the errors of pyserial
            return bool(self._port.write(frame) == len(frame))
        return False

    def receive(self, timeout: float) -> Received:
        """Return the packets that have arrived. Wait for the first one for at most `timeout` [s]."""
        until, data = time.monotonic() + timeout, b""
        while True:
            with suppress(OSError):
                data = self._port.read(16 * LARGEST)
            if data or time.monotonic() >= until:
                return [(packet, None) for packet in self._frames.feed(data)]
            time.sleep(min(1e-3, max(0.0, until - time.monotonic())))

    def close(self) -> None:
        """Close the port."""
        self._port.close()


class Impaired:
    """A link with delay, jitter and loss in both directions.

    A packet is lost with the probability `loss`. Else it arrives after `delay` and a random time of up to `jitter` [s].
    """

    def __init__(self, link: Link, delay: float = 0.0, jitter: float = 0.0, loss: float = 0.0, seed: int = 0) -> None:
        self._link, self.delay, self.jitter, self.loss = link, delay, jitter, loss
        self._random, self._order = np.random.default_rng(seed), count()
        self._out: list[tuple[float, int, bytes]] = []
        self._in: list[tuple[float, int, tuple[bytes, Any]]] = []

    @property
    def peer(self) -> Any:
        """Address that packets are sent to."""
        return self._link.peer

    @peer.setter
    def peer(self, address: Any) -> None:
        self._link.peer = address

    def _due(self) -> float | None:
        """Return when a packet arrives that leaves now, or None if it is lost."""
        lost = self._random.uniform() < self.loss
        due = time.monotonic() + self.delay + self.jitter * self._random.uniform()
        return None if lost else due

    def send(self, data: bytes) -> bool:
        """Send a packet later, if it is not lost."""
        if (due := self._due()) is not None:
            heapq.heappush(self._out, (due, next(self._order), data))
        self._pass(time.monotonic())
        return True

    def _pass(self, now: float) -> None:
        while self._out and self._out[0][0] <= now:
            self._link.send(heapq.heappop(self._out)[2])

    def receive(self, timeout: float) -> Received:
        """Return the packets that have arrived. Wait for the first one for at most `timeout` [s]."""
        until = time.monotonic() + timeout
        found: Received = []
        while True:
            wake = min([until, *(queue[0][0] for queue in (self._in, self._out) if queue)])
            for packet in self._link.receive(wake - time.monotonic()):
                if (due := self._due()) is not None:
                    heapq.heappush(self._in, (due, next(self._order), packet))
            now = time.monotonic()
            self._pass(now)
            while self._in and self._in[0][0] <= now:
                found.append(heapq.heappop(self._in)[2])
            if found or now >= until:
                return found

    def close(self) -> None:
        """Release the line."""
        self._link.close()
