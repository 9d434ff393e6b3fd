"""Memory that the controller shares with the process of its link: commands to come, samples, and a log."""

from __future__ import annotations

import multiprocessing
from multiprocessing.sharedctypes import RawArray
from typing import Any

import numpy as np

from control.bridge.packets import COMMANDED, PARTS, Packet, Refusal, shape
from worm3d.values.arrays import FloatArray

STATES = ("not sent", "planned", "held", "rest", "calling")
"""What was sent at a tick: nothing, the command planned for the tick, an earlier command, REST, or BEGIN. Held commands
and REST are sent if the controller is late, and BEGIN if the robot is silent."""
NUMBERS = (
    *("planned", "seen", "dropped", "began", "arrived", "stop", "offset", "round_trip", "sessions", "accepted"),
    *(each.name for each in Refusal),
)
"""Single numbers: planned ticks, stored samples and those without room, begin of the run and arrival of the latest
sample on the clock `time.monotonic` [s], request to stop, clock offset and round trip [s], and counters."""
SAMPLE_HEAD = ("taken", "arrived", "flags", "mask", "round_trip")
"""First columns of a sample: instants since the begin of the run [s], flags, its parts as bits, and round trip [s]."""


class Board:
    """Arrays of a run of a number of ticks, in memory that can be passed to a new process.

    Attributes
    ----------
    commands : ndarray, shape (ticks, 3 N - 1)
        Commands as rows: contractions and hinge angles.
    sent : ndarray, shape (ticks, 2)
        Lateness [s] and index in `STATES` of what was sent.
    samples : ndarray, shape (R, K)
        Samples as rows: `SAMPLE_HEAD`, and all parts of a packet.
    """

    def __init__(self, segments: int, ticks: int, memory: Any = None) -> None:
        sizes = [int(np.prod(shape(name, segments))) for name in PARTS]
        ends = np.cumsum([len(SAMPLE_HEAD), *sizes]).tolist()
        self.columns = {name: slice(*each) for name, *each in zip(PARTS, ends[:-1], ends[1:], strict=True)}
        self.segments, self.ticks = segments, ticks
        shapes = (
            (ticks, sum(sizes[: len(COMMANDED)])),
            (ticks, 2),
            (ticks + ticks // 4 + 1000, ends[-1]),  # a slow sensor may send packets of its own
            (len(NUMBERS),),
        )
        counts = [int(np.prod(each)) for each in shapes]
        new = memory is None
        self.memory = RawArray("d", sum(counts)) if new else memory
        parts = np.split(np.frombuffer(self.memory), np.cumsum(counts)[:-1])
        self.commands, self.sent, self.samples, self._numbers = (
            part.reshape(each) for part, each in zip(parts, shapes, strict=True)
        )
        if new:
            self["began"] = self["offset"] = self["round_trip"] = np.nan
            self["arrived"] = -np.inf

    def __reduce__(self) -> tuple[type[Board], tuple[int, int, Any]]:
        return Board, (self.segments, self.ticks, self.memory)

    def __getitem__(self, name: str) -> float:
        return float(self._numbers[NUMBERS.index(name)])

    def __setitem__(self, name: str, value: float) -> None:
        self._numbers[NUMBERS.index(name)] = value

    def store(self, packet: Packet, arrived: float) -> None:
        """Append a sample that arrived at an instant [s], if the run has begun."""
        began, row = self["began"], int(self["seen"])
        if not began <= arrived:
            return
        if row == len(self.samples):
            self["dropped"] += 1
            return
        mask = sum(1 << bit for bit, name in enumerate(PARTS) if name in packet.values)
        head = (packet.taken - self["offset"] - began, arrived - began, packet.flags, mask, self["round_trip"])
        self.samples[row, : len(head)] = head
        for name, value in packet.values.items():
            self.samples[row, self.columns[name]] = value.ravel()
        self["seen"] = row + 1  # last, since the other process reads up to this row

    def values(self, part: str, rows: slice | int = slice(None)) -> FloatArray:
        """Return a part of the stored samples, shape (R, ...); NaN in samples without this part."""
        kept = self.samples[: int(self["seen"])][rows]
        found = kept[..., self.columns[part]].reshape(*kept.shape[:-1], *shape(part, self.segments))
        has = (kept[..., SAMPLE_HEAD.index("mask")].astype(int) >> list(PARTS).index(part)) & 1
        values: FloatArray = np.where(has.reshape(*has.shape, *(1,) * (found.ndim - has.ndim)), found, np.nan)
        return values

    def head(self, column: str) -> FloatArray:
        """Return a column of `SAMPLE_HEAD` of the stored samples, shape (R,)."""
        return self.samples[: int(self["seen"]), SAMPLE_HEAD.index(column)]


def is_orphan() -> bool:
    """Return whether the process that started this one has ended."""
    parent = multiprocessing.parent_process()
    return parent is not None and not parent.is_alive()
