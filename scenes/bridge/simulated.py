"""The command `worm3d robot`: the worm of a scene as a robot in real time."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import typer

import worm3d
from control.bridge.links import Impaired, Udp, opened
from control.bridge.robot import WATCHDOG, Robot, RobotSide, serve
from control.sensing.sensors import Sample, Sensors
from scenes.bridge.drive import MODELS
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
"""Time for which a simulated robot can run in addition to twice the duration of its scene [s]."""


@dataclass(frozen=True)
class Impairment:
    """Faults of the line of a simulated robot: delay and jitter [s], and probability of loss; each way."""

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0


class SimulatedRobot(Robot):
    """The worm of a scene in real time, from the first command on, with the sensors of the scene.

    A gait needs no sensors. Its robot has exact sensors of strain, place and heading, and those that the gait senses.
    """

    def __init__(self, scene: Scene) -> None:
        given = scene.settings
        self._sensors = sensors_of(given) if isinstance(given, ControlScene) else _exact(given)
        problem = problem_of(given, drive=(None, None))
        rows = round((2.0 * given.run.duration_s + SPARE) / given.run.dt_s / given.run.record_every)
        self._run = Run(replace(problem, duration=rows * given.run.record_every * given.run.dt_s))
        self.segments, self.status = problem.worm.segments, Status.DONE
        self._began = float("nan")

    def apply(self, command: worm3d.Command) -> None:
        """Advance the worm to the present time with a command."""
        now, run = time.monotonic(), self._run
        if np.isnan(self._began):
            self._began = now
        count = min(int((now - self._began) / run.dt) - run.done, run.steps - run.done)
        if count > 0 and self.status is Status.DONE:
            parts = (command.contraction, command.hinge, command.force)
            self.status = run.follow(Commands(*(np.repeat(each[None], count, axis=0) for each in parts)))

    def sample(self) -> Mapping[str, Sample]:
        """Return the samples that have arrived by now."""
        measured = self._sensors(self._run.observation())
        return {name: Sample(each.value, self._began + each.time) for name, each in measured.items()}

    @property
    def over(self) -> bool:
        """Whether the run has ended: it diverged, or its time is over."""
        return self.status is not Status.DONE or self._run.done == self._run.steps

    def result(self) -> worm3d.Result:
        """Return the true run up to now."""
        return self._run.result(self.status)


def _exact(scene: Any) -> Sensors:
    names = {"strain", "com", "heading", *getattr(gait_of(scene), "senses", ())}
    channels: dict[str, Any] = {"strain": None, "com": None, **channels_of(scene.sensor, names)}
    return Sensors(seed=scene.seed, **channels)


def _true(scene: Scene) -> Scene:
    """Return a scene of the same worm without its controller, which a robot does not know, for the true run."""
    if not isinstance(scene.settings, ControlScene):
        return scene
    shared = keys_in(SpatialScene)
    written = {name: value for name, value in tomllib.loads(scene.to_toml()).items() if name in shared}
    return trusted_scene({**written, "model": "worm"}, scene.name)


def run(scene: Scene, address: str, impaired: Impairment, out: Path | None, *, force: bool, quiet: bool) -> int:
    """Run a simulated robot until Ctrl-C, and return the exit code. With `out`, the true run is written there."""
    if scene.model.name not in MODELS:
        raise SceneError(f"robot: got a scene of the model {scene.model.name!r}, must be one of {', '.join(MODELS)}")
    say: Callable[[str], None] = (lambda text: None) if quiet else (lambda text: typer.echo(text, err=True))
    robot = SimulatedRobot(scene)
    try:
        plain = opened(address, listen=True)
    except (ValueError, ImportError) as error:
        raise SceneError(f"--listen: {error}") from error
    except OSError as error:
        raise DiscError(f"--listen: cannot open {address}: {error}") from error
    link = Impaired(plain, impaired.delay, impaired.jitter, impaired.loss, scene.settings.seed)
    say(f"{scene.name}: the robot listens at {address if not isinstance(plain, Udp) else f'port {plain.port}'}")
    with Interruption() as interruption:

        def goes_on(side: RobotSide) -> bool:
            return not (interruption.requested or robot.over)

        side = serve(robot, link, watchdog=WATCHDOG, period=scene.settings.run.dt_s, goes_on=goes_on)
    link.close()
    refused = ", ".join(f"{count} {reason.value}" for reason, count in side.inbox.refused.items()) or "none"
    say(f"{scene.name}: packets: {side.inbox.accepted} accepted; refused: {refused}; at rest {side.rests} times")
    if out is not None and side.begun:
        true = _true(scene)
        keep_run(true, outcome(robot.result(), true.settings), out, force=force, quiet=quiet)
    if robot.status.diverged:
        typer.echo(f"diverged: {robot.result().stop.sentence}", err=True)
    return EXIT_CODES["diverged" if robot.status.diverged else "done"]
