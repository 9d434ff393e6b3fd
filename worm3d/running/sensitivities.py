"""Sensitivities of a run: derivatives with respect to parameters of the commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from worm3d.physics.kernels import change
from worm3d.physics.kernels.layout import Layout
from worm3d.physics.media import Medium
from worm3d.recorded.series import heading
from worm3d.recorded.state import State
from worm3d.recorded.status import Status
from worm3d.running.actuation import Actuation, Driver
from worm3d.running.problem import Problem
from worm3d.running.start import GUARDED, place
from worm3d.solver.actuate import ask
from worm3d.solver.advance import LAST
from worm3d.solver.arrays import NEWTON_TOLERANCE
from worm3d.solver.guard import OK
from worm3d.solver.sensitivity import follow
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.documented import with_fields
from worm3d.values.spelling import Spelled, spelled

DIFFERENCE = 1e-6
"""Difference of a parameter for derivatives of commands, as a fraction of the larger of the parameter's magnitude and
1. With half and with double this value, the derivatives of a sine wave change by less than 1e-9 of their size. If a
command has a kink in a step, for example at the end of a contraction, the derivative is a mean of both sides."""

ActuationOf = Callable[[FloatArray], Actuation]
"""Function from parameters, shape (P,), to a gait or another function of time."""


@with_fields
@dataclass(frozen=True, eq=False)
class Sensitivities(Spelled):
    """A run of T instants of a worm of N segments, and its derivatives with respect to P parameters.

    The unit of a derivative is the unit of the series, divided by the unit of the parameter.
    """

    status: Status
    """DONE, or the reason why the last step failed. The series then end before this step."""
    time: FloatArray
    """Times, shape (T,) [s]."""
    joints: FloatArray
    """Positions of the joints, shape (T, N+1, 3) [m]."""
    com: FloatArray
    """Centre of mass, shape (T, 3) [m]."""
    chamber_length: FloatArray
    """Lengths of the chambers, left and right, shape (T, N, 2) [m]."""
    d_joints: FloatArray
    """Derivatives of `joints`, shape (T, N+1, 3, P)."""
    d_com: FloatArray
    """Derivatives of `com`, shape (T, 3, P)."""
    d_chamber_length: FloatArray
    """Derivatives of `chamber_length`, shape (T, N, 2, P)."""

    @property
    def heading(self) -> FloatArray:
        """Azimuth of the tail-to-head chord, unwrapped, shape (T,) [rad]."""
        return heading(self.joints)

    @property
    def d_heading(self) -> FloatArray:
        """Derivatives of `heading`, shape (T, P)."""
        chord, change = (each[:, -1, :2] - each[:, 0, :2] for each in (self.joints, self.d_joints))
        cross = chord[:, 0, None] * change[:, 1] - chord[:, 1, None] * change[:, 0]
        found: FloatArray = cross / (chord**2).sum(axis=1)[:, None]
        return found


class Sensed:
    """A worm that takes steps of constant length together with their sensitivities, and can start repeatedly.

    Parameters
    ----------
    problem : Problem
        The run. `Sensed.follow` gives the actuation and the number of steps.
    parameters : int
        Number P of parameters.

    Raises
    ------
    ValueError
        The worm has loads or a medium that depends on the strain, the ground is a `ClampedGround`, or the problem has
        a sensor, an external force or adaptive steps.
    """

    def __init__(self, problem: Problem, parameters: int) -> None:
        worm, given = problem.worm, (problem.external_force, problem.sensor, problem.accuracy)
        clamped = problem.world is not None and problem.world.clamped
        if worm.loads or type(worm.medium) is not Medium or clamped or any(each is not None for each in given):
            raise ValueError(
                "sensitivities: got a worm with loads or a medium, a ClampedGround, a sensor, an external force or an "
                "accuracy, must be a run without them; use differences of two runs instead"
            )
        placed = place(problem)
        self.problem, self.count, self.status = problem, arguments.whole("parameters", parameters), placed.status
        self._start, self._plant = placed.state, placed.plant.sensing(parameters)
        self._plant.arrays["numbers"][0, NEWTON_TOLERANCE] = problem.tolerance
        self._begin = self._plant.memory()

    def follow(self, actuation: ActuationOf, at: ArrayLike, steps: int, state: State | None = None) -> Sensitivities:
        """Return a run and the derivatives with respect to the parameters of the actuation.

        Parameters
        ----------
        actuation : callable
            Function from parameters to a gait, or to a function of time.
        at : array_like, shape (P,)
            Parameters.
        steps : int
            Number of steps.
        state : State, optional
            Start of the run: a state with memory of the same worm. The default is the initial state of the problem. The
            start does not depend on the parameters.
        """
        at, plant, n = arguments.array("parameters", at, (self.count,)), self._plant, self.problem.worm.segments
        start = self._start if state is None else state
        plant.remember(self._begin if state is None else state.memory)
        for name in ("point_kept", "node_kept", "chamber_kept", "joint_kept"):
            plant.arrays[name][:] = 0.0
        times = _times(start.time, self.problem.dt, steps)
        commands, changes = self._commands(actuation, at, times)
        if not start.memory:
            ask(plant.core, commands[0])
            self._begin_commands(np.where(plant.arrays["asked"][0] == commands[0], changes[0], 0.0))
        out = np.empty((steps + 1, 1 + self.count, 3 * (n + 1) + 3 + 2 * n))
        last = float(start.memory.get("remembers", np.zeros(1))[LAST])
        bdf2, dt = self.problem.integrator == "bdf2", self.problem.dt
        done, end = 0, OK
        if self.status is Status.DONE:
            done, end = follow(plant.core, commands[1:], changes[1:], out, dt, bdf2, last == dt)
        status = self.status if self.status is not Status.DONE else GUARDED[end]
        return _read(status, times[: done + 1], out[: done + 1], n)

    def _commands(self, actuation: ActuationOf, at: FloatArray, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the commands, shape (T, 5 N), and their derivatives, shape (T, P, 5 N)."""

        def rows(parameters: FloatArray) -> FloatArray:
            driver = Driver(actuation(parameters), self.problem.worm, None)
            if driver.controller is not None:
                raise ValueError("sensitivities: got a controller or a gait that senses, must be a function of time")
            found = driver.table(times)
            return np.array([driver.at(t) for t in times.tolist()]) if found is None else found

        difference = DIFFERENCE * np.maximum(1.0, abs(at))
        changes = [
            (rows(at + step) - rows(at - step)) / (2.0 * size)
            for step, size in zip(np.diag(difference), difference, strict=True)
        ]
        return np.ascontiguousarray(rows(at)), np.ascontiguousarray(np.stack(changes, axis=1))

    def _begin_commands(self, changes: FloatArray) -> None:
        """Set the changes of the commands at the start of the first step, shape (P, 5 N)."""
        worm, n = self.problem.worm, self.problem.worm.segments
        chambers = Layout(change.chamber_past(worm.actuator.compiled(), type(worm.hysteresis)))
        hinges = Layout(change.joint_past(worm.hinge_actuator.compiled()))
        kept = self._plant.arrays["chamber_kept"].reshape(self.count, chambers.rows, -1)
        for name, first in (("actuator_command_n", 0), ("actuator_force_command_n", 2 * n)):
            row = chambers.first(name)
            of = changes[:, first : first + 2 * n].reshape(self.count, n, 2)
            kept[:, row : row + 2, :n] = of.transpose(0, 2, 1)
        kept = self._plant.arrays["joint_kept"].reshape(self.count, hinges.rows, -1)
        kept[:, hinges.first("actuator_command_n"), : n - 1] = changes[:, 4 * n + 1 :]


