"""A run in progress.

`Run` requests commands and forces, passes them in chunks to the compiled solver, divides steps that do not converge,
and makes the result.
"""

from __future__ import annotations

import logging
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from worm3d.recorded.energy import Energy
from worm3d.recorded.series import COUNTERS, Recorded
from worm3d.recorded.state import State
from worm3d.recorded.status import Status, Stop
from worm3d.results.result import Result
from worm3d.running.actuation import Commands, Driver
from worm3d.running.observation import Observation
from worm3d.running.plant import HISTORIES
from worm3d.running.problem import Problem
from worm3d.running.start import GUARDED, Placed, place
from worm3d.solver.actuate import ask
from worm3d.solver.advance import LAST, MIN_STEP, NEXT, SINCE, SOLVES, advance, worst_residual
from worm3d.solver.arrays import ALLOWED, NEWTON_TOLERANCE
from worm3d.solver.guard import NO_CONVERGENCE, OK
from worm3d.solver.records import Records, gather, record
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.named import EXCEPTIONS

MAX_HALVINGS = 6
"""If a step does not converge, it is halved repeatedly, at most this many times."""

NEVER = 2**62
"""Number of steps between two rows of the result. The number is so large that no row is recorded."""

MAX_STEPS_UNOBSERVED = 1000
"""Largest number of steps in a call of the solver if a gait gives all commands in advance and there is no external
force. Otherwise the number is 50."""

BEAT = 0.1
"""A run with adaptive steps can be observed or interrupted at this interval [s]."""

COMMANDED = 1e-3
"""Interval between two commands of a gait, or between two values of the external force, in a run with adaptive steps
[s]. Between these times, commands and forces are interpolated."""

_LOG = logging.getLogger(__name__)


@dataclass
class Observer:
    """A function that is called with a run at the start, after every `every` steps, and at the end."""

    look: Callable[[Run], bool | None]
    """Function of the run. The run ends if the function returns False."""
    every: int = 1
    """Number of steps between two calls, which may change during the run."""


