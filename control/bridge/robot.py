"""Side of the robot: one class for the hardware, and a loop with a watchdog.

A robot with an operating system, such as a single-board computer, needs a subclass of `Robot` only:

    class Mine(Robot):
        segments = 6
        def apply(self, command): ...      # set the valves or motors
        def sample(self): return {"strain": (strains, time.monotonic())}

    serve(Mine(), opened("serial:/dev/ttyS0"))

A microcontroller has the same loop in MicroPython, `control/bridge/firmware/worm.py`.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from control.bridge.deadlines import following, hurried
from control.bridge.links import Link
from control.bridge.packets import COMMANDED, PARTS, RESTING, Inbox, Kind, Packet, Refusal, encoded
from worm3d import Command

WATCHDOG = 0.08
"""Time without a valid command after which a robot rests [s]: seven lost packets at 100 Hz. With the period of the
loop, a robot without commands rests within 0.1 s. At half the time, short pauses of the controller's computer stop the
robot."""
PERIOD = 0.01
"""Period of the loops on both sides [s]."""


class Robot(ABC):
    """Hardware of a robot with N = `segments` segments."""

    segments: int

    @abstractmethod
    def apply(self, command: Command) -> None:
        """Set the actuators to a command."""

    @abstractmethod
    def sample(self) -> Mapping[str, tuple[Any, float]]:
        """Return the new samples by channel, each with the instant on the clock `time.monotonic` [s].

        `control.bridge.packets.PARTS` has the channels with their shapes, and `control.sensing.sensors.QUANTITIES` the
        units. A value may be None.
        """

    def rest(self) -> None:
        """Bring the actuators to rest. Override this method to vent or brake in another way."""
        self.apply(Command(np.zeros((self.segments, 2))))


class RobotSide:
    """Session, watchdog and packets of a robot. Times are on the clock `time.monotonic` [s]."""

    def __init__(self, robot: Robot, link: Link, watchdog: float = WATCHDOG) -> None:
        self.robot, self.link, self.watchdog = robot, link, watchdog
        self.inbox = Inbox(robot.segments, {Kind.BEGIN: (), Kind.COMMAND: COMMANDED, Kind.REST: ()})
        self.resting, self.rests = True, 0
        """Whether the robot rests, and how often a lack of commands began a rest."""
        self._used: set[int] = set()
        self._command: Command | None = None
        self._heard, self._echo, self._number = -np.inf, 0.0, 0

    @property
    def begun(self) -> bool:
        """Whether a controller has begun a session."""
        return bool(self._used)

    def take(self, data: bytes, source: Any, now: float) -> None:
        """Take a packet that arrived from an address."""
        packet = self.inbox.take(data)
        if packet is None or (packet.kind is Kind.BEGIN and not self._begins(packet)):
            return
        self.link.peer = source if source is not None else self.link.peer
        self._heard, self._echo = now, packet.time
        if packet.kind is Kind.COMMAND:
            self._command = Command(*(packet.values[name] for name in COMMANDED))
        else:
            self._command = None

    def _begins(self, packet: Packet) -> bool:
        """Open the session of a packet BEGIN. Used sessions are refused, and others while another controller drives."""
        if packet.session == self.inbox.session and self.inbox.number < 0:
            return True  # repeated, as the first one may be lost
        if packet.session in self._used or not self.resting:
            self.inbox.refused[Refusal.SESSION] += 1
            return False
        self._used.add(packet.session)
        self.inbox.open(packet.session)
        self._number = 0
        return True

    def tick(self, now: float) -> None:
        """Drive the actuators, and send the new samples."""
        if not self.begun:
            return
        late = now - self._heard > self.watchdog
        if late or self._command is None:
            self.rests += late and not self.resting
            self.robot.rest()
        else:
            self.robot.apply(self._command)
        self.resting = late or self._command is None
        for taken, values in sorted(self._samples(now).items()):
            self._number += 1
            flags, times = RESTING * self.resting, {"echo": self._echo, "echo_received": self._heard, "taken": taken}
            packet = Packet(Kind.SAMPLE, self.inbox.session, self._number, time.monotonic(), values, flags, **times)
            self.link.send(encoded(packet, self.robot.segments))

    def _samples(self, now: float) -> dict[float, dict[str, Any]]:
        """Return the new samples by instant. Without any, return no samples of this instant, as a sign of life."""
        found: dict[float, dict[str, Any]] = {}
        for name, (value, instant) in self.robot.sample().items():
            if name in PARTS and value is not None and np.isfinite(value).all() and 0.0 <= instant < math.inf:
                found.setdefault(instant, {})[name] = value
        return found or {now: {}}


def serve(
    robot: Robot,
    link: Link,
    *,
    watchdog: float = WATCHDOG,
    period: float = PERIOD,
    goes_on: Callable[[RobotSide], bool] = lambda side: True,
) -> RobotSide:
    """Drive a robot by the packets of a link until `goes_on` returns False, and leave the robot at rest.

    Parameters
    ----------
    robot : Robot
    link : Link
    watchdog : float
        Time without a valid command after which the robot rests [s].
    period : float
        Period of samples and of commands to the hardware [s].
    goes_on : callable
        Function of the side that is called once a period.

    Returns
    -------
    RobotSide
        The side with the counters of packets and rests.
    """
    side, due = RobotSide(robot, link, watchdog), time.monotonic()
    try:
        with hurried():
            while goes_on(side):
                due, _ = following(due, math.nan, period, time.monotonic())
                wait = period
                while wait > 0.0:  # looks at the link at least once
                    wait = due - time.monotonic()
                    for data, source in link.receive(wait):
                        side.take(data, source, time.monotonic())
                side.tick(time.monotonic())
    finally:
        if side.begun:
            robot.rest()
    return side
