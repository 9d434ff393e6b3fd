"""Input of a run: the checked arguments of `worm3d.simulate` in one object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from worm3d.physics.friction import Friction
from worm3d.physics.friction_laws import Coulomb
from worm3d.physics.worm import Worm
from worm3d.recorded.state import State
from worm3d.running.actuation import Actuation, Sensor
from worm3d.running.plant import MIN_NEWTON_TOLERANCE
from worm3d.values import arguments, time_steps
from worm3d.values.arguments import bytes_of_run, require_room
from worm3d.values.arrays import BoolArray, FloatArray
from worm3d.values.documented import with_fields
from worm3d.values.spelling import Spelled
from worm3d.worlds import World

Integrator = Literal["bdf2", "implicit_euler"]

Force = Callable[[float], ArrayLike]
"""Function of time [s] that returns the force on each joint, shape (N+1, 3) [N]."""

SHORTEST_STEP = 1e-6
"""Shortest time step [s]. With shorter steps, rounding errors keep Newton's method above its tolerance, and it needs a
hundred times as many iterations."""


@with_fields
@dataclass(frozen=True, eq=False)
class Held(Spelled):
    """Coordinates that keep their initial values."""

    joints: ArrayLike = False
    """Whether x, y, z of each joint are held, as bool, shape (N+1, 3) or broadcastable to this shape."""
    roll: ArrayLike = False
    """Whether each segment is kept from rolling about its axis, as bool, shape (N,) or a single value."""
    bend: ArrayLike = False
    """Whether the chamber bend of each segment is held, as bool, shape (N,) or a single value."""

    def mask(self, segments: int) -> BoolArray:
        """Return a mask of the held coordinates, shape (5 (N+1),).

        Each block of 5 has x, y, z of a joint, and roll and bend of the segment ahead. Roll and bend of the last block
        do not exist, and are marked as held.

        Raises
        ------
        ValueError
            An array does not have the type bool, or has the wrong shape.
        """
        mask = np.ones((segments + 1, 5), dtype=bool)
        parts = (("joints", mask[:, :3]), ("roll", mask[:-1, 3]), ("bend", mask[:-1, 4]))
        for name, part in parts:
            value = _as_given(name, getattr(self, name))
            if value.dtype != bool:
                raise ValueError(
                    f"held.{name}: got {value.dtype} values, must be True or False for each coordinate, not the "
                    "numbers of the held coordinates"
                )
            try:
                part[:] = value
            except ValueError:
                raise ValueError(
                    f"held.{name}: got shape {value.shape}, must be {part.shape} (or one for all)"
                ) from None
        return mask.ravel()


def _as_given(name: str, value: ArrayLike) -> NDArray[Any]:
    try:
        return np.array(value)
    except Exception as error:  # lists of unequal length
        raise ValueError(f"held.{name}: got {type(value).__name__}, must be an array of True or False") from error


def held_mask(held: Held | ArrayLike | None, segments: int, *, flat: bool, clamped: bool) -> BoolArray:
    """Return a mask of the 5 (N+1) coordinates that the user or the model holds.

    If `flat` is True, y, roll and bend are held, so that the worm stays in a plane. If `clamped` is True, the joints' z
    are held (`worm3d.ClampedGround`).
    """
    given = held if isinstance(held, Held) else Held() if held is None else Held(joints=held)
    mask = given.mask(segments).reshape(segments + 1, 5)
    if flat:
        mask[:, [1, 3, 4]] = True
    if clamped:
        mask[:, 2] = True
    return mask.ravel()


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem(Spelled):
    """A run to be simulated. The object is frozen and validated.

    The attributes, their defaults and the errors are the same as for the parameters of `worm3d.simulate`.
    """

    worm: Worm
    world: World | None
    ground: Friction | None = None
    actuation: Actuation | None = None
    duration: float = 10.0
    dt: float = 0.01
    integrator: Integrator = "bdf2"
    gravity: ArrayLike = (0.0, 0.0, -9.81)
    external_force: Force | None = None
    state: State | None = None
    held: Held | ArrayLike | None = None
    sensor: Sensor | None = None
    record_every: int = 1
    settle_first: bool | None = None
    tolerance: float = MIN_NEWTON_TOLERANCE
    accuracy: float | None = None

    def __post_init__(self) -> None:
        self._check_types()
        self._check_numbers()
        needed = bytes_of_run(self.worm.segments, self.steps, self.record_every)
        remedy = "a larger record_every, a shorter duration, a longer dt or fewer segments"
        require_room("duration", needed, f"{self.steps:.3g} steps of {self.worm.segments} segments", remedy)
        if self.steps % self.record_every:
            raise ValueError(
                f"record_every: got {arguments.shown(self.record_every)}, must divide the {self.steps} time steps of "
                "the run, so that the last step is recorded"
            )
        # At later times rounding makes the steps unequal.
        if self.state is not None and abs(self.state.time) > 1e10 * self.dt:
            raise ValueError(
                f"state: its time of {self.state.time:g} s is too far from 0 for steps of {self.dt:g} s, must be nearer"
            )
        if self.world is not None and self.world.clamped and self.friction.law != Coulomb():
            name = self.friction.law.name
            raise ValueError(f"ground: got the law {name!r} on a ClampedGround, must be 'coulomb': its law is (P10)")
        if self.worm.chamber_offset == 0.0 and not self.held_mask.reshape(-1, 5)[:, 4].all():
            raise ValueError("chamber_offset: got 0 with free bends, must be above 0; or hold the bends with held.bend")

    def _check_types(self) -> None:
        arguments.instance("worm", self.worm, Worm, "a worm3d.Worm")
        arguments.instance("world", self.world, World | None, "a world such as worm3d.Plane(), or None")
        arguments.instance("ground", self.ground, Friction | None, "a worm3d.Friction, or None for the default")
        arguments.instance("state", self.state, State | None, "a worm3d.State, or None")
        if self.external_force is not None:
            arguments.function("external_force", self.external_force, "a function of time, or None")

    def _check_numbers(self) -> None:
        if not (self.weight.shape == (3,) and (np.abs(self.weight) <= arguments.MAX_MAGNITUDE).all()):
            raise ValueError(f"gravity: got {arguments.shown(self.gravity)}, must be finite, x, y and z [m/s^2]")
        for name in ("duration", "dt"):
            arguments.number(name, getattr(self, name), "s", gt=0.0)
        if self.dt < SHORTEST_STEP:
            raise ValueError(
                f"dt: got {self.dt!r} s, must be at least {SHORTEST_STEP:g} s: rounding shows in shorter steps"
            )
        time_steps.require_fit(self.dt, "the duration of the run", self.duration)
        self._check_resolved()
        arguments.whole("record_every", self.record_every)
        arguments.choice("integrator", self.integrator, get_args(Integrator))
        arguments.number("tolerance", self.tolerance, "body lengths", ge=MIN_NEWTON_TOLERANCE, le=1e-7)
        if self.accuracy is not None:
            arguments.number("accuracy", self.accuracy, ge=1e-4, le=0.1)
            if self.integrator != "bdf2":
                raise ValueError(f"accuracy: got one for {self.integrator!r}, must be None: only bdf2 adapts its steps")
        if self.settle_first is not None:
            arguments.flag("settle_first", self.settle_first)

    def _check_resolved(self) -> None:
        """Raise ValueError if the time steps are too long for the actuation."""
        if isinstance(self.actuation, type):  # a class instead of an object, which `Driver` refuses later
            return
        require_steps = getattr(self.actuation, "require_steps", None)
        if require_steps is not None:  # a gait has stricter rules than a number of steps in each period
            require_steps(self.dt)
        elif isinstance(self.period, int | float) and self.period > 0.0:
            time_steps.require_period(self.dt, "the period of the actuation", self.period)

    @property
    def steps(self) -> int:
        """Number of time steps."""
        return round(self.duration / self.dt)

    @property
    def rows(self) -> int:
        """Number of recorded instants, including the start."""
        return self.steps // self.record_every + 1

    @cached_property
    def friction(self) -> Friction:
        """Coefficients of friction. The default is `Friction()`."""
        return Friction() if self.ground is None else self.ground

    @cached_property
    def weight(self) -> FloatArray:
        """Gravity, shape (3,) [m/s^2]."""
        return arguments.floats("gravity", self.gravity)

    @cached_property
    def held_mask(self) -> BoolArray:
        """Mask of the coordinates that stay fixed, including the coordinates that the model holds, shape (5 (N+1),)."""
        clamped = self.world is not None and self.world.clamped
        return held_mask(self.held, self.worm.segments, flat=self.worm.flat, clamped=clamped)

    @property
    def period(self) -> float | None:
        """Period of the actuation [s], over which speeds are averaged. None if the actuation has no period."""
        period: float | None = getattr(self.actuation, "period", getattr(self.actuation, "T_wave", None))
        return period
