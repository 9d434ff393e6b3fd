"""Gait of the larva's network: the wave passes to the next segment when the present segment has shortened.

The network is defined in `control.gaits.larva_ei.network`, (LE1) to (LE3), with the published parameters and one unit
for each segment; the worm's body replaces the larva's. A segment feels the shortening of its chambers, the mean of both
sides; the threshold `felt` is the share `feeling_threshold` of the amplitude. The activation is the muscle's force
f/f_max.

In the larva's body the threshold is 1/18 for a peak of 0.298, a share of 0.19. A segment of the larva reaches this
share late, since the neighbours pull the segment back and the damping c/k is 3.5 tau_E. A segment of a quicker worm
reaches this share within tau_E: the wave returns before the inhibition behind the wave has grown, and all segments stay
contracted. A share of 0.75 carries waves in worms of 4 to 14 segments with actuator lags of 0.02 to 0.5 s and periods
of 0.8 to 5 s. A worm whose actuators cannot shorten a segment so far, as in a pipe that is too narrow, holds still.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from control.gaits.feedback import FeedbackGait, Felt
from control.gaits.gait import Body, Direction, direction_of_waves
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter

TAU_PER_SEGMENT = 2.64
"""Duration of a wave per segment, in a larva's body with eight segments or more [tau_E]."""


@documented
@dataclass(frozen=True, kw_only=True)
class LarvaEI(FeedbackGait, name="larva_ei"):
    """Larva's excitatory-inhibitory network (Pehlevan, Paoletti, Mahadevan 2016) that feels the strain of segments."""

    period: float = parameter(
        2.0,
        meaning="time from wave to wave in the larva's own body, which sets the network's unit of time; in the worm "
        "it is the longer the slower the segments shorten",
        unit="s",
        gt=0,
    )
    direction: Direction = direction_of_waves()
    feeling_threshold: float = parameter(
        0.75,
        meaning="shortening of a segment that is felt, as a share of the amplitude; below about 0.7 quick worms stay "
        "contracted",
        gt=0,
        lt=1,
    )
    senses = ("strain",)
    lengthens = False

    def require_body(self, segments: int) -> None:
        """Raise ValueError if the gait does not fit a body with this number of segments."""
        if segments < 3:  # two segments carry the wave, one rests behind the wave
            raise ValueError(f"kind: got 'larva_ei', needs 3 segments or more for a wave; the worm has {segments}")

    def start(self, body: Body) -> Network:
        """Return the network at rest. A short input to the last segment starts the first wave."""
        self.require_body(body.segments)
        return Network(self, body.segments)


class Network:
    """Memory of a `LarvaEI`. Its units are in the larva's order, and the last unit starts a wave."""

    def __init__(self, gait: LarvaEI, segments: int) -> None:
        from control.gaits.larva_ei.kernel import Parameters

        self._along = slice(None) if gait.direction == "retrograde" else slice(None, None, -1)
        self._tau = gait.period / (TAU_PER_SEGMENT * segments)
        self._p = Parameters(felt=gait.feeling_threshold * gait.amplitude)
        self._states = np.zeros((3, segments))
        self._time: float | None = None
        self._age = 0.0

    def step(self, t: float, felt: Felt) -> FloatArray:
        """Advance to time t [s] and return the activation of the segments, shape (N,). Times must increase."""
        from control.gaits.larva_ei.kernel import advance

        contraction = np.ascontiguousarray(-felt["strain"].mean(axis=1)[self._along])
        span = 0.0 if self._time is None else (t - self._time) / self._tau
        if (steps := int(np.ceil(span / 0.005))) > 0:  # half this step changes the period by less than 0.1 %
            drive = self._p.start_drive if self._age < self._p.start_duration else 0.0
            advance(self._states, contraction, drive, self._p, span / steps, steps)
        self._time, self._age = t, self._age + span
        return np.asarray((self._states[2] / self._p.f_max)[self._along])
