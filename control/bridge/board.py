"""Memory that the controller shares with the process of its link: commands to come, samples, and a log."""

from __future__ import annotations

from multiprocessing.sharedctypes import RawArray
from typing import Any

import numpy as np

from control.bridge.packets import COMMANDED, PARTS, Packet, Refusal, mask_of, shape, sizes
from worm3d.values.arrays import FloatArray

STATES = ("not sent", "planned", "held", "rest", "calling")
"""Kinds of packets at a tick: nothing, the command planned for the tick, an earlier command, REST, or BEGIN. Held
commands and REST are sent if the controller is late, and BEGIN if the robot is silent."""
NUMBERS = ("planned", "seen", "began", "arrived", "stop", "offset", "sessions", *(each.name for each in Refusal))
"""Single numbers: planned ticks, stored samples, begin of the run and arrival of the latest sample on the clock
`time.monotonic` [s], request to stop, clock offset [s], number of sessions, and refused packets by reason."""
HEAD = ("taken", "arrived", "flags", "mask", "round_trip")
"""First columns of a sample: instants since the begin of the run [s], flags, its parts as bits, and round trip [s]."""

INSTANTS = 3
"""Number of packets with samples for which there is room in each tick. Sensors with different delays send packets of
their own. With half, a robot with two such sensors fills the memory, with double, a run of 10 minutes needs 0.3 GB."""


class Board:
    """Arrays of a run of a number of ticks, in memory that can be passed to a new process.

    Attributes
    ----------
    commands : ndarray, shape (ticks, 3 N - 1)
        Commands as rows: contractions and hinge angles.
    sent : ndarray, shape (ticks, 3)
        Lateness [s] and index in `STATES` of what was sent, and the row of `commands` of a packet COMMAND.
    """

    def __init__(self, segments: int, ticks: int, memory: Any = None) -> None:
        self.segments, self.ticks = segments, ticks
        parts = sizes(-1, segments)
        ends = np.cumsum([len(HEAD), *parts.values()]).tolist()
        self._columns = {name: slice(*each) for name, *each in zip(PARTS, ends[:-1], ends[1:], strict=True)}
        room = INSTANTS * ticks + 1000
        shapes = ((ticks, sum(parts[name] for name in COMMANDED)), (ticks, 3), (room, ends[-1]), (len(NUMBERS),))
        counts = [int(np.prod(each)) for each in shapes]
        self._memory = RawArray("d", sum(counts)) if memory is None else memory
        pieces = np.split(np.frombuffer(self._memory), np.cumsum(counts)[:-1])
        self.commands, self.sent, self._samples, self._numbers = (
            piece.reshape(each) for piece, each in zip(pieces, shapes, strict=True)
        )
        if memory is None:
            self["began"] = self["offset"] = np.nan
            self["arrived"] = -np.inf

    def __reduce__(self) -> tuple[type[Board], tuple[int, int, Any]]:
        return Board, (self.segments, self.ticks, self._memory)

    def __getitem__(self, name: str) -> float:
        return float(self._numbers[NUMBERS.index(name)])

    def __setitem__(self, name: str, value: float) -> None:
        self._numbers[NUMBERS.index(name)] = value

    @property
    def full(self) -> bool:
        """Whether there is no room for further samples."""
        return int(self["seen"]) == len(self._samples)

    def store(self, packet: Packet, arrived: float, round_trip: float) -> None:
        """Append a sample that arrived at an instant [s], if the run has begun and there is room."""
        began, row = self["began"], int(self["seen"])
        if began <= arrived and row < len(self._samples):
            taken = packet.taken - self["offset"] - began
            head = (taken, arrived - began, packet.flags, mask_of(packet.values), round_trip)
            self._samples[row, : len(HEAD)] = head
            for name, value in packet.values.items():
                self._samples[row, self._columns[name]] = value.ravel()
            self["seen"] = row + 1  # last, since the other process reads up to this row

    def values(self, part: str, rows: slice = slice(None)) -> FloatArray:
        """Return a part of the stored samples, shape (R, ...); NaN in samples without this part."""
        kept = self._samples[: int(self["seen"])][rows]
        has = kept[:, HEAD.index("mask")].astype(int) >> list(PARTS).index(part) & 1
        found: FloatArray = np.where(has[:, None] > 0, kept[:, self._columns[part]], np.nan)
        return found.reshape(len(kept), *shape(part, self.segments))

    def head(self, column: str) -> FloatArray:
        """Return a column of `HEAD` of the stored samples, shape (R,)."""
        return self._samples[: int(self["seen"]), HEAD.index(column)]
