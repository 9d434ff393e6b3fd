"""Frames on a serial line: consistent overhead byte stuffing (COBS).

A packet of any bytes becomes a frame without zeros, and a zero ends the frame. A receiver that joins in the middle, or
lost bytes, therefore finds the next packet at the next zero. Source: S. Cheshire, M. Baker, Consistent Overhead Byte
Stuffing, IEEE/ACM Transactions on Networking 7 (1999) 159-172.
"""

from __future__ import annotations

from control.bridge.packets import LARGEST

BLOCK = 254
"""Largest number of bytes that follow one length byte."""


def framed(data: bytes) -> bytes:
    """Return the frame of a packet, with the zero at its end."""
    out = bytearray()
    for part in data.split(b"\0"):
        whole, rest = divmod(len(part), BLOCK)
        for k in range(whole):
            out += b"\xff" + part[BLOCK * k : BLOCK * (k + 1)]
        out += bytes([rest + 1]) + part[BLOCK * whole :]
    return bytes(out) + b"\0"


def unframed(frame: bytes) -> bytes:
    """Return the packet of a frame without its zero; the empty text of bytes if the frame is damaged."""
    out, k = bytearray(), 0
    while k < len(frame):
        count = frame[k]
        if count == 0 or k + count > len(frame):
            return b""
        out += frame[k + 1 : k + count]
        k += count
        if count <= BLOCK and k < len(frame):
            out.append(0)
    return bytes(out)


class Frames:
    """Packets from the bytes of a serial line."""

    def __init__(self) -> None:
        self._begun = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Return the packets that are complete after some more bytes. Damaged frames are returned as they came."""
        self._begun += data
        *whole, rest = self._begun.split(b"\0")
        self._begun = rest[-2 * LARGEST :]
        return [unframed(bytes(frame)) or bytes(frame) for frame in whole if frame]
