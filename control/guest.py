"""Controllers that are not built on `control.loop.WaveController`, in the same loop: their decisions are timed.

A guest has the methods `reset()` and `step(t, measurement)`, which returns a `worm3d.Command`; it sees what the sensors
give. Metrics average over a commanded wave: if the guest has an attribute `waves`, the phase that it commands, by that,
else by the frequency that suits the identified map. Where it raises an exception the worm rests until it returns again;
the first one is logged, and all are a fault.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from time import perf_counter
from typing import Any, Self

import numpy as np

from control.faults.rules import Fault
from control.gaits.steering import GaitParameters, Mechanism
from control.identification.identified import Identified
from control.loop import Choice, Decision, WaveController, complaint_of
from control.planning.feed_forward import FeedForward
from control.sensing.sensors import Channel, Measurement
from control.tracking.references import Reference
from worm3d import Command, Worm
from worm3d.running.actuation import Controller
from worm3d.values.named import EXCEPTIONS

RAISED = "exception"
"""Kind of the fault of a guest that raised exceptions."""
_LOG = logging.getLogger(__name__)


class Guest(WaveController):
    """A controller of another kind as a `WaveController`: a decision is recorded once a control period."""

    def __init__(
        self,
        guest: Controller,
        worm: Worm,
        reference: Reference,
        identified: Identified,
        mechanism: Mechanism = "hinge",
        control_period: float = 0.2,
    ) -> None:
        self.guest = guest
        feed_forward = FeedForward(identified.maps[mechanism], worm.length)
        super().__init__(worm, reference, identified.schedule, feed_forward, control_period)

    @classmethod
    def of(
        cls,
        worm: Worm,
        reference: Reference,
        identified: Identified,
        mechanism: Mechanism = "hinge",
        control_period: float = 0.2,
        sensors: Mapping[str, Channel] | None = None,
    ) -> Self:
        """Raise TypeError: a guest is made by its own class."""
        raise TypeError("of: a guest is made by its own class, control.controllers.made")

    def reset(self) -> None:
        """Begin anew."""
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
        """Those of every controller, and that the guest raised exceptions."""
        if not self._raised:
            return super().faults
        times, complaints = zip(*self._raised, strict=True)
        share = f"{len(times)} of {self._steps} steps"
        what = f"{type(self.guest).__name__} raised an exception in {share}, and the worm rested: {complaints[-1]}"
        return [*super().faults, Fault(times[0], RAISED, what, "see the first one's traceback, above or in the log")]

    def step(self, t: float, measurement: Measurement) -> Command:
        """Return the guest's command from time t [s] on, or rest where it raised an exception."""
        elapsed, self._time = 0.0 if self._time is None else t - self._time, t
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
        self._waves += self._frequency * elapsed
        self._spent += perf_counter() - began
        self._moves = bool(command.contraction.any())
        at_rest = None if self._moves else GaitParameters(0.0, self._frequency)
        self.watch.tell(2.0 * math.pi * self.waves, command, at_rest)
        if t >= self._due - 1e-9:
            self._due = t + self.control_period
            self.failures += bool(complaint)
            waves = GaitParameters(0.0, self._frequency)
            self.decisions.append(Decision(t, "own", waves, None, complaint, bool(complaint), seconds=self._spent))
            self._spent = 0.0
        return command

    def _choose(self, t: float, estimate: Any) -> Choice:
        raise AssertionError("a guest decides by itself")


def hosted(
    name: str,
    built: Any,
    worm: Worm,
    reference: Reference,
    identified: Identified,
    mechanism: Mechanism,
    control_period: float,
) -> WaveController:
    """Return what a controller's `of` returned, as a `WaveController`; ValueError if it is no controller."""
    if isinstance(built, WaveController):
        return built
    if isinstance(built, type) or not isinstance(built, Controller):
        raise ValueError(f"{name}: its of(...) returned {type(built).__name__}, must have reset() and step(t, seen)")
    return Guest(built, worm, reference, identified, mechanism, control_period)
