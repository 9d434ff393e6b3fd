"""Side of the controller that keeps the deadlines: a separate process that exchanges packets and never computes.

A controller may compute for longer than a period, and Python lets only one thread compute at a time. The exchange
therefore runs in another process, which shares a `Board` with the controller. At tick k, k periods after the begin of
the run, the exchange sends the command that was planned for this tick. For a late controller, the exchange repeats the
last planned command for at most `hold`, and then sends REST. If no sample has arrived for `silence`, the exchange calls
the robot with BEGIN and a new session until samples come again.
"""

from __future__ import annotations

import math
import multiprocessing
import secrets
import signal
import time
from contextlib import closing

import numpy as np

from control.bridge.board import STATES, Board
from control.bridge.clock import ClockOffset
from control.bridge.deadlines import following, hurried
from control.bridge.links import Link, opened
from control.bridge.packets import COMMANDED, Inbox, Kind, Packet, encoded, shape
from worm3d.values.arrays import FloatArray

FAREWELLS = 3
"""Number of packets REST at the end. If all are lost, the watchdog of the robot acts."""


class ControllerSide:
    """Session, clock and packets of the controller. Times are on the clock `time.monotonic` [s]."""

    def __init__(self, board: Board, link: Link, period: float, hold: float, silence: float) -> None:
        self.board, self.link, self._period, self._hold, self._silence = board, link, period, hold, silence
        self.inbox = Inbox(board.segments, {Kind.SAMPLE: ()})
        self._calling, self._number = False, 0
        self.row = 0
        """Row of the board's commands of the latest packet COMMAND."""
        self.clock = ClockOffset()

    def take(self, data: bytes, now: float) -> None:
        """Take a packet that arrived at an instant [s]."""
        packet, board = self.inbox.take(data), self.board
        if packet is None:
            for reason, count in self.inbox.refused.items():
                board[reason.name] = count
            return
        self.clock.take(packet.echo, packet.echo_received, packet.time, now)
        board["offset"] = self.clock.offset
        board.store(packet, now, self.clock.round_trip)
        board["arrived"] = now

    def tick(self, k: int, now: float) -> str:
        """Send the packet of tick k; return the entry of `STATES`."""
        board = self.board
        if now - board["arrived"] > self._silence:
            if not self._calling:
                self._calling, self._number, self.clock = True, 0, ClockOffset()
                self.inbox.open(secrets.randbits(32))
                board["sessions"] += 1
            self.send(Kind.BEGIN)
            return "calling"
        self._calling = False
        row = min(k, int(board["planned"]) - 1)
        if row < 0 or math.isnan(board["began"]) or (k - row) * self._period > self._hold:
            self.send(Kind.REST)
            return "rest"
        self.row = row
        self.send(Kind.COMMAND, board.commands[row])
        return "planned" if row == k else "held"

    def send(self, kind: Kind, command: FloatArray | None = None) -> None:
        """Send a packet of a kind, with a row of the board's commands. Before the first session, nothing is sent."""
        if self.inbox.session < 0:
            return
        values, n = {}, self.board.segments
        if command is not None:
            values = dict(zip(COMMANDED, np.split(command, [int(np.prod(shape("contraction", n)))]), strict=True))
        self._number += kind is not Kind.BEGIN
        self.link.send(encoded(Packet(kind, self.inbox.session, self._number, time.monotonic(), values), n))


def exchange(board: Board, address: str, period: float, hold: float, silence: float) -> None:
    """Exchange packets with a robot until the run ends, the controller asks to stop, or its process has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the controller's process decides
    link, parent = opened(address), multiprocessing.parent_process()
    side, due, k = ControllerSide(board, link, period, hold, silence), time.monotonic(), -1
    with hurried(), closing(link):
        while k + 1 < board.ticks and not board["stop"] and (parent is None or parent.is_alive()):
            due, k = following(due, board["began"], period, time.monotonic())
            wait = period
            while wait > 0.0:  # looks at the link at least once
                wait = due - time.monotonic()
                for data, _ in link.receive(wait):
                    side.take(data, time.monotonic())
            state = side.tick(k, time.monotonic())
            if 0 <= k < board.ticks:
                board.sent[k] = time.monotonic() - due, STATES.index(state), side.row
        for _ in range(FAREWELLS):
            side.send(Kind.REST)
