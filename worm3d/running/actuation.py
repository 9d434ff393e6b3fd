"""Actuation of a worm: commands, and a common interface to gaits, functions of time and controllers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from worm3d.physics.worm import Worm
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.documented import with_fields
from worm3d.values.named import EXCEPTIONS
from worm3d.values.read_only import ReadOnly

if TYPE_CHECKING:
    from worm3d.running.observation import Observation


@with_fields
@dataclass(frozen=True, init=False, eq=False)
class Command(ReadOnly):
    """Command to a worm of N segments. The object is immutable, and its arrays are read-only.

    Raises
    ------
    ValueError
        An array has an incorrect shape, a value is not finite, or a contraction is not below 1.
    """

    contraction: FloatArray
    """Shortening of each chamber [left, right], as a fraction of its length at rest, shape (N, 2).

    The commanded rest length is l0 (1 - contraction). A negative value lengthens the chamber.
    """
    hinge: FloatArray
    """Hinge angle of joints 1 to N-1, shape (N-1,) [rad]. A positive angle turns the segment ahead to the left."""
    force: FloatArray
    """Additional force along each chamber, columns left and right, shape (N, 2) [N]. A positive force contracts it."""

    def __init__(self, contraction: ArrayLike, hinge: ArrayLike = 0.0, force: ArrayLike = 0.0) -> None:
        c = arguments.floats("contraction", contraction)
        if (c >= 1.0).any():
            raise ValueError(f"contraction: got {c.max()}, must be below 1: a chamber cannot shorten to length 0")
        if c.ndim != 2 or c.shape[0] < 1 or c.shape[1] != 2:
            raise ValueError(
                f"contraction: got shape {c.shape}, must be (N, 2): one row per segment, columns left and right"
            )
        parts = {"contraction": (c, c.shape), "hinge": (hinge, (len(c) - 1,)), "force": (force, c.shape)}
        for name, (value, shape) in parts.items():
            object.__setattr__(self, name, arguments.array(name, value, shape, fill=True))

    @property
    def segments(self) -> int:
        """Number of segments N."""
        return len(self.contraction)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Command):
            return NotImplemented
        return all(np.array_equal(value, vars(other)[name]) for name, value in vars(self).items())

    __hash__ = None  # type: ignore[assignment]


class Commands(NamedTuple):
    """Commands at K times: the arrays of `Command` with a first dimension of length K, not yet checked."""

    contraction: FloatArray
    """Contraction, shape (K, N, 2)."""
    hinge: FloatArray
    """Hinge angles, shape (K, N - 1) [rad]."""
    force: FloatArray
    """Additional forces, shape (K, N, 2) [N]."""


@runtime_checkable
class Gait(Protocol):
    """A pattern of motion. For a given worm, `bind` returns the motion as a function of time or as a controller."""

    def bind(self, worm: Worm) -> Callable[[float], Command] | Controller:
        """Return the command as a function of time [s], or a controller that returns a command at each step.

        If a gait returns a controller, its `step` is called with the time of the end of each step, and with the
        measurement at the start of the step; the command applies at the end. Before the first step of a run, `step` is
        called once with the start time and the measurement None, for the command at the start of the run. In the
        first step the actuators ramp from this command to the command of the step.
        """


@runtime_checkable
class Controller(Protocol):
    """Computes a command from a measurement at every time step."""

    def reset(self) -> None:
        """Return to the initial state. The method is called at the start of a run."""

    def step(self, t: float, measurement: Any) -> Command:
        """Return the command that applies from time t [s]."""


Actuation = Gait | Controller | Callable[[float], Command]
"""Types that `simulate` accepts as actuation."""

Sensor = Callable[["Observation"], Any]
"""Function that turns an observation into a measurement."""


class BadCommandError(ValueError):
    """The actuation returned a value that is not a valid command for the worm."""


class Driver:
    """Source of the commands of a run, as arrays for the compiled code of a step.

    Without an actuation all commands are zero. A controller, or a gait with sensors, gets the measurement that `sensor`
    returns, or the observation itself if there is no sensor.

    Raises
    ------
    ValueError
        The type of the actuation is not supported, or there is a sensor but the actuation does not use measurements.
    """

    def __init__(self, actuation: Actuation | None, worm: Worm, sensor: Sensor | None) -> None:
        self.n, self._sensor = worm.segments, sensor
        self.controller: Controller | None = None
        self._at: Callable[[float], Command] = lambda t: Command(np.zeros((worm.segments, 2)))
        if isinstance(actuation, type):
            raise ValueError(
                f"actuation: got the class {actuation.__name__}, must be an object: {actuation.__name__}()"
            )
        self._is_gait = isinstance(actuation, Gait)
        given = actuation.bind(worm) if isinstance(actuation, Gait) else actuation
        if isinstance(given, Controller):
            self.controller = given
            given.reset()
            getattr(sensor, "reset", lambda: None)()
        elif callable(given):
            self._at = given
        elif given is not None:
            raise ValueError(
                f"actuation: got {type(actuation).__name__}, must be a gait (with bind), a controller (with reset and "
                "step), or a function of time"
            )
        if not (sensor is None or (callable(sensor) and not isinstance(sensor, type))):
            raise ValueError(f"sensor: got {type(sensor).__name__}, must be a function of an Observation, or None")
        if sensor is not None and self.controller is None:
            raise ValueError(
                "sensor: got an actuation that does not use measurements, must be a controller (with reset and step) "
                "or a gait that senses"
            )

    @property
    def tabular(self) -> bool:
        """Whether `table` returns all commands at once.

        This needs an actuation with a method `commands`, such as a gait without sensors that is bound to a worm.
        """
        return self.controller is None and hasattr(self._at, "commands")

    def table(self, times: FloatArray) -> FloatArray | None:
        """Return the commands at K times as rows, shape (K, 5 N), or None if `at` must be called for each time."""
        if not self.tabular:
            return None
        try:
            return self.rows(self._at.commands(times), len(times))  # type: ignore[attr-defined]
        except EXCEPTIONS:
            # The code of a user's actuation raised an error. If `at` is called for each time instead, the run knows the
            # time of the error, and keeps the earlier steps.
            return None

    def rows(self, given: Commands, k: int) -> FloatArray | None:
        """Return K commands as rows, shape (K, 5 N), or None if one of them is not valid for the worm."""
        parts = (given.contraction.reshape(k, -1), given.force.reshape(k, -1), np.zeros((k, 1)), given.hinge)
        rows = np.hstack(parts)
        fits = rows.shape == (k, 5 * self.n) and np.isfinite(rows).all() and (given.contraction < 1.0).all()
        return rows if fits else None

    def at(self, t: float) -> FloatArray:
        """Return the command at time t as a row, shape (5 N,)."""
        return self.row(self._at(t))

    def first(self, t: float) -> FloatArray | None:
        """Return the command at the start of a run as a row, shape (5 N,).

        Return None for a controller (unless a gait returned it): its first command needs a measurement.
        """
        if self.controller is None:
            return self.at(t)
        return self.row(self.controller.step(t, None)) if self._is_gait else None

    def decide(self, observation: Observation, end: float) -> FloatArray:
        """Return the controller's command for the step that ends at time `end` [s], as a row, shape (5 N,)."""
        assert self.controller is not None
        seen = observation if self._sensor is None else self._sensor(observation)
        return self.row(self.controller.step(end if self._is_gait else observation.time, seen))

    def row(self, command: Command) -> FloatArray:
        """Return a command as a row: contractions (2 N), forces (2 N), an unused number, and hinge angles (N - 1).

        Raises
        ------
        BadCommandError
            The value is not a `Command`, or it is for another number of segments.
        """
        if not isinstance(command, Command):
            raise BadCommandError(f"actuation: returned a {type(command).__name__}, must return a worm3d.Command")
        if command.segments != self.n:
            raise BadCommandError(
                f"actuation: returned a command for {command.segments} segments, must be for the worm's {self.n}"
            )
        return np.concatenate([command.contraction.ravel(), command.force.ravel(), [0.0], command.hinge])
