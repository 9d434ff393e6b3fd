"""Side of the controller: a controller of the simulation drives a robot in real time.

The controller runs in the thread that calls `drive`. Its step for tick k is due `lead` before the tick, so a
decision may take as long as the lead. A slower decision makes the exchange repeat the last command
(`control.bridge.exchange`), and the steps after it follow without pause until the lead is made up. The price of the
lead is that the command of a tick knows samples up to the lead before the tick. Samples carry their instants, and
estimators allow for their age.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Literal, NamedTuple, Self

import numpy as np

from control.bridge.board import SAMPLE_HEAD, Board
from control.bridge.exchange import exchange
from control.bridge.links import opened
from control.bridge.packets import COMMANDED, PARTS
from control.bridge.robot import PERIOD
from control.sensing.sensors import Measurement, Sample
from worm3d import Command
from worm3d.values import arguments

LEAD = 0.1
"""Time by which the commands are planned in advance [s]. It is longer than most decisions of the MPC. With half of it,
more commands are late; double of it delays the control by as much."""
HOLD = 0.25
"""Time for which a late controller's last command is repeated [s]: a quarter of a wave."""
SILENCE = 0.1
"""Time without samples after which the robot counts as silent [s]; see `control.bridge.robot.WATCHDOG`."""
GIVE_UP = 10.0
"""Default time without samples after which a run ends [s]."""
CONNECTING = 20.0
"""Time within which a robot must answer at the start [s]."""
CHANNELS = tuple(name for name in PARTS if name not in COMMANDED)
_LOG = logging.getLogger(__name__)

Step = Callable[[float, Measurement], Command]
"""Function of time [s] and measurement that returns the command from this time on."""


class NoRobotError(ConnectionError):
    """No robot answers."""


class Ending(NamedTuple):
    """How a run on a robot ended."""

    status: Literal["done", "interrupted", "diverged"]
    sentence: str
    ticks: int
    """Number of ticks up to the end."""


@dataclass(kw_only=True)
class Bridge:
    """Connection of a controller to a robot, as a context that starts and ends the process of the exchange.

    Raises
    ------
    ValueError
        A time is out of range, or the address is not valid.
    OSError
        The link cannot be opened.
    NoRobotError
        On entering, if no robot answers.
    """

    address: str
    segments: int
    ticks: int
    period: float = PERIOD
    lead: float = LEAD
    hold: float = HOLD
    silence: float = SILENCE
    connecting: float = CONNECTING

    def __post_init__(self) -> None:
        for name in ("period", "silence", "connecting"):
            arguments.number(name, getattr(self, name), "s", gt=0.0)
        for name in ("lead", "hold"):
            arguments.number(name, getattr(self, name), "s", ge=0.0)
        opened(self.address).close()  # an error of the address is the caller's, not the other process's
        self.board = Board(self.segments, self.ticks)
        self._read = 0

    def __enter__(self) -> Self:
        given = (self.board, self.address, self.period, self.hold, self.silence)
        self.process = multiprocessing.get_context("spawn").Process(target=exchange, args=given, daemon=True)
        self.process.start()
        until = time.monotonic() + self.connecting
        while not math.isfinite(self.board["arrived"]):
            if time.monotonic() > until or not self.process.is_alive():
                self.close()
                raise NoRobotError(
                    f"{self.address}: no robot has answered within {self.connecting:g} s; switch it on, and look at "
                    "the address and at its number of segments; packets refused: " + (self.refusals() or "none")
                )
            time.sleep(self.period)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End the exchange. The robot then rests."""
        self.board["stop"] = 1.0
        self.process.join(1.0)
        if self.process.is_alive():
            self.process.kill()

    def begin(self) -> None:
        """Begin the run: tick 0 is due after the lead."""
        self.board["began"] = time.monotonic() + self.lead + self.period

    @property
    def silent(self) -> float:
        """Time since the latest sample [s]."""
        return time.monotonic() - self.board["arrived"]

    def behind(self, k: int) -> float:
        """Return the time since the step for tick k was due, below 0 before [s]."""
        return time.monotonic() - (self.board["began"] + k * self.period - self.lead)

    def plan(self, k: int, command: Command) -> None:
        """Set the command of tick k. Ticks are planned in order."""
        self.board.commands[k] = np.concatenate([command.contraction.ravel(), command.hinge])
        self.board["planned"] = k + 1

    def measurement(self, k: int) -> Measurement:
        """Return the measurement for the step of tick k: the newest of the samples that have not been used yet.

        If several steps are due, the samples are shared among them.
        """
        new = int(self.board["seen"]) - self._read
        steps = max(1, math.floor(self.behind(k) / self.period) + 1)
        rows = slice(self._read, self._read + math.ceil(new / steps))
        self._read = rows.stop
        samples = {name: self._newest(name, rows) for name in CHANNELS}
        return Measurement(k * self.period, **{name: sample for name, sample in samples.items() if sample is not None})

    def _newest(self, channel: str, rows: slice) -> Sample | None:
        values = self.board.values(channel, rows)
        known = np.flatnonzero(np.isfinite(values).all(axis=tuple(range(1, values.ndim))))
        if len(known) == 0:
            return None
        row = rows.start + int(known[-1])
        return Sample(values[known[-1]], float(self.board.samples[row, SAMPLE_HEAD.index("taken")]))

    def refusals(self) -> str:
        """Return the numbers of refused packets with their reasons, as text."""
        from control.bridge.packets import Refusal

        counts = {each: int(self.board[each.name]) for each in Refusal}
        return ", ".join(f"{count} {reason.value}" for reason, count in counts.items() if count)


def drive(
    step: Step,
    bridge: Bridge,
    *,
    give_up: float = GIVE_UP,
    goes_on: Callable[[int], bool] = lambda tick: True,
    say: Callable[[str], Any] = _LOG.warning,
) -> Ending:
    """Drive a robot by the steps of a controller, to the end of the bridge's ticks.

    Parameters
    ----------
    step : callable
        Step of the controller.
    bridge : Bridge
        Connected to the robot.
    give_up : float
        Time without samples after which the run ends [s].
    goes_on : callable
        Function of the number of planned ticks. If it returns False, the run ends.
    say : callable
        Function that is called with a sentence when the robot falls silent, and when samples come again.
    """
    bridge.begin()
    quiet = False
    for k in range(bridge.ticks):
        while True:
            if not goes_on(k):
                return Ending("interrupted", f"stopped at {k * bridge.period:g} s", k)
            if not bridge.process.is_alive():
                code = bridge.process.exitcode
                return Ending("diverged", f"the process of the link has ended (exit code {code}); the robot rests", k)
            silent = bridge.silent
            if silent > give_up:
                why = f"the robot has been silent for {give_up:g} s; look at its power, its cable and its program"
                return Ending("diverged", why, k)
            if quiet != (silent > bridge.silence):
                quiet = not quiet
                say(
                    f"{k * bridge.period:.2f} s: the robot is silent"
                    if quiet
                    else f"{k * bridge.period:.2f} s: it is back"
                )
            if (late := bridge.behind(k)) >= 0.0:
                break
            time.sleep(min(-late, bridge.period))
        bridge.plan(k, step(k * bridge.period, bridge.measurement(k)))
    bridge.process.join(bridge.lead + 1.0)
    return Ending("done", "the robot has run to the end", bridge.ticks)
