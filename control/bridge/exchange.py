"""Side of the controller that keeps the deadlines: a process of its own that exchanges packets and never computes.

A controller may compute for longer than a period, and Python lets only one thread compute at a time. The exchange
therefore runs in another process, which shares a `Board` with the controller. At tick k, k periods after the begin of
the run, it sends the command that was planned for this tick. If the controller is late, it repeats the last planned
command for at most `hold`, and then sends REST. If no sample has arrived for `silence`, it calls the robot with BEGIN
and a new session until samples come again.
"""

from __future__ import annotations

import math
import secrets
import signal
import time

import numpy as np

from control.bridge.board import STATES, Board, is_orphan
from control.bridge.clock import ClockOffset
from control.bridge.deadlines import following, hurry
from control.bridge.links import Link, opened
from control.bridge.packets import COMMANDED, Inbox, Kind, Packet, encoded, shape
from worm3d.values.arrays import FloatArray

FAREWELLS = 3
"""Number of packets REST at the end. If all are lost, the watchdog of the robot acts."""


class ControllerSide:
    """Session, clock and packets of the controller. Times are on the clock `time.monotonic` [s]."""

    def __init__(self, board: Board, link: Link, period: float, hold: float, silence: float) -> None:
        self.board, self.link, self.period, self.hold, self.silence = board, link, period, hold, silence
        self.inbox = Inbox(board.segments, {Kind.SAMPLE: ()})
        self._calling, self._number = False, 0
        self.clock = ClockOffset()

    def take(self, data: bytes, now: float) -> None:
        """Take a packet that arrived at an instant [s]."""
        packet, board = self.inbox.take(data), self.board
        if packet is None:
            for reason, count in self.inbox.refused.items():
                board[reason.name] = count
            return
        self.clock.take(packet.echo, packet.echo_received, packet.time, now)
        board["offset"], board["round_trip"] = self.clock.offset, self.clock.round_trip
        board["accepted"] = self.inbox.accepted
        board.store(packet, now)
        board["arrived"] = now

    def tick(self, k: int, now: float) -> str:
        """Send the packet of tick k; return its entry of `STATES`."""
        if now - self.board["arrived"] > self.silence:
            if not self._calling:
                self._calling, self._number, self.clock = True, 0, ClockOffset()
                self.inbox.open(secrets.randbits(32))
                self.board["sessions"] += 1
            self._send(Kind.BEGIN)
            return "calling"
        self._calling = False
        planned = int(self.board["planned"])
        row = min(k, planned - 1)
        if row < 0 or math.isnan(self.board["began"]) or (k - row) * self.period > self.hold:
            self._send(Kind.REST)
            return "rest"
        self._send(Kind.COMMAND, self.board.commands[row])
        return "planned" if row == k else "held"

    def _send(self, kind: Kind, command: FloatArray | None = None) -> None:
        values, n = {}, self.board.segments
        if command is not None:
            values = dict(zip(COMMANDED, np.split(command, [int(np.prod(shape("contraction", n)))]), strict=True))
        if kind is not Kind.BEGIN:
            self._number += 1
        packet = Packet(kind, self.inbox.session, self._number, time.monotonic(), values)
        self.link.send(encoded(packet, n))

    def end(self) -> None:
        """Tell the robot to rest."""
        for _ in range(FAREWELLS):
            self._send(Kind.REST)


def exchange(board: Board, address: str, period: float, hold: float, silence: float) -> None:
    """Exchange packets with a robot until the run ends, the controller asks to stop, or its process has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the controller's process decides
    hurry()
    link = opened(address)
    side, due, k = ControllerSide(board, link, period, hold, silence), time.monotonic(), -1
    try:
        while k + 1 < board.ticks and not board["stop"] and not is_orphan():
            due, k = following(due, board["began"], period, time.monotonic())
            while (wait := due - time.monotonic()) > 0.0:
                for data, _ in link.receive(wait):
                    side.take(data, time.monotonic())
            for data, _ in link.receive(0.0):
                side.take(data, time.monotonic())
            state = side.tick(k, time.monotonic())
            if 0 <= k < board.ticks:
                board.sent[k] = time.monotonic() - due, STATES.index(state)
    finally:
        side.end()
        link.close()
