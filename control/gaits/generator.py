"""The steered wave at run time: a controller changes its parameters whenever it likes, the commands stay continuous."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from control.gaits import Body
from control.gaits.steering import GaitParameters, Schedule
from worm3d import Command
from worm3d.values import arguments

BLEND = 0.25
"""Waves in which a parameter covers 63 % of a change, if nothing else is said."""


class WaveGenerator:
    """The wave at run time: its phase accumulates, and its parameters move towards what is asked for without jumps.

    The command is continuous in time whatever is asked for when: psi' = 2 pi f, and every parameter p approaches its
    target at the rate (target - p) f / blend. A wave begins at amplitude 0.

    Parameters
    ----------
    schedule : Schedule
    body : Body
        Its segments and stroke.
    blend : float
        Waves in which a parameter covers 63 % of a change.

    Attributes
    ----------
    phase : float
        psi [rad].
    parameters : GaitParameters or None
        In force; None before the first step.

    Raises
    ------
    ValueError
        `blend` out of range.
    """

    def __init__(self, schedule: Schedule, body: Body, blend: float = BLEND) -> None:
        arguments.number("blend", blend, "waves", gt=0.0)
        arguments.instance("schedule", schedule, Schedule, "a control.gaits.steering.Schedule")
        if not (hasattr(body, "segments") and hasattr(body, "stroke")):
            raise ValueError(f"body: got {type(body).__name__}, must be a worm3d.Worm")
        self.schedule, self.blend, self._body = schedule, blend, body
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self.phase = 0.0
        self.parameters: GaitParameters | None = None

    def step(self, dt: float, target: GaitParameters) -> Command:
        """Return the command after `dt` seconds more of going towards `target`."""
        now = self.parameters or GaitParameters(0.0, target.frequency)
        left = np.exp(-dt * now.frequency / self.blend)
        moved = GaitParameters(*(target.row() + (now.row() - target.row()) * left))
        self.phase += np.pi * (now.frequency + moved.frequency) * dt
        self.parameters = moved
        given = self.schedule.commands(np.array([self.phase]), moved.row()[None], self._body)
        return Command(given.contraction[0], given.hinge[0])

    @property
    def waves(self) -> float:
        """Waves since the beginning."""
        return self.phase / (2.0 * np.pi)


class PlannedWave:
    """The wave of parameters that follow a plan, as a controller that looks at nothing.

    Parameters
    ----------
    plan : callable
        Time [s] -> GaitParameters asked for.
    generator : WaveGenerator
    """

    def __init__(self, plan: Callable[[float], GaitParameters], generator: WaveGenerator) -> None:
        self._plan, self._generator = plan, generator
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._generator.reset()
        self._time: float | None = None

    def step(self, t: float, _measurement: object) -> Command:
        """Return the command from time t [s] on."""
        dt = 0.0 if self._time is None else t - self._time
        self._time = t
        return self._generator.step(dt, self._plan(t))
