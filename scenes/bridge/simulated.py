"""The command `worm3d robot`: the worm of a scene as a robot in real time."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import typer

import worm3d
from control.bridge.links import Impaired, opened
from control.bridge.robot import Robot, serve
from control.sensing.sensors import Sample, Sensors
from scenes.bridge.drive import require_worm
from scenes.language.errors import DiscError, SceneError
from scenes.language.schema import keys_in
from scenes.models.control.build import sensors_of
from scenes.models.control.schema import ControlScene
from scenes.models.loading import Scene, trusted_scene
from scenes.models.sensors import channels_of
from scenes.models.worm.build import gait_of, problem_of
from scenes.models.worm.model import outcome
from scenes.models.worm.schema import SpatialScene
from scenes.running.runner import EXIT_CODES, keep_run
from scenes.running.terminal import Interruption
from worm3d.recorded.status import Status
from worm3d.running.actuation import Commands
from worm3d.running.run import Run

SPARE = 60.0
"""Time that a simulated robot can run in addition to twice the duration of the scene [s]."""

AT_ONCE, LAG = 0.1, 0.5
"""Longest time that a robot simulates between two packets, and longest time by which the motion lags [s]. Beyond this
lag, the motion loses time. With half these values, short pauses of the machine lose time. With double, a robot on a
machine that is too slow answers late."""


class SimulatedRobot(Robot):
    """The worm of a scene in real time, from the first command on, with the sensors of the scene.

    The robot of a scene with a gait has exact sensors of strain, place and heading, and the sensors of the gait.
    """

    def __init__(self, scene: Scene) -> None:
        given = scene.settings
        self._sensors = sensors_of(given) if isinstance(given, ControlScene) else _exact(given)
        problem = problem_of(given, drive=(None, None))
        rows = round((2.0 * given.run.duration_s + SPARE) / given.run.dt_s / given.run.record_every)
        self._run = Run(replace(problem, duration=rows * given.run.record_every * given.run.dt_s))
        self.segments, self.status = problem.worm.segments, Status.DONE
        self._began = float("nan")
        self.lost = 0.0
        """Time by which the motion lags, since the machine is too slow [s]."""

    def apply(self, command: worm3d.Command) -> None:
        """Advance the worm to the present time with a command."""
        now, run = time.monotonic(), self._run
        if np.isnan(self._began):
            self._began = now
        if (lost := now - self._began - run.done * run.dt - LAG) > 0.0 and not self.over:
            self._began, self.lost = self._began + lost, self.lost + lost
        due = int((now - self._began) / run.dt) - run.done
        count = min(due, max(1, round(AT_ONCE / run.dt)), run.steps - run.done)
        if count > 0 and self.status is Status.DONE:
            parts = (command.contraction, command.hinge, command.force)
            self.status = run.follow(Commands(*(np.repeat(each[None], count, axis=0) for each in parts)))

    def sample(self) -> Mapping[str, Sample]:
        """Return the samples that have arrived by now."""
        measured = self._sensors(self._run.observation())
        return {name: Sample(each.value, self._began + each.time) for name, each in measured.items()}

    @property
    def over(self) -> bool:
        """Whether the run has ended, by divergence or after its time."""
        return self.status is not Status.DONE or self._run.done == self._run.steps

    def result(self) -> worm3d.Result:
        """Return the true run up to now."""
        return self._run.result(self.status)


def _exact(scene: Any) -> Sensors:
    names = {"strain", "com", "heading", *getattr(gait_of(scene), "senses", ())}
    channels: dict[str, Any] = {"strain": None, "com": None, **channels_of(scene.sensor, names)}
    return Sensors(seed=scene.seed, **channels)


def _true(scene: Scene) -> Scene:
    """Return a scene of the same worm for the true run, without the controller, which a robot does not know."""
    if not isinstance(scene.settings, ControlScene):
        return scene
    shared = keys_in(SpatialScene)
    written = {name: value for name, value in tomllib.loads(scene.to_toml()).items() if name in shared}
    return trusted_scene({**written, "model": "worm"}, scene.name)


def run(
    scene: Scene, address: str, line: tuple[float, float, float], out: Path | None, *, force: bool, quiet: bool
) -> int:
    """Run a simulated robot until Ctrl-C, and return the exit code. With `out`, the true run is written there.

    `line` are the delay and the jitter of the line [s], and the probability of a loss, each way.
    """
    require_worm(scene, "robot")
    robot = SimulatedRobot(scene)
    try:
        plain = opened(address, listen=True)
    except ValueError as error:
        raise SceneError(f"--listen: {error}") from error
    except OSError as error:
        raise DiscError(f"--listen: cannot open {address}: {error}") from error
    link = Impaired(plain, *line, scene.settings.seed)
    if not quiet:
        typer.echo(f"{scene.name}: the robot listens at {address}", err=True)
    with Interruption() as stop:
        period = scene.settings.run.dt_s
        side = serve(robot, link, period=period, goes_on=lambda side: not (stop.requested or robot.over))
    link.close()
    refused = ", ".join(f"{count} {reason.value}" for reason, count in side.inbox.refused.items()) or "none"
    if not quiet:
        text = f"{side.inbox.accepted} packets accepted; refused: {refused}; at rest {side.rests} times"
        typer.echo(f"{scene.name}: {text}", err=True)
    if robot.lost > 0.0:
        typer.echo(f"warning: this machine is too slow: the motion of the robot lost {robot.lost:.2g} s", err=True)
    if out is not None and side.begun:
        true = _true(scene)
        return keep_run(true, outcome(robot.result(), true.settings), out, force=force, quiet=quiet)
    if robot.status.diverged:
        typer.echo(f"diverged: {robot.result().stop.sentence}", err=True)
    return EXIT_CODES["diverged" if robot.status.diverged else "done"]
