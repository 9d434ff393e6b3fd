"""What drives a worm: gaits, plain functions of time, and controllers, all as one thing that gives commands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np

from worm3d.command import Command, Commands
from worm3d.observation import Observation
from worm3d.values.arrays import FloatArray
from worm3d.worm import Worm


@runtime_checkable
class Gait(Protocol):
    """A pattern that becomes a function of time once it knows the worm."""

    def bind(self, worm: Worm) -> Callable[[float], Command]:
        """Return the commands over time [s]."""


@runtime_checkable
class Controller(Protocol):
    """Decides at every step from a measurement."""

    def reset(self) -> None:
        """Forget everything; a run begins."""

    def step(self, t: float, measurement: Any) -> Command:
        """Return the command from time t [s] on."""


Actuation = Gait | Controller | Callable[[float], Command]
"""Whatever `simulate` takes as actuation."""

Sensor = Callable[[Observation], Any]
"""Makes a measurement of an observation."""


class BadCommandError(ValueError):
    """The actuation returned something that cannot be applied."""


class Driver:
    """Commands of an actuation, as rows for the compiled steps.

    Parameters
    ----------
    actuation : Actuation or None
        None: the worm is left alone.
    worm : Worm
    sensor : Sensor or None
        For controllers; None: they see the observation itself.

    Raises
    ------
    ValueError
        If it is none of these things, or has a sensor without being a controller.
    """

    def __init__(self, actuation: Actuation | None, worm: Worm, sensor: Sensor | None) -> None:
        self.n, self._sensor = worm.segments, sensor
        self.controller: Controller | None = None
        self._at: Callable[[float], Command] = lambda t: Command(np.zeros((worm.segments, 2)))
        if isinstance(actuation, type):
            raise ValueError(
                f"actuation: got the class {actuation.__name__}, must be an object: {actuation.__name__}()"
            )
        if isinstance(actuation, Gait):
            self._at = actuation.bind(worm)
        elif isinstance(actuation, Controller):
            self.controller = actuation
            actuation.reset()
            getattr(sensor, "reset", lambda: None)()
        elif callable(actuation):
            self._at = actuation
        elif actuation is not None:
            raise ValueError(
                f"actuation: got {type(actuation).__name__}, must be a gait (with bind), a controller (with reset and "
                "step), or a function of time"
            )
        if not (sensor is None or (callable(sensor) and not isinstance(sensor, type))):
            raise ValueError(f"sensor: got {type(sensor).__name__}, must be a function of an Observation, or None")
        if sensor is not None and self.controller is None:
            raise ValueError("sensor: only a controller takes measurements; the actuation must have reset and step")

    @property
    def tabular(self) -> bool:
        """Whether `table` gives commands at once: the actuation has a method `commands`, as bound gaits have."""
        return self.controller is None and hasattr(self._at, "commands")

    def table(self, times: FloatArray) -> FloatArray | None:
        """Return the commands at K times as rows, shape (K, 5 N); None if they have to be asked for one by one."""
        if not self.tabular:
            return None
        given: Commands = self._at.commands(times)  # type: ignore[attr-defined]
        k = len(times)
        parts = (given.contraction.reshape(k, -1), given.force.reshape(k, -1), np.zeros((k, 1)), given.hinge)
        rows = np.hstack(parts)
        fits = rows.shape == (k, 5 * self.n) and np.isfinite(rows).all() and (given.contraction < 1.0).all()
        return rows if fits else None  # one by one it is told which is wrong

    def at(self, t: float) -> FloatArray:
        """Return the command at time t as a row, shape (5 N,)."""
        return self.row(self._at(t))

    def decide(self, observation: Observation) -> FloatArray:
        """Return what the controller commands now, as a row."""
        assert self.controller is not None
        seen = observation if self._sensor is None else self._sensor(observation)
        return self.row(self.controller.step(observation.time, seen))

    def row(self, command: Command) -> FloatArray:
        """Return a command as a row: contraction, force, and hinge angles behind one unused entry.

        Raises
        ------
        BadCommandError
            If it is no command, or one for another worm.
        """
        if not isinstance(command, Command):
            raise BadCommandError(f"actuation: returned a {type(command).__name__}, must return a worm3d.Command")
        if command.segments != self.n:
            raise BadCommandError(
                f"actuation: returned a command for {command.segments} segments, the worm has {self.n}"
            )
        return np.concatenate([command.contraction.ravel(), command.force.ravel(), [0.0], command.hinge])
