"""What drives a worm: commands, and gaits, plain functions of time and controllers as one thing that gives them."""

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
        An array of the wrong shape, a value that is not finite, or a contraction of 1 or more.
    """

    contraction: FloatArray
    """Shortening fraction of each chamber [left, right], shape (N, 2); negative ones lengthen.

    The commanded rest length is l0 (1 - contraction).
    """
    hinge: FloatArray
    """Hinge angle of joints 1 to N-1, shape (N-1,) [rad]; positive yaws the headward segment to the left."""
    force: FloatArray
    """Extra force of each chamber [left, right] along it, shape (N, 2) [N]; positive contracts."""

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
    """Commands at K instants, not checked yet; what `Command` holds, each with K in front."""

    contraction: FloatArray
    """Shape (K, N, 2)."""
    hinge: FloatArray
    """Shape (K, N - 1) [rad]."""
    force: FloatArray
    """Shape (K, N, 2) [N]."""


@runtime_checkable
class Gait(Protocol):
    """A pattern that becomes a function of time, or where it senses a controller, once it knows the worm."""

    def bind(self, worm: Worm) -> Callable[[float], Command] | Controller:
        """Return the commands over time [s], or what gives them from step to step.

        A controller that a gait returns is asked as the gait would be, for the command at the end of a step; what it
        is given was measured at the step's beginning. Before a run's first step it is asked once, with the
        measurement None, for the command at its start, from which the actuators' ramp begins.
        """


@runtime_checkable
class Controller(Protocol):
    """Decides at every step from a measurement."""

    def reset(self) -> None:
        """Forget everything; a run begins."""

    def step(self, t: float, measurement: Any) -> Command:
        """Return the command from time t [s] on."""


Actuation = Gait | Controller | Callable[[float], Command]
"""Whatever `simulate` takes as actuation."""

Sensor = Callable[["Observation"], Any]
"""Makes a measurement of an observation."""


class BadCommandError(ValueError):
    """The actuation returned something that cannot be applied."""


class Driver:
    """Commands of an actuation, as rows for the compiled steps; without one the worm is left alone.

    A controller, or a gait that senses, gets what `sensor` makes of an observation, or the observation itself.

    Raises
    ------
    ValueError
        No actuation, or a sensor for one that takes no measurements.
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
        """Whether `table` gives commands at once: the actuation has a method `commands`, as bound gaits have."""
        return self.controller is None and hasattr(self._at, "commands")

    def table(self, times: FloatArray) -> FloatArray | None:
        """Return the commands at K times as rows, shape (K, 5 N); None if they have to be asked for one by one."""
        if not self.tabular:
            return None
        try:
            return self.rows(self._at.commands(times), len(times))  # type: ignore[attr-defined]
        except EXCEPTIONS:  # of a user's own code: asked one by one, it is told where, and the steps before are kept
            return None

    def rows(self, given: Commands, k: int) -> FloatArray | None:
        """Return K commands as rows, shape (K, 5 N); None if any of them cannot be applied."""
        parts = (given.contraction.reshape(k, -1), given.force.reshape(k, -1), np.zeros((k, 1)), given.hinge)
        rows = np.hstack(parts)
        fits = rows.shape == (k, 5 * self.n) and np.isfinite(rows).all() and (given.contraction < 1.0).all()
        return rows if fits else None

    def at(self, t: float) -> FloatArray:
        """Return the command at time t as a row, shape (5 N,)."""
        return self.row(self._at(t))

    def first(self, t: float) -> FloatArray | None:
        """Return the command at the start of a run, as a row; None from a controller, which has decided nothing yet."""
        if self.controller is None:
            return self.at(t)
        return self.row(self.controller.step(t, None)) if self._is_gait else None

    def decide(self, observation: Observation, end: float) -> FloatArray:
        """Return what the controller commands now, for a step until `end` [s], as a row."""
        assert self.controller is not None
        seen = observation if self._sensor is None else self._sensor(observation)
        return self.row(self.controller.step(end if self._is_gait else observation.time, seen))

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