class Run:
    """A run in progress.

    Parameters
    ----------
    problem : Problem
    placing : callable, optional
        Function that returns the worm in the initial state, as `worm3d.running.start.place` does.
    allowed : float, optional
        Largest estimated error of a step [m]. The solver adapts the length of the steps to this error. In this case,
        `problem.dt` is the interval between two rows of the result, and between two calls of a controller. Without
        `allowed`, all steps have the length `problem.dt`.
    """

    def __init__(
        self, problem: Problem, placing: Callable[[Problem], Placed] = place, allowed: float | None = None
    ) -> None:
        plant, start, self.begun, self.settling, reason = placing(problem)
        plant.arrays["numbers"][0, NEWTON_TOLERANCE] = problem.tolerance
        self.driver = Driver(problem.actuation, problem.worm, problem.sensor)
        self.holds = self.driver.controller is not None  # commands are held if a step is taken in parts
        self.plant, self.external_force, self.period = plant, problem.external_force, problem.period
        self.dt, self.bdf2 = problem.dt, problem.integrator == "bdf2"
        self.every, self.steps = problem.record_every, problem.steps
        self.n, self.core = plant.n, plant.core
        self.records = plant.records(problem.rows, between=allowed is not None)
        self.counters = np.zeros((self.steps, len(COUNTERS)), dtype=np.int64)
        self.done, self.halved, self.last_share, self.wall = 0, 0, 1.0, 0.0
        self.complaint, self.residual, self.segment = reason, 0.0, 0
        self.first = round(start.time / self.dt)
        self.offset = start.time - self.first * self.dt
        if abs(self.offset) < 1e-9 * self.dt:
            self.offset = 0.0  # a resumed run has exactly the times of an uninterrupted run
        remembered = start.memory.get("remembers", np.zeros(1))[:SINCE]
        self.adapts, self.pace = allowed is not None, np.array([0.0, np.inf, 0.0, 0.0])
        self.parts = self.beat = 1
        if allowed is None:
            self.pace[LAST] = self.dt if remembered[LAST] == self.dt else 0.0
        else:
            plant.arrays["numbers"][0, ALLOWED] = allowed
            self.pace[:SINCE] = [*remembered, MIN_STEP][:SINCE]
            if not self.holds:
                self.parts = max(1, round(self.dt / COMMANDED))
                self.beat = max(1, round(BEAT / self.dt))
        try:
            first = None if start.memory else self.driver.first(self.time(0))
            if first is not None:
                ask(self.core, first)  # the actuators move from this command to the next
            self._forces(self.time(0))  # detects wrong shapes before the first step
        except EXCEPTIONS as error:
            if _is_ours(error):
                raise
            self.begun, self.complaint = Status.BAD_COMMAND, _complaint(error)
        record(self.core, self.records.block, 0)

    @cached_property
    def _now(self) -> Records:
        """Memory for the series of an instant between two rows of the result."""
        return self.plant.records(1)

    def time(self, k: float) -> float:
        """Return the time after k steps [s]."""
        return (self.first + k) * self.dt + self.offset

    def times(self, first: int, every: int, count: int, parts: int = 1) -> FloatArray:
        """Return `count` times: after `first` steps, and after every further `every` steps [s].

        If each step is divided into `parts`, `first` and `every` are numbers of parts.
        """
        steps = np.array(parts * self.first + first + every * np.arange(count), dtype=float)
        return steps / parts * self.dt + self.offset

    def _forces(self, t: float) -> FloatArray:
        if self.external_force is None:
            return np.zeros((0, self.n + 1))
        force = arguments.floats("external_force", self.external_force(t))
        if force.shape != (self.n + 1, 3):
            raise ValueError(
                f"external_force: got shape {force.shape}, must be ({self.n + 1}, 3): x, y, z on each joint"
            )
        if not np.isfinite(force).all():
            raise ValueError(f"external_force: got {force[~np.isfinite(force)][0]}, every value must be finite [N]")
        return np.ascontiguousarray(force.T)

    def finish(self, *observers: Observer) -> Result:
        """Take all steps and return the result."""
        status = self._seen(observers) if self.begun is Status.DONE else self.begun
        while status is Status.DONE and self.done < self.steps:
            status = self._chunk(self._until_seen(observers))
            if status is Status.DONE:
                status = self._seen(observers)
        return self.result(status)

    def follow(self, commands: Commands) -> Status:
        """Take a step with each of K commands instead of the commands of the run's own actuation; return the status.

        Raises
        ------
        ValueError
            The run has fewer than K steps left, or the commands cannot be applied to this worm.
        """
        count = len(commands.contraction)
        if count > self.steps - self.done:
            raise ValueError(f"commands: got {count}, must be at most the {self.steps - self.done} steps left")
        rows = self.driver.rows(commands, count)
        if rows is None:
            raise ValueError(f"commands: must be finite, with contractions below 1, for {self.n} segments")
        if self.begun is not Status.DONE:
            return self.begun
        self.holds, self.parts, self.beat = True, 1, 1
        began = perf_counter()
        forces = [] if self.external_force is None else [self._forces(t) for t in self.times(self.done + 1, 1, count)]
        status = self._advance(rows, forces)
        self.wall += perf_counter() - began
        return status

    def _until_seen(self, observers: tuple[Observer, ...]) -> int:
        """Return the number of steps until an observer has to be called, at most the largest number for one chunk."""
        known = self.driver.tabular and self.external_force is None
        turns = (observer.every - self.done % observer.every for observer in observers)
        most = min(MAX_STEPS_UNOBSERVED if known else 50, *turns, self.steps)
        return most + -(self.first + self.done + most) % self.beat  # up to the end of an interval `BEAT`

    def _seen(self, observers: tuple[Observer, ...]) -> Status:
        """Call the observers that are due; return the status."""
        for observer in observers:
            if self.done % observer.every >= self.beat and self.done < self.steps:
                continue
            try:
                goes_on = observer.look(self)
            except Exception as error:
                self.complaint = f"{type(error).__name__}: {error}"
                _LOG.error("the observer failed", exc_info=error)
                return Status.OBSERVER_FAILED
            if isinstance(goes_on, np.ndarray):
                goes_on = goes_on[()]  # an array without axes holds a single value
            if isinstance(goes_on, bool | np.bool_) and not goes_on and self.done < self.steps:
                return Status.INTERRUPTED
        return Status.DONE

    def _chunk(self, most: int) -> Status:
        """Request commands and forces, and take at most `most` steps; return the status."""
        began = perf_counter()
        count = 1 if self.driver.controller is not None else min(most, self.steps - self.done)
        times = self.times(self.done * self.parts + 1, 1, count * self.parts, self.parts)
        forces: list[FloatArray] = []
        commands = self.driver.table(times)
        if commands is None or self.external_force is not None:
            commands, forces = self._ask(times.tolist(), commands)
        status = self._advance(np.ascontiguousarray(commands), forces)
        self.wall += perf_counter() - began
        return Status.BAD_COMMAND if status is Status.DONE and self.complaint else status

    def _ask(self, times: list[float], table: FloatArray | None) -> tuple[FloatArray, list[FloatArray]]:
        """Return the commands and forces at some times, requested one by one up to the first wrong value.

        `table` has the commands if the actuation gives all of them at once. If it is None, they are requested too.
        """
        commands: list[FloatArray] = []
        forces: list[FloatArray] = []
        try:
            for k, t in enumerate(times):
                if self.external_force is not None:
                    forces.append(self._forces(t))
                commands.append(self._command(t) if table is None else table[k])
        except EXCEPTIONS as error:
            self.complaint = _complaint(error)
        return np.array(commands).reshape(-1, 5 * self.n), forces[: len(commands)]

    def _command(self, t: float) -> FloatArray:
        return self.driver.at(t) if self.driver.controller is None else self.driver.decide(self.observation(), t)

    def _advance(self, commands: FloatArray, forces: list[FloatArray]) -> Status:
        if forces:  # adaptive steps also need the force at the start. Steps of constant length ignore this row
            forces = [self._forces(self.time(self.done)) if self.adapts else forces[0], *forces]
        external, taken = np.array(forces).reshape(-1, 3, self.n + 1), 0
        while taken + self.parts <= len(commands):
            done, end = self._steps(commands[taken:], external[taken:], self.every, self.dt, self.bdf2)
            taken, self.done = taken + done * self.parts, self.done + done
            if end == OK:
                continue
            if end != NO_CONVERGENCE:
                return self._ended(end)
            status = self._stuck() if self.adapts else self._halve(commands[taken])
            if status is not Status.DONE:
                return status
            taken += 1
        return Status.DONE

    def _steps(self, commands: FloatArray, external: FloatArray, every: int, dt: float, bdf2: bool) -> tuple[int, int]:
        beats = self.parts, self.beat, self.first + self.done
        given = self.core, self.records.block, self.counters, commands, external, self.done, every, dt, bdf2
        found: tuple[int, int] = advance(*given, self.pace, beats)
        return found

    def _halve(self, command: FloatArray) -> Status:
        """Take a step in parts by implicit Euler.

        Afterwards, the values of the previous instant are stored as if the parts had been a whole step, because the
        next step uses them.
        """
        arrays = self.plant.arrays
        before, last = self.plant.memory(), self.pace[LAST]
        past = {name: arrays[name][: len(arrays[name]) // 2].copy() for name in HISTORIES}
        try:
            status = self._halves(command, self.done, 0.5, MAX_HALVINGS - 1)
        except EXCEPTIONS as error:
            self.complaint, status = _complaint(error), Status.BAD_COMMAND
        if status is not Status.DONE:
            self.plant.remember(before)  # the step is not complete, and its parts are undone
            self.pace[LAST] = last
            return status
        for name, rows in past.items():
            arrays[name][len(rows) :] = rows
        arrays["last"] /= self.last_share  # the motion of a whole step at the rate of the last part
        arrays["curve"][:] = 0.0
        self.done, self.halved, self.pace[LAST] = self.done + 1, self.halved + 1, self.dt
        if self.done % self.every == 0:
            record(self.core, self.records.block, self.done // self.every)
        return Status.DONE

    def _halves(self, held: FloatArray, begin: float, share: float, halvings: int) -> Status:
        """Take two equal parts of a step. The parameters are explained in `_part`."""
        status = self._part(held, begin, share, halvings)
        return self._part(held, begin + share, share, halvings) if status is Status.DONE else status

    def _part(self, held: FloatArray, begin: float, share: float, halvings: int) -> Status:
        """Take a part of a step, in smaller parts if necessary.

        `begin` and `share` are the start and the length of the part, in steps. `held` is a controller's command for the
        whole step. `halvings` is the number of halvings that are still allowed.
        """
        t = self.time(begin + share)
        command = held if self.holds else self.driver.at(t)
        force = np.array(2 * [self._forces(t)] if self.external_force is not None else []).reshape(-1, 3, self.n + 1)
        _, end = self._steps(command[None], force, NEVER, share * self.dt, False)
        if end != NO_CONVERGENCE:
            self.last_share = share
            return self._ended(end)
        if halvings == 0:
            return self._stuck()
        return self._halves(held, begin, share / 2.0, halvings - 1)

    def _stuck(self) -> Status:
        self.residual, worst = worst_residual(self.core)
        self.segment = min(worst, self.n - 1)
        return Status.NO_CONVERGENCE

    def _ended(self, end: int) -> Status:
        """Return the status for the way a step ended. If the step was refused, store the segment and the reason."""
        status = GUARDED[end]
        if status is not Status.DONE:
            self.segment, self.complaint = self.plant.refused(status)
        return status

    def observation(self) -> Observation:
        """Return the present observation for sensors."""
        return Observation.of(self.plant, self.time(self.done))

    @property
    def solves(self) -> float:
        """Number of steps that the solver has computed in a run with adaptive steps."""
        return float(self.pace[SOLVES])

    def recorded_now(self) -> Recorded:
        """Return all series at the present instant, with T = 1. Later steps overwrite this memory."""
        row, between = divmod(self.done, self.every)
        if between:
            gather(self.core, self._now.block, 0)
        series = self._now.fields(slice(1)) if between else self.records.fields(slice(row, row + 1))
        del series["energy"]
        return Recorded(worm=self.plant.worm, time=self.times(self.done, 1, 1), **series)

    def state(self) -> State:
        """Return the present state, with memory."""
        time, kept = self.time(self.done) + float(self.pace[SINCE]), SINCE if self.adapts else NEXT
        return self.plant.state(time, float(self.pace[LAST]) or np.inf, remembers=self.pace[:kept].copy())

    def result(self, status: Status) -> Result:
        """Return the result of all finished steps, with the given status."""
        rows, plant = self.done // self.every + 1, self.plant
        series = self.records.fields(slice(rows))
        energy = Energy.of(series.pop("energy"))
        counters: dict[str, Any] = dict(zip(COUNTERS, self.counters[: self.done].T, strict=True))
        tried = self.done + 1 if status.diverged else self.done
        return Result(
            worm=plant.worm,
            world=plant.world,
            gravity=plant.gravity,
            dt=self.dt,
            period=self.period,
            time=self.times(0, self.every, rows),
            **series,
            energy=energy,
            **counters,
            halved_steps=self.halved,
            settling=self.settling,
            state=self.state(),
            stop=Stop(status, tried, self.time(tried), self.residual, self.segment, self.complaint),
            wall_s=self.wall,
        )


def _is_ours(error: BaseException) -> bool:
    """Return whether the error is a ValueError raised by this package and not by the user's code."""
    raised_in = Path(traceback.extract_tb(error.__traceback__)[-1].filename)
    return isinstance(error, ValueError) and raised_in.is_relative_to(Path(__file__).parents[1])


def _complaint(error: BaseException) -> str:
    """Return the message of an error. Errors that were raised by the user's code are also logged."""
    if _is_ours(error):
        return str(error)
    _LOG.error("the actuation or the external force failed", exc_info=error)
    return f"{type(error).__name__}: {error}"
