"""Offset of the robot's clock from the controller's clock, from time stamps both ways.

A packet leaves the controller at t1 of its clock, arrives at the robot at t2 of the robot's clock, an answer leaves the
robot at t3, and arrives at the controller at t4. Then

    offset = ((t2 - t1) + (t3 - t4)) / 2,   round trip = (t4 - t1) - (t3 - t2)                            (CO1)

The offset is the robot's clock minus the controller's clock, with an error of at most half of the round trip. The error
is smallest for the quickest round trip, so the offset of the quickest round trip of the last `WINDOW` seconds is used.
Source: D. L. Mills, Internet time synchronization: the network time protocol, IEEE Transactions on Communications 39
(1991) 1482-1493.
"""

from __future__ import annotations

from collections import deque

WINDOW = 10.0
"""Time over which the quickest round trip is searched [s]. In this time two quartz clocks drift apart by 0.5 ms, the
error of a round trip with 1 ms of jitter. With half the time, jitter counts more, with double, the drift."""


class ClockOffset:
    """Estimate of the offset of the robot's clock [s], from (CO1)."""

    def __init__(self) -> None:
        self._quickest: deque[tuple[float, float, float]] = deque()  # instant, round trip, offset; both ascend
        self.round_trip = float("nan")
        """Latest round trip [s]."""

    def take(self, t1: float, t2: float, t3: float, t4: float) -> None:
        """Use the time stamps of a packet and its answer [s]."""
        self.round_trip = (t4 - t1) - (t3 - t2)
        kept = self._quickest
        while kept and kept[-1][1] >= self.round_trip:
            kept.pop()
        kept.append((t4, self.round_trip, ((t2 - t1) + (t3 - t4)) / 2.0))
        while kept[0][0] < t4 - WINDOW:
            kept.popleft()

    @property
    def offset(self) -> float:
        """The robot's clock minus the controller's clock [s]; NaN before the first answer."""
        return self._quickest[0][2] if self._quickest else float("nan")
