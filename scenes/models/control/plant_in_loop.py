"""A controller that plans the wave on a copy of the plant, with exact sensitivities.

The controller has a worm of its own, which starts as the worm of the scene and gets the same commands. Therefore it
knows the state of the worm without sensors. Once per control period, it simulates the next two waves on this worm,
together with the sensitivities (FS1) to the amplitude, frequency, bias and hinge of the wave. Gauss-Newton steps then
improve these four numbers. The cost is a sum of squares: the offset (L2) of the mean place in each of the two waves,
the direction and the speed of the motion from the first to the second mean place, relative to the path, and the
differences from the previous wave and from the wave of the map.

The result is a limit of what a better model can gain, since no robot has an exact copy of itself. All other controllers
see the worm through its parameters and measurements only, which a contract in `pyproject.toml` verifies.
"""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import NamedTuple, Self

import numpy as np

from control.estimation.estimate import Estimate
from control.gaits.gait import BoundGait
from control.gaits.steering import GaitParameters
from control.loop import Choice, WaveController, rest
from control.planning.gauss_newton import PlanStatus
from control.planning.mpc import Plan
from control.sensing.sensors import Measurement
from control.task import ControlTask
from control.tracking.paths import offset
from worm3d import Command, Commands, Problem, Sensitivities, Status
from worm3d.running.places import place_kept
from worm3d.running.run import Run
from worm3d.running.sensitivities import Sensed
from worm3d.values.arrays import FloatArray

LEAST, GREATEST = np.array([0.05, 0.4, -0.3, -0.3]), np.array([0.4, 1.2, 0.3, 0.3])
"""Bounds of amplitude, frequency [Hz], bias and hinge [rad]."""
CHANGE, SPREAD = np.array([0.1, 0.2, 0.1, 0.1]), np.array([1.0, 0.4, 0.5, 1.0])
"""Differences from the previous wave, and from the wave of the map, that cost 1."""
OFFSET, SPEED_ERROR, REACH = 0.01, 0.05, 0.3
"""Offset that costs 1 [body lengths], relative error of the speed that costs 1, and distance at which an error of the
direction counts as an offset [body lengths]."""
MOST_ROLLOUTS = 3
"""Maximum number of simulations per plan."""


class _Rollout(NamedTuple):
    """A prediction: the residuals, their derivatives, and the predicted path of the centre of mass."""

    residuals: FloatArray
    jacobian: FloatArray
    path: FloatArray

    @property
    def cost(self) -> float:
        return float(self.residuals @ self.residuals)


