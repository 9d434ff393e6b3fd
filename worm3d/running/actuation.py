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
    """Command to a worm of N segments; frozen, with read-only arrays.

    Raises
    ------
    ValueError
        An array has the wrong shape, a value is not finite, or a contraction is 1 or more.
    """

    contraction: FloatArray
    """Contraction of each chamber as a fraction of its length, columns left and right, shape (N, 2).

    The commanded rest length is l0 (1 - contraction). A negative value lengthens the chamber.
    """
    hinge: FloatArray
    """Hinge angle of joints 1 to N-1, shape (N-1,) [rad]. A positive angle turns the segment ahead to the left."""
    force: FloatArray
    """Additional force along each chamber, columns left and right, shape (N, 2) [N]. A positive force contracts it."""

    def __init__(self, contraction: ArrayLike, hinge: ArrayLike = 0.0, force: ArrayLike = 0.0) -> None:
        c = arguments.floats("contraction", contraction)
        if (c >= 1.0).any():
            raise ValueError(f"contraction: got {c.max()}, must be below 1: a chamber cannot shorten to nothing")
        if c.ndim != 2 or c.shape[0] < 1 or c.shape[1] != 2:
            raise ValueError(
                f"contraction: got shape {c.shape}, must be (N, 2): a row per segment, columns left and right"
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
    """Unchecked commands at K instants. The arrays are those of `Command` with an additional first dimension K."""

    contraction: FloatArray
    """Contraction, shape (K, N, 2)."""
    hinge: FloatArray
    """Hinge angles, shape (K, N - 1) [rad]."""
    force: FloatArray
    """Additional forces, shape (K, N, 2) [N]."""


@runtime_checkable
class Gait(Protocol):
    """A pattern of motion that does not depend on a particular worm until it is bound to one."""

    def bind(self, worm: Worm) -> Callable[[float], Command] | Controller:
        """Return the commands for a worm as a function of time [s], or a controller if the gait uses sensors.

        The `step` of such a controller is called with the time at the end of a step and the measurement at the
        beginning of the step. Before the first step of a run, `step` is called with the start time and the measurement
        None. The actuators move from this first command to the next command.
        """


@runtime_checkable
class Controller(Protocol):
    """Feedback controller, which is called in every step with a measurement."""

    def reset(self) -> None:
        """Forget all earlier measurements. This method is called at the start of a run."""

    def step(self, t: float, measurement: Any) -> Command:
        """Return the command that holds from time t [s] on."""


Actuation = Gait | Controller | Callable[[float], Command]
"""Types that `simulate` accepts as actuation."""

Sensor = Callable[["Observation"], Any]
"""Function that turns an observation into a measurement."""


class BadCommandError(ValueError):
    """The actuation returned an object that is not a command for the worm."""


class Driver:
    """Source of the commands of a run, as rows for the compiled solver.

    Without an actuation, all commands are zero. A controller, or a gait with sensors, gets the measurement that
    `sensor` returns. Without a sensor, it gets the observation itself.

    Raises
    ------
    ValueError
        The actuation has a wrong type, or a sensor is given for an actuation that takes no measurements.
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
                "sensor: only a controller, or a gait that senses, takes measurements; the actuation must have reset "
                "and step"
            )

    @property
    def tabular(self) -> bool:
        """Whether `table` can return many commands at once, because the actuation has a method `commands`."""
        return self.controller is None and hasattr(self._at, "commands")

    def table(self, times: FloatArray) -> FloatArray | None:
        """Return the commands at K times as rows, shape (K, 5 N), or None if they have to be requested one by one."""
        if not self.tabular:
            return None
        try:
            return self.rows(self._at.commands(times), len(times))  # type: ignore[attr-defined]
        except EXCEPTIONS:  # in the user's code. Requests one by one then find the time, and the steps before it remain
            return None

    def rows(self, given: Commands, k: int) -> FloatArray | None:
        """Return K commands as rows, shape (K, 5 N), or None if any of them cannot be applied."""
        parts = (given.contraction.reshape(k, -1), given.force.reshape(k, -1), np.zeros((k, 1)), given.hinge)
        rows = np.hstack(parts)
        fits = rows.shape == (k, 5 * self.n) and np.isfinite(rows).all() and (given.contraction < 1.0).all()
        return rows if fits else None

    def at(self, t: float) -> FloatArray:
        """Return the command at time t as a row, shape (5 N,)."""
        return self.row(self._at(t))

    def first(self, t: float) -> FloatArray | None:
        """Return the command at the start of a run as a row, or None for a controller that is not part of a gait."""
        if self.controller is None:
            return self.at(t)
        return self.row(self.controller.step(t, None)) if self._is_gait else None

    def decide(self, observation: Observation, end: float) -> FloatArray:
        """Return the controller's command for a step that ends at the time `end` [s], as a row."""
        assert self.controller is not None
        seen = observation if self._sensor is None else self._sensor(observation)
        return self.row(self.controller.step(end if self._is_gait else observation.time, seen))

    def row(self, command: Command) -> FloatArray:
        """Return a command as a row: contraction, force, an unused entry, and hinge angles.

        Raises
        ------
        BadCommandError
            The object is not a `Command`, or has another number of segments than the worm.
        """
        if not isinstance(command, Command):
            raise BadCommandError(f"actuation: returned a {type(command).__name__}, must return a worm3d.Command")
        if command.segments != self.n:
            raise BadCommandError(
                f"actuation: returned a command for {command.segments} segments, the worm has {self.n}"
            )
        return np.concatenate([command.contraction.ravel(), command.force.ravel(), [0.0], command.hinge])
