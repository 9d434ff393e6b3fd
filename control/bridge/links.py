"""Links that carry packets: UDP, a serial line, and a link with delay, jitter and loss for simulated robots.

On a serial line, a receiver recognises the next packet by the first bytes, the length and the checksum.
"""

from __future__ import annotations

import heapq
import os
import select
import socket
import time
from contextlib import suppress
from typing import Any, Protocol

import numpy as np

from control.bridge.packets import LARGEST, next_packet

BAUD = 1_000_000
"""Default rate of a serial line [bit/s]. A worm of 6 segments needs 300 000 bit/s for 100 packets a second each way."""
ADDRESSES = "must be udp://HOST:PORT, such as udp://127.0.0.1:7001, or serial:DEVICE, such as serial:/dev/ttyACM0"

Received = list[tuple[bytes, Any]]
"""Packets, each with the address of the sender; None on a serial line."""


class Link(Protocol):
    """Carrier of packets. The methods raise no error while the line is cut."""

    peer: Any
    """Address that packets are sent to."""

    def send(self, data: bytes) -> None:
        """Send a packet, unless the line is busy."""

    def receive(self, timeout: float) -> Received:
        """Return the packets that have arrived. Wait for the first packet for at most `timeout` [s]."""

    def close(self) -> None:
        """Release the line."""


def opened(address: str, *, listen: bool = False) -> Link:
    """Open a link. With `listen`, a UDP link waits at the address, and otherwise sends to the address.

    `address` is "udp://HOST:PORT", or "serial:DEVICE" with the rate in bit/s behind an optional @, for example
    "serial:/dev/ttyACM0@1000000".

    Raises
    ------
    ValueError
        The address or the rate is not valid.
    OSError
        The port or device cannot be used.
    """
    scheme, _, place = address.partition(":")
    host, _, port = place.removeprefix("//").rpartition(":")
    if scheme == "udp" and host and port.isdigit() and int(port) < 65536:
        return Udp(host, int(port), listen=listen)
    device, _, baud = place.partition("@")
    if scheme == "serial" and device and (not baud or baud.isdigit()):
        return Serial(device, int(baud or BAUD))
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

    def send(self, data: bytes) -> None:
        """Send a packet to the peer, if the peer is known."""
        if self.peer is not None:
            with suppress(OSError):  # the cable is out, or nobody listens there
                self._socket.sendto(data, self.peer)

    def receive(self, timeout: float) -> Received:
        """Return the packets that have arrived. Wait for the first packet for at most `timeout` [s]."""
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
    """Packets on a serial line of a POSIX system, by the file of its device."""

    peer: Any = None

    def __init__(self, device: str, baud: int = BAUD) -> None:
        try:
            import termios
            import tty
        except ImportError as error:
            raise ValueError("serial: this system has no serial lines as files; take udp://HOST:PORT") from error
        speed = getattr(termios, f"B{baud}", None)
        if speed is None:
            known = ", ".join(sorted((name[1:] for name in vars(termios) if name[1:].isdigit()), key=int))
            raise ValueError(f"serial: got a rate of {baud} bit/s, must be one of {known}")
        self._file = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        with suppress(termios.error):  # a pipe has no rate
            tty.setraw(self._file)
            *flags, _, _, characters = termios.tcgetattr(self._file)
            termios.tcsetattr(self._file, termios.TCSANOW, [*flags, speed, speed, characters])
        self._begun = b""

    def send(self, data: bytes) -> None:
        """Send a packet, unless the line is busy. The receiver refuses a part of a packet by the checksum."""
        with suppress(OSError):
            os.write(self._file, data)

    def receive(self, timeout: float) -> Received:
        """Return the packets that have arrived. Wait for the first packet for at most `timeout` [s]."""
        until = time.monotonic() + timeout
        found: Received = []
        while not found and select.select([self._file], [], [], max(0.0, until - time.monotonic()))[0]:
            data = b""
            with suppress(OSError):
                data = os.read(self._file, LARGEST)
            if not data:  # the other end is gone, which can be read all the time
                time.sleep(max(0.0, until - time.monotonic()))
                break
            packet, self._begun = next_packet(self._begun + data)
            while packet:
                found.append((packet, None))
                packet, self._begun = next_packet(self._begun)
        return found

    def close(self) -> None:
        """Close the device."""
        os.close(self._file)


class Impaired:
    """A link with delay, jitter and loss in both directions.

    A packet is lost with the probability `loss`, or arrives after `delay` and a random time of up to `jitter` [s].
    """

    def __init__(self, link: Link, delay: float = 0.0, jitter: float = 0.0, loss: float = 0.0, seed: int = 0) -> None:
        self._link, self._delay, self._jitter, self._loss = link, delay, jitter, loss
        self._random = np.random.default_rng(seed)
        self._out: list[tuple[float, float, bytes]] = []
        self._in: list[tuple[float, float, tuple[bytes, Any]]] = []
        self.peer: Any = None

    def _late(self, queue: list[Any], packet: Any) -> None:
        late, order, lost = self._random.uniform(size=3)
        if lost >= self._loss:
            heapq.heappush(queue, (time.monotonic() + self._delay + self._jitter * late, order, packet))

    def send(self, data: bytes) -> None:
        """Send a packet later, or lose the packet."""
        self._late(self._out, data)

    def receive(self, timeout: float) -> Received:
        """Return the packets that have arrived. Wait for the first packet for at most `timeout` [s]."""
        until = time.monotonic() + timeout
        found: Received = []
        while True:
            wake = min([until, *(queue[0][0] for queue in (self._in, self._out) if queue)])
            for packet in self._link.receive(wake - time.monotonic()):
                self._late(self._in, packet)
            now, self._link.peer = time.monotonic(), self.peer
            while self._out and self._out[0][0] <= now:
                self._link.send(heapq.heappop(self._out)[2])
            while self._in and self._in[0][0] <= now:
                found.append(heapq.heappop(self._in)[2])
            if found or now >= until:
                return found

    def close(self) -> None:
        """Release the line."""
        self._link.close()
