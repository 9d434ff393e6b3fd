"""The command `worm3d bridge`: the controller or gait of a scene drives a robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer

from control.bridge.bridge import Bridge, NoRobotError, Step, drive
from control.loop import Driver
from control.sensing.sensors import Measurement, Sample
from scenes.bridge import record as records
from scenes.language.errors import DiscError, SceneError
from scenes.models.control.build import controller_of
from scenes.models.control.play import Phased
from scenes.models.control.schema import ControlScene
from scenes.models.loading import Scene
from scenes.models.worlds.build import world_of
from scenes.models.worm.build import gait_of, start_of, worm_of
from scenes.records import folder as folders
from scenes.records.record import Record
from scenes.records.store import export_csv
from scenes.running import drawing, terminal
from scenes.running.runner import EXIT_CODES, keep
from scenes.running.terminal import Interruption, busy, progress
from worm3d.running.actuation import Controller

MODELS = ("worm", "worm_control")
"""Models whose scenes can drive a robot, and be one."""
WARM_UP = 4.0
"""Simulated time of a controller before the robot is called, to compile the controller's solvers [s]. The MPC
makes plans after the first three waves."""


def run(scene: Scene, address: str, lead: float, give_up: float, out: Path | None, *, force: bool, quiet: bool) -> int:
    """Drive a robot, write the results, and return the exit code. Parameters as in `worm3d bridge --help`.

    Raises
    ------
    SceneError
        The scene cannot drive a robot, the address is not valid, or no robot answers.
    DiscError
        The link cannot be opened, or the folder cannot be written.
    """
    require_worm(scene, "bridge")
    with folders.prepared(out, scene.name, force=force) as folder:
        record = _driven(scene, address, lead, give_up, quiet=quiet)
        with Interruption(), busy("drawing", quiet=quiet):
            _write(record, folder)
    status = EXIT_CODES[record.status]
    for warning in terminal.warnings(record):
        typer.echo(f"warning: {warning}", err=True)
    if status or not quiet:
        text = (f"{scene.name}: {record.sentence}", *records.lines(record), f"{'files':22}{folder}")
        typer.echo("\n  ".join(text), err=bool(status))
    return status


def require_worm(scene: Scene, command: str) -> None:
    """Raise SceneError unless a scene can drive a robot, and be one."""
    if scene.model.name not in MODELS:
        model, known = scene.model.name, ", ".join(MODELS)
        raise SceneError(f"{command}: got a scene of the model {model!r}, must be one of {known}")


def _driven(scene: Scene, address: str, lead: float, give_up: float, *, quiet: bool) -> Record:
    step, driver = step_of(scene)
    given, segments = scene.settings.run, scene.settings.worm.segments
    try:
        bridge = Bridge(address, segments, given.steps, period=given.dt_s, lead=lead)
    except ValueError as error:
        raise SceneError(f"--to: {error}") from error
    except OSError as error:
        raise DiscError(f"--to: cannot open {address}: {error}") from error
    try:
        with bridge, Interruption() as stop, progress(scene.name, given.steps, quiet=quiet) as show:

            def goes_on(tick: int) -> bool:
                show(tick)
                return not stop.requested

            ending = drive(step, bridge, give_up=give_up, goes_on=goes_on, say=lambda text: typer.echo(text, err=True))
    except NoRobotError as error:
        raise SceneError(f"bridge: {error}") from error
    return records.record_of(scene, bridge, ending, driver)


def step_of(scene: Scene) -> tuple[Step, Phased | None]:
    """Return the step of a scene's controller or gait, ready to run, and the controller."""
    given = scene.settings
    if isinstance(given, ControlScene):
        driver = Phased(controller_of(given))
        _warm(driver.controller, scene)
        driver.reset()
        return driver.step, driver
    bound = gait_of(given).bind(worm_of(given))
    if isinstance(bound, Controller):
        bound.reset()
        bound.step(0.0, None)
        return bound.step, None
    return lambda t, measurement: bound(t), None


def _warm(controller: Driver, scene: Scene) -> None:
    """Let a controller see a robot that lies still."""
    given, random = scene.settings, np.random.default_rng(0)
    worm = worm_of(given)
    com = start_of(given, worm, world_of(given.world)).joints.mean(axis=0)
    controller.reset()
    for k in range(round(WARM_UP / given.run.dt_s)):
        t, noise = k * given.run.dt_s, 1e-3 * random.standard_normal((worm.segments, 2))
        controller.step(t, Measurement(t, strain=Sample(noise, t), com=Sample(com + 1e-6 * k, t)))


def _write(record: Record, folder: Path) -> None:
    """Write the result, the summary, the tables for fits and for a replay, the figures and the page."""
    keep(record, folder)
    for name, table in records.tables(record).items():
        export_csv(table, folder / name)
    if len(record["time"]) > 1:
        pictures = drawing.pictures_of(record)
        drawing.plot(record, pictures, folder)
        if pictures.view is not None:
            drawing.view(record, pictures, folder / folders.VIEWER)
