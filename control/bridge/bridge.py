"""Side of the controller: a controller of the simulation drives a robot in real time.

The controller runs in the thread that calls `drive`. The step for tick k is due `lead` before the tick, so a decision
may take as long as the lead. A slower decision makes the exchange repeat the last command (`control.bridge.exchange`),
and the steps after it follow without pause until the lead is made up. The price of the lead is that the command of a
tick knows samples up to the lead before the tick. Samples carry their instants, and estimators allow for their age.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import time
from collections.abc import Callable
from typing import Any, Literal, NamedTuple, Self

import numpy as np

from control.bridge.board import INSTANTS, Board
from control.bridge.exchange import exchange
from control.bridge.links import opened
from control.bridge.packets import CHANNELS, Refusal
from control.bridge.robot import PERIOD
from control.sensing.sensors import Measurement, Sample
from worm3d import Command
from worm3d.values import arguments
from worm3d.values.named import EXCEPTIONS

LEAD = 0.1
"""Time from the plan of a command to the tick of the command [s], longer than most decisions of the MPC. With half this
time, more commands are late. Twice this time delays the control by as much."""
HOLD = 0.25
"""Longest time during which the last command of a late controller is repeated [s]: a quarter of a wave."""
SILENCE = 0.1
"""Time without samples after which the robot counts as silent [s]; see `control.bridge.robot.WATCHDOG`."""
GIVE_UP = 10.0
"""Default time without samples after which a run ends [s]."""
CONNECTING = 20.0
"""Time within which a robot must answer at the start [s]."""
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


class Bridge:
    """Connection of a controller to a robot, as a context that starts and ends the process of the exchange.

    Parameters
    ----------
    address : str
        Address of the robot (`control.bridge.links.opened`).
    segments, ticks : int
        Number of segments, and of the ticks of the run.
    period, lead, connecting : float
        Time between two ticks, time from the plan of a command to its tick, and longest time until the robot answers
        [s].

    Raises
    ------
    ValueError
        A time is out of range, or the address is not valid.
    OSError
        The link cannot be opened.
    NoRobotError
        On entering, if no robot answers.
    """

    def __init__(
        self,
        address: str,
        segments: int,
        ticks: int,
        *,
        period: float = PERIOD,
        lead: float = LEAD,
        connecting: float = CONNECTING,
    ) -> None:
        self.period = arguments.number("period", period, "s", gt=0.0)
        self.lead = arguments.number("lead", lead, "s", ge=0.0)
        opened(address).close()  # an error of the address is the caller's, not the other process's
        self.address, self._connecting, self.board, self._read = address, connecting, Board(segments, ticks), 0
        self._samples = dict.fromkeys(CHANNELS, Sample(None, math.nan))
        given = (self.board, address, period, HOLD, SILENCE)
        self.process = multiprocessing.get_context("spawn").Process(target=exchange, args=given, daemon=True)

    def __enter__(self) -> Self:
        self.process.start()
        until = time.monotonic() + self._connecting
        try:
            while not math.isfinite(self.board["arrived"]):
                if time.monotonic() > until or not self.process.is_alive():
                    raise NoRobotError(
                        f"{self.address}: no robot has answered within {self._connecting:g} s; switch it on, and look "
                        f"at the address and at its number of segments; packets refused: {self.refusals() or 'none'}"
                    )
                time.sleep(self.period)
        except BaseException:  # Ctrl-C as well
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.board["stop"] = 1.0
        self.process.join(1.0)
        self.process.kill()
        self.process.join()

    def begin(self) -> None:
        """Begin the run: the step for tick 0 is due now, and tick 0 after the lead."""
        self.board["began"] = time.monotonic() + self.lead

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
        self._read, taken = rows.stop, self.board.head("taken")[rows]
        for name, (_, latest) in self._samples.items():
            values = self.board.values(name, rows)
            known = np.flatnonzero(np.isfinite(values).all(axis=tuple(range(1, values.ndim))))
            come = len(known) > 0
            self._samples[name] = Sample(values[known[-1]], float(taken[known[-1]])) if come else Sample(None, latest)
        return Measurement(k * self.period, **self._samples)

    def refusals(self) -> str:
        """Return the numbers of refused packets with their reasons, as text."""
        counts = {each: int(self.board[each.name]) for each in Refusal}
        return ", ".join(f"{count} {reason.value}" for reason, count in counts.items() if count)

    def trouble(self, give_up: float) -> str:
        """Return why a run cannot go on, as a sentence; empty if it can."""
        if self.board.full:
            return f"the robot has sent more than {INSTANTS} packets a tick, and there is no room for more samples"
        if self.process.exitcode:
            return f"the process of the link has ended (exit code {self.process.exitcode}); the robot rests"
        if self.silent > give_up:
            return f"the robot has been silent for {give_up:g} s; look at its power, its cable and its program"
        return ""


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
        Function of the number of planned ticks. A return value of False ends the run.
    say : callable
        Function that is called with a sentence when the robot falls silent, and when samples come again.

    Returns
    -------
    Ending
        Status, sentence and number of ticks.
    """
    bridge.begin()
    quiet, ticks = False, bridge.board.ticks
    done = Ending("done", "the robot has run to the end", ticks)
    for k in range(ticks):
        while True:
            if not goes_on(k):
                return Ending("interrupted", f"stopped at {k * bridge.period:g} s", k)
            if bridge.process.exitcode == 0:  # the exchange has come to the end before a late controller
                return done
            if trouble := bridge.trouble(give_up):
                return Ending("diverged", trouble, k)
            if quiet != (bridge.silent > SILENCE):
                quiet = not quiet
                say(f"{k * bridge.period:.2f} s: the robot {'is silent' if quiet else 'answers again'}")
            if (late := bridge.behind(k)) >= 0.0:
                break
            time.sleep(min(-late, bridge.period))
        try:
            bridge.plan(k, step(k * bridge.period, bridge.measurement(k)))
        except EXCEPTIONS as error:  # of the user's code
            _LOG.error("the controller failed", exc_info=error)
            return Ending("diverged", f"the controller failed: {type(error).__name__}: {error}", k)
    bridge.process.join(bridge.lead + 1.0)
    return done
