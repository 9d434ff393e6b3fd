"""Controllers that are not built on `control.loop.WaveController`, called guests here.

A `Guest` runs such a controller in the same loop as the supplied controllers, and times its decisions. The controller
has the methods `reset()` and `step(t, measurement)`, which returns a `worm3d.Command`, and gets the measurements of the
sensors. The metrics of a run are averaged over a commanded wave. If the controller has an attribute `waves` (the
commanded phase in waves), the wave follows from it. Otherwise a wave has the preferred frequency of the identified map.

If a step raises an exception, the worm rests until a step succeeds again. The first exception is logged, and all
exceptions together are reported as one fault.
"""

from __future__ import annotations

import logging
import math
from time import perf_counter

import numpy as np

from control.faults.rules import Fault
from control.gaits.steering import GaitParameters
from control.loop import Decision, Driver, complaint_of
from control.planning.feed_forward import FeedForward
from control.sensing.sensors import Measurement
from control.task import ControlTask
from worm3d import Command
from worm3d.running.actuation import Controller
from worm3d.values.named import EXCEPTIONS

RAISED = "exception"
"""Kind of the fault that is reported when a guest has raised exceptions."""
_LOG = logging.getLogger(__name__)


class Guest(Driver):
    """Driver of a controller that is not a `WaveController`. One decision is recorded per control period."""

    def __init__(self, guest: Controller, task: ControlTask) -> None:
        self.guest = guest
        super().__init__(task, FeedForward(task.found, task.worm.length))
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        super().reset()
        self.guest.reset()
        self._waves, self._steps = 0.0, 0
        self._raised: list[tuple[float, str]] = []
        self._moves = False

    @property
    def waves(self) -> float:
        """Commanded phase [waves]."""
        known = getattr(self.guest, "waves", None)
        is_known = isinstance(known, int | float) and math.isfinite(known)
        return float(known) if is_known and known is not None else self._waves

    @property
    def faults(self) -> list[Fault]:
        """Faults that the watch has detected, and the exceptions that the guest has raised."""
        if not self._raised:
            return super().faults
        times, complaints = zip(*self._raised, strict=True)
        share = f"{len(times)} of {self._steps} steps"
        what = f"{type(self.guest).__name__} raised an exception in {share}, and the worm rested: {complaints[-1]}"
        return [*super().faults, Fault(times[0], RAISED, what, "see the first one's traceback, above or in the log")]

    def step(self, t: float, measurement: Measurement) -> Command:
        """Return the guest's command from time t [s] on, or rest.

        The worm rests if the guest raises an exception.
        """
        elapsed = self._elapsed(t)
        self.watch.look(t, self.gate(t, measurement, moving=self._moves), self._estimate)
        complaint, began = "", perf_counter()
        self._steps += 1
        try:
            command = self.guest.step(t, measurement)
            if not isinstance(command, Command):
                raise TypeError(f"step returned {type(command).__name__}, must be a worm3d.Command")
        except EXCEPTIONS as error:
            complaint = complaint_of(error)
            if not self._raised:
                _LOG.warning("no command at %.3f s; further exceptions are counted only", t, exc_info=error)
            self._raised.append((t, complaint))
            command = Command(np.zeros((self.worm.segments, 2)))
        self._waves += self.feed_forward.frequency * elapsed
        self._spent += perf_counter() - began
        self._moves = bool(command.contraction.any())
        at_rest = None if self._moves else GaitParameters(0.0, self.feed_forward.frequency)
        self.watch.tell(2.0 * math.pi * self.waves, command, at_rest)
        if t >= self._due - 1e-9:
            self._due = t + self.control_period
            self.failures += bool(complaint)
            waves = GaitParameters(0.0, self.feed_forward.frequency)
            self.decisions.append(Decision(t, "own", waves, None, complaint, bool(complaint), seconds=self._spent))
            self._spent = 0.0
        return command