def _times(start: float, dt: float, steps: int) -> FloatArray:
    """Return the times of a run that goes on from a time, equal bit for bit to the times of an uninterrupted run."""
    first = round(start / dt)
    offset = start - first * dt
    return np.arange(first, first + steps + 1, dtype=float) * dt + (0.0 if abs(offset) < 1e-9 * dt else offset)


def _read(status: Status, time: FloatArray, out: FloatArray, n: int) -> Sensitivities:
    """Return the series from the rows of `worm3d.solver.sensitivity.follow`."""
    parts = np.split(out, [3 * (n + 1), 3 * (n + 2)], axis=2)
    shapes = ((n + 1, 3), (3,), (n, 2))
    values = [each[:, 0].reshape(-1, *shape) for each, shape in zip(parts, shapes, strict=True)]
    changes = [
        np.moveaxis(each[:, 1:].reshape(len(time), -1, *shape), 1, -1)
        for each, shape in zip(parts, shapes, strict=True)
    ]
    return Sensitivities(status, time, *values, *changes)


@spelled
def sensitivities(problem: Problem, actuation: ActuationOf, parameters: ArrayLike) -> Sensitivities:
    """Return a run together with derivatives with respect to parameters of the actuation.

    The derivatives are exact while each contact keeps its regime of each time step: open, sliding or sticking, (FS1)
    and (FS2) in `worm3d.physics.kernels.change`. They describe small changes of the parameters, which do not move a
    change of regime from one time step to another. The run equals the run of `worm3d.simulate` bit for bit.

    Parameters
    ----------
    problem : Problem
        The run. The actuation of the problem is not used, and the initial state does not depend on the parameters.
    actuation : callable
        Function from the parameters, shape (P,), to a gait or to a function of time, for example
        ``lambda p: gaits.TravellingWave(amplitude=p[0], bias=p[1])``. The commands are differentiated by differences.
    parameters : array_like, shape (P,)
        Values of the parameters.

    Returns
    -------
    Sensitivities
        Series of the run [SI units] and their derivatives. A step that fails ends the series, see `status`.

    Raises
    ------
    ValueError
        An argument is invalid, or the run has parts without sensitivities: loads, a medium that depends on the strain,
        `ClampedGround`, a sensor, an external force, an accuracy or a controller.
    """
    arguments.instance("problem", problem, Problem, "a worm3d.Problem")
    arguments.function("actuation", actuation, "a function from parameters to a gait")
    at = np.atleast_1d(arguments.floats("parameters", parameters))
    if at.ndim != 1 or at.size == 0:
        raise ValueError(f"parameters: got shape {at.shape}, must be (P,) with at least one parameter")
    return Sensed(problem, at.size).follow(actuation, at, problem.steps)
