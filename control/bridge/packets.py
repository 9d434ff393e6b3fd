"""Packets between a controller and a robot, version 1.

A packet is a datagram of UDP, or a piece of the bytes of a serial line. All numbers are little-endian:

    header   magic "WORM", version u8, kind u8, flags u16, segments N u16, parts u16, session u32, number u32,
             time u64, echo u64, echo received u64, taken u64                                             (52 bytes)
    parts    float32 numbers of each part whose bit is set in the field `parts`, in the order of `PARTS`
    check    CRC-32 of all bytes before, u32

Times are in microseconds of the sender's clock, which never runs backwards: `time` when the packet was sent, `taken`
when its samples were taken. `echo` is the `time` of the latest valid packet of the other side, and `echo received` is
when this packet arrived. From these the controller estimates the offset of the clocks (`control.bridge.clock`).

The controller begins a session with BEGIN and a random session number, and then sends COMMAND or REST at a constant
rate. The robot sends SAMPLE at any rate. The packets of each side and session are numbered in ascending order.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from enum import Enum, IntEnum
from typing import NamedTuple

import numpy as np

from worm3d.values.arrays import FloatArray

MAGIC, VERSION = b"WORM", 1
HEADER, CHECK = struct.Struct("<4sBBHHHIIQQQQ"), struct.Struct("<I")
MICROSECOND = 1e-6
RESTING = 1
"""Flag of a sample: the robot rests, since no valid command has arrived for some time, or by command."""
LARGEST = 65_507
"""Greatest length of a packet [bytes], that of a datagram. A worm of 1000 segments with all sensors needs 64 kB."""


class Kind(IntEnum):
    """Purpose of a packet."""

    BEGIN = 1
    COMMAND = 2
    REST = 3
    SAMPLE = 4


PARTS = {
    "contraction": ("N", 2),
    "hinge": ("N-1",),
    "strain": ("N", 2),
    "com": (3,),
    "heading": (),
    "angular_rate": ("N", 3),
    "contact_load": ("N", 6),
    "pressure": ("N", 2),
}
"""Shape of each part of a packet, for N segments. The first two make a command (`worm3d.Command`), the others are
channels of sensors with the units of `control.sensing.sensors.QUANTITIES`. The bit of a part is the place here."""
COMMANDED = ("contraction", "hinge")
CHANNELS = tuple(name for name in PARTS if name not in COMMANDED)


class Refusal(Enum):
    """Reason why a packet is not used. The value completes the sentence "the packet is ..."."""

    LENGTH = "shorter or longer than its header says"
    FOREIGN = "not of this protocol"
    VERSION = "of another version of the protocol"
    CHECK = "damaged, as its checksum shows"
    KIND = "of an unknown kind, or of the wrong side"
    SEGMENTS = "for a worm with another number of segments"
    VALUE = "with a number that is not finite, or a contraction that is not below 1"
    SESSION = "of another session"
    OLD = "not newer than the packet before"


class Packet(NamedTuple):
    """Content of a packet. Times are in seconds of the sender's clock, but `echo` is in the receiver's clock."""

    kind: Kind
    session: int
    number: int
    time: float = 0.0
    values: Mapping[str, FloatArray] = {}
    """Values of the parts by name, in the shapes of `PARTS`."""
    flags: int = 0
    echo: float = 0.0
    echo_received: float = 0.0
    taken: float = 0.0


def shape(part: str, segments: int) -> tuple[int, ...]:
    """Return the shape of a part for a number of segments."""
    sizes = {"N": segments, "N-1": segments - 1}
    return tuple(sizes[size] if isinstance(size, str) else size for size in PARTS[part])


def sizes(mask: int, segments: int) -> dict[str, int]:
    """Return the number of values of each part whose bit is set in a mask."""
    return {name: int(np.prod(shape(name, segments))) for bit, name in enumerate(PARTS) if mask >> bit & 1}


def mask_of(values: Mapping[str, object]) -> int:
    """Return the mask with the bits of some parts."""
    return sum(1 << bit for bit, name in enumerate(PARTS) if name in values)


def encoded(packet: Packet, segments: int) -> bytes:
    """Return a packet as bytes."""
    times = (round(t / MICROSECOND) for t in (packet.time, packet.echo, packet.echo_received, packet.taken))
    named = MAGIC, VERSION, packet.kind, packet.flags, segments, mask_of(packet.values), packet.session, packet.number
    parts = (np.asarray(packet.values[name], dtype="<f4").tobytes() for name in PARTS if name in packet.values)
    body = HEADER.pack(*named, *times) + b"".join(parts)
    return body + CHECK.pack(zlib.crc32(body))


def decoded(data: bytes, segments: int) -> Packet | Refusal:
    """Return the packet in some bytes, or the reason why the bytes are refused."""
    if len(data) < HEADER.size + CHECK.size:
        return Refusal.LENGTH
    magic, version, kind, flags, n, mask, session, number, *times = HEADER.unpack_from(data)
    parts = sizes(mask, n) if n else {}
    wrong = {
        Refusal.FOREIGN: magic != MAGIC,
        Refusal.VERSION: version != VERSION,
        Refusal.CHECK: CHECK.unpack(data[-CHECK.size :])[0] != zlib.crc32(data[: -CHECK.size]),
        Refusal.KIND: kind not in {*Kind} or mask >> len(PARTS) != 0,
        Refusal.SEGMENTS: n != segments,
        Refusal.LENGTH: len(data) != HEADER.size + 4 * sum(parts.values()) + CHECK.size,
    }
    for reason, holds in wrong.items():
        if holds:
            return reason
    numbers = np.frombuffer(data, "<f4", sum(parts.values()), HEADER.size).astype(float)
    pieces = np.split(numbers, np.cumsum([*parts.values()])[:-1]) if parts else []
    values = {name: piece.reshape(shape(name, n)) for name, piece in zip(parts, pieces, strict=True)}
    if not np.isfinite(numbers).all() or (values.get("contraction", np.zeros(1)) >= 1.0).any():
        return Refusal.VALUE
    time, echo, echo_received, taken = (MICROSECOND * each for each in times)
    return Packet(Kind(kind), session, number, time, values, flags, echo, echo_received, taken)


def next_packet(data: bytes) -> tuple[bytes, bytes]:
    """Return the first packet in the bytes of a serial line, and the following bytes.

    The packet is empty if none is complete. Bytes that cannot begin a packet are dropped. A header with a damaged
    length does not hold back the packets after it.
    """
    kept, begin = max(0, len(data) - len(MAGIC) + 1), data.find(MAGIC)
    while begin >= 0:
        end = begin + HEADER.size
        if len(data) >= end:
            header = HEADER.unpack_from(data, begin)
            check = end + 4 * sum(sizes(header[5], max(1, header[4])).values())
            end = check + CHECK.size
            if len(data) >= end and zlib.crc32(data[begin:check]) == CHECK.unpack_from(data, check)[0]:
                return data[begin:end], data[end:]
        if len(data) < end <= begin + LARGEST:
            kept = min(kept, begin)
        begin = data.find(MAGIC, begin + 1)
    return b"", data[kept:]


class Inbox:
    """Received packets of one side. Packets that are not valid and new are refused and counted.

    `kinds` are the kinds of packets that the other side may send, each with the parts that a packet of this kind must
    have. A session is opened with `open`.
    """

    def __init__(self, segments: int, kinds: Mapping[Kind, tuple[str, ...]]) -> None:
        self.segments, self._kinds = segments, kinds
        self.session, self.number, self.accepted = -1, -1, 0
        self.refused: Counter[Refusal] = Counter()

    def open(self, session: int) -> None:
        """Accept packets of a new session only."""
        self.session, self.number = session, -1

    def take(self, data: bytes) -> Packet | None:
        """Return the packet in some bytes, or None for a refused packet. A packet BEGIN may be of any session."""
        packet = decoded(data, self.segments)
        if isinstance(packet, Packet):
            packet = self._wrong(packet) or packet
        if isinstance(packet, Refusal):
            self.refused[packet] += 1
            return None
        self.accepted += 1
        if packet.kind is not Kind.BEGIN:
            self.number = packet.number
        return packet

    def _wrong(self, packet: Packet) -> Refusal | None:
        if packet.kind not in self._kinds or not {*self._kinds[packet.kind]} <= packet.values.keys():
            return Refusal.KIND
        if packet.kind is Kind.BEGIN:
            return None
        if packet.session != self.session:
            return Refusal.SESSION
        return Refusal.OLD if packet.number <= self.number else None