class PlantInLoop(WaveController):
    """Controller that plans the wave on a copy of the plant, `scenes.models.control.plant_in_loop:PlantInLoop`."""

    plans = True

    def __init__(self, task: ControlTask, problem: Problem) -> None:
        if task.reference.path is None:
            raise ValueError("reference: got no path, must have one for the controller that plans on the plant")
        self._problem = problem
        self._sensed = Sensed(problem, len(LEAST))
        super().__init__(task)

    @classmethod
    def of(cls, task: ControlTask, problem: Problem) -> Self:  # type: ignore[override]
        """Return the controller for a task, on the worm of a run."""
        return cls(task, problem)

    def reset(self) -> None:
        """Return to the initial state, with a new worm."""
        super().reset()
        self._twin = Run(self._problem)
        self._last: FloatArray | None = None
        self._near: float | None = None

    def step(self, t: float, measurement: Measurement) -> Command:
        """Return the command from time t [s] on, and let the own worm follow the command."""
        command = super().step(t, measurement)
        if self._twin.done == self._twin.steps:  # a played run goes on after the duration of the scene
            self._twin = Run(replace(self._problem, state=self._twin.state()), place_kept)
        self._twin.follow(Commands(command.contraction[None], command.hinge[None], command.force[None]))
        return command

    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        if float(self.reference.speed(t)) <= 0.0:
            return Choice("stop", rest(self._target), "the reference stands, or goes backwards")
        began, path = perf_counter(), self.reference.path
        if path is None:
            return Choice("stop", rest(self._target), "the reference has no path, which this controller needs")
        self._near = float(path.project(self._twin.observation().com[:2], self._near))
        usual = self._usual(t)
        at = usual if self._last is None else self._last
        found = self._rollout(t, at, usual, at)
        rollouts, share, begun = 1, 1.0, at
        while rollouts < MOST_ROLLOUTS and found is not None:
            way = np.linalg.lstsq(found.jacobian, -found.residuals, rcond=None)[0]
            trial = np.clip(at + share * way, LEAST, GREATEST)
            tried, rollouts = self._rollout(t, trial, usual, begun), rollouts + 1
            if tried is not None and tried.cost < found.cost:
                at, found, share = trial, tried, 1.0
            else:
                share *= 0.3
        self._last = None if found is None else at
        if found is None:
            return Choice("gait", GaitParameters(*usual.tolist()), "the own worm did not finish its steps", failed=True)
        plan = Plan(
            time=t,
            step=self.control_period,
            inputs=at[None, :3],
            horizon=found.path,
            status=PlanStatus.BETTER,
            seconds=perf_counter() - began,
            iterations=rollouts,
            cost=found.cost,
        )
        return Choice("own", GaitParameters(*at.tolist()), "", plan)

    def _usual(self, t: float) -> FloatArray:
        """Return the wave of the identified map for the speed and the curvature of the path."""
        path, speed = self.reference.path, float(self.reference.speed(t))
        assert path is not None
        assert self._near is not None
        turn_rate = float(path.curvature(self._near)) * speed
        amplitude, frequency, steering = map(float, self.feed_forward(speed, turn_rate))
        wave = GaitParameters(amplitude, frequency).steered(self.task.mechanism, steering)
        return np.clip(wave.row(), LEAST, GREATEST)

    def _commands(self, times: FloatArray, wave: FloatArray) -> Commands:
        """Return the commands of the next steps for a wave. The first is in force already."""
        generator = copy.copy(self.generator)
        given = generator.steps(np.diff(times).tolist(), GaitParameters(*wave.tolist()))
        return Commands(*(np.concatenate([each[:1], each]) for each in given))

    def _rollout(self, t: float, at: FloatArray, usual: FloatArray, begun: FloatArray) -> _Rollout | None:
        """Return the prediction of a wave, or None if a step fails."""
        wave = round(1.0 / (self.feed_forward.frequency * self._problem.dt))

        def actuation(p: FloatArray) -> BoundGait:
            return BoundGait(partial(self._commands, wave=p), lambda dt: None)

        run = self._sensed.follow(actuation, at, 2 * wave, self._twin.state())
        if run.status is not Status.DONE:
            return None
        tracking, derivatives = self._tracking(t, run, wave)
        residuals = np.concatenate([tracking, (at - begun) / CHANGE, (at - usual) / SPREAD])
        jacobian = np.vstack([derivatives, np.diag(1.0 / CHANGE), np.diag(1.0 / SPREAD)])
        return _Rollout(residuals, jacobian, run.com[:, :2])

    def _tracking(self, t: float, run: Sensitivities, wave: int) -> tuple[FloatArray, FloatArray]:
        """Return the residuals of offsets, course and speed, and their derivatives, shapes (4,) and (4, 4)."""
        path, means = self.reference.path, []
        assert path is not None
        for rows in (slice(1, wave + 1), slice(wave + 1, None)):
            place, moved = run.com[rows, :2].mean(axis=0), run.d_com[rows, :2].mean(axis=0)
            s = float(path.project(place, self._near))
            e, azimuth, kappa = (float(f) for f in (offset(path, place, s), path.heading(s), path.curvature(s)))
            along, left = np.array([np.cos(azimuth), np.sin(azimuth)]), np.array([-np.sin(azimuth), np.cos(azimuth)])
            means.append((s, along @ moved / (1.0 - kappa * e), e, left @ moved))
        (s_1, ds_1, e_1, de_1), (s_2, ds_2, e_2, de_2) = means
        way, size = s_2 - s_1, OFFSET * self.worm.length
        wanted = float(self.reference.speed(t)) * wave * self._problem.dt
        course, d_course = (e_2 - e_1) / way, ((de_2 - de_1) * way - (e_2 - e_1) * (ds_2 - ds_1)) / way**2
        values = [e_1 / size, e_2 / size, REACH / OFFSET * course, (way / wanted - 1.0) / SPEED_ERROR]
        changes = [de_1 / size, de_2 / size, REACH / OFFSET * d_course, (ds_2 - ds_1) / (wanted * SPEED_ERROR)]
        return np.array(values), np.array(changes)
