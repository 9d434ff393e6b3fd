"""Running a scene, or the rest of a stored run, and writing the results to a folder."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import typer

from scenes.language.errors import SceneError
from scenes.models.base import Observer, Outcome, Watch
from scenes.models.loading import Scene, parse_scene
from scenes.records import folder as folders
from scenes.records.folder import RESULT, write_bytes
from scenes.records.record import Record, Summary
from scenes.records.store import save
from scenes.records.text import json_bytes
from scenes.running import terminal
from scenes.running.drawing import animate, clear_pictures, cut_short, draw_overview, is_drawable, model_of, view
from scenes.running.packages import versions
from scenes.running.terminal import Interruption, busy, progress
from worm3d.values import named
from worm3d.values.variable import Variable

EXIT_CODES = {"done": 0, "diverged": 3, "incomplete": 5, "interrupted": 130}
"""Exit code of the program for each status of a run or a sweep. A sweep is incomplete if a case failed."""


def run_scene(
    scene: Scene, out: Path | None = None, *, force: bool = False, quiet: bool = False, earlier: Record | None = None
) -> int:
    """Run a scene, or the rest of a run, write the results, and return the exit code.

    If the run fails or is interrupted, the results up to then are written.

    Parameters
    ----------
    scene : Scene
        The scene; for the rest of a run, the result of `lengthened`.
    out : Path, optional
        Folder for the results. The default is `runs/<scene>-<time>`.
    force, quiet : bool
        The options --force and --quiet of the command.
    earlier : Record, optional
        First part of the run, which the run continues.

    Raises
    ------
    SceneError
        If the folder cannot be used, or a file cannot be written.
    """
    with folders.prepared(out, scene.name, force=force) as folder:
        return _run_into(folder, scene, lambda: _simulate_patiently(scene, earlier, quiet=quiet), quiet=quiet)


def keep_run(scene: Scene, outcome: Outcome, out: Path, *, force: bool = False, quiet: bool = False) -> int:
    """Write the results of a run that has ended, and return the exit code. Parameters and errors as in `run_scene`."""
    with folders.prepared(out, scene.name, force=force) as folder:
        return _run_into(folder, scene, lambda: record_of(scene, outcome), quiet=quiet)


def lengthened(earlier: Record, more: float | None = None) -> Scene:
    """Return the scene for the continuation of a run, for `more` seconds or to the planned end.

    The scene includes the first part of the run, `earlier`.

    Raises
    ------
    SceneError
        If the run cannot be continued, or `more` is None and the run has reached its planned end.
    """
    model = model_of(earlier)
    if model.resume is None or not earlier.checkpoint:
        raise SceneError(f"{earlier.name}: has no checkpoint to go on from (model '{model.name}')")
    if earlier.status not in ("done", "interrupted"):
        raise SceneError(
            f"{earlier.name}: {earlier.sentence}; a continued run would end there again: {model.advice}, and run the "
            "scene anew"
        )
    planned = parse_scene(earlier.scene, earlier.name)
    run, done = planned.settings.run, earlier.sizes["step"]
    if done % run.record_every:
        raise SceneError(
            f"{earlier.name}: stopped after step {done}, between two stored states (run.record_every = "
            f"{run.record_every}), so that it cannot be continued; run the scene anew"
        )
    if more is None and done < planned.settings.steps:
        return planned
    if more is None:
        raise SceneError(
            f"{planned.name}: has come to its end ({run.duration_s:g} s); say how much longer it is "
            "to go on: --duration SECONDS_MORE"
        )
    if not (math.isfinite(more) and more > 0.0):
        raise SceneError(f"--duration: got {more} s, must be finite and above 0")
    if round(more / run.dt_s) < 1:
        raise SceneError(f"--duration: got {more} s, must be at least a time step (run.dt_s = {run.dt_s} s)")
    total = float(f"{done * run.dt_s + more:.12g}")  # without rounding errors, such as in 0.1 + 0.2
    return parse_scene(earlier.scene, earlier.name, [f"run.duration_s={total!r}"])


def _run_into(folder: Path, scene: Scene, recorded: Callable[[], Record], *, quiet: bool) -> int:
    kept, late = "nothing of this run was kept", Interruption()
    try:
        record = recorded()
        with late:
            keep(record, folder)
        kept = f"{folder / RESULT} is safe, 'worm3d plot {folder}' draws it"
        if late.requested:
            raise KeyboardInterrupt
        with busy("drawing", quiet=quiet):
            draw(record, scene, folder)
    except KeyboardInterrupt:
        typer.echo(f"{scene.name}: stopped by {late.cause}; {kept}", err=True)
        return EXIT_CODES["interrupted"]
    _tell(record, scene, folder, quiet=quiet)
    return EXIT_CODES[record.status]


def _simulate_patiently(scene: Scene, earlier: Record | None, *, quiet: bool) -> Record:
    """Simulate to the end or to the first Ctrl-C. A second Ctrl-C raises KeyboardInterrupt."""
    steps = scene.settings.steps - (earlier.sizes["step"] if earlier else 0)
    with Interruption() as interruption, progress(scene.name, steps, quiet=quiet) as show:

        def observer(done: int) -> bool:
            show(done)
            return not interruption.requested

        return simulate(scene, observer, earlier)


def keep(record: Record, folder: Path) -> None:
    """Write the result, then remove other files of an earlier run in the folder, and write the summary."""
    save(record, folder / RESULT)
    clear_pictures(folder)
    write_bytes(folder / folders.SUMMARY, json_bytes({**record.summary.to_dict(), **terminal.timing(record)}))


def simulate(
    scene: Scene, observer: Observer = lambda done: True, earlier: Record | None = None, how: Watch | None = None
) -> Record:
    """Run a scene and return the record.

    Parameters
    ----------
    scene : Scene
    observer : callable
        Function that is called with the number of finished steps. If it returns False, the run ends.
    earlier : Record, optional
        First part of the run. The simulation continues from its end, and the returned record contains the whole run.
    how : Watch, optional
        If given, a browser shows the run live.

    Raises
    ------
    SceneError
        If the scene cannot be simulated, or a user's own part raises an error.
    """
    try:
        outcome = _outcome(scene, observer, earlier, how)
    except SystemExit as error:  # must come from a user's own part, since worm3d never exits during a run
        raise SceneError(f"{scene.name}: a part of your own raised SystemExit({error.code!r})") from error
    except Exception as error:
        own = [] if isinstance(error, SceneError) else named.names_in(tomllib.loads(scene.to_toml()))
        if own:
            raise SceneError(f"{scene.name}: {named.raised(error, own)}") from error
        raise
    return record_of(scene, outcome)


def record_of(scene: Scene, outcome: Outcome) -> Record:
    """Return the record of a run of a scene."""
    return Record(
        name=scene.name,
        model=scene.model.name,
        scene=scene.to_toml(),
        status=outcome.status,
        sentence=outcome.sentence,
        seed=scene.settings.seed,
        versions=versions(),
        summary=Summary({"status": outcome.status, **outcome.summary}, outcome.reasons, outcome.errors),
        variables=outcome.variables,
        timing=_timing(outcome),
        checkpoint=outcome.checkpoint,
        run=outcome.run,
        parts=outcome.parts,
    )


def _outcome(scene: Scene, observer: Observer, earlier: Record | None, how: Watch | None) -> Outcome:
    if how is not None:
        assert scene.model.watch is not None  # checked in `scenes.running.viewing`
        watched: Outcome = scene.model.watch(scene.settings, observer, how)
        return watched
    if earlier is None:
        outcome: Outcome = scene.model.run(scene.settings, observer)
        return outcome
    assert scene.model.resume is not None  # checked in `lengthened`
    return scene.model.resume(scene.settings, earlier, observer)


def _timing(outcome: Outcome) -> tuple[Variable, ...]:
    simulated = outcome.summary["duration_s"]
    factor = simulated / outcome.wall_s if isinstance(simulated, float) and outcome.wall_s > 0.0 else 0.0
    return (
        Variable("wall_s", (), outcome.wall_s, "s", "wall time of the simulation"),
        Variable("real_time_factor", (), factor, "1", "simulated time over wall time"),
        *outcome.timing,
    )


def draw(record: Record, scene: Scene, folder: Path) -> None:
    """Draw the pictures of a run into a folder."""
    if not is_drawable(record):
        return
    draw_overview(record, scene.model, folder)
    if record.status != "interrupted":  # after Ctrl-C, users do not want to wait for an animation
        if scene.model.view is not None:
            view(record, scene.model, folder / folders.VIEWER)
        elif scene.model.animate is not None:
            animate(record, scene.model, folder / folders.ANIMATION)


def _tell(record: Record, scene: Scene, folder: Path, *, quiet: bool) -> None:
    if terminal.failed(record):
        typer.echo(terminal.failure(record, scene.model), err=True)
    for warning in terminal.warnings(record):
        typer.echo(f"warning: {warning}", err=True)
    if not quiet:
        typer.echo(terminal.ending(record, scene.model, folder))
        if scene.model.view is None and (line := cut_short(record)) and record.status != "interrupted":
            typer.echo(f"  {line}")
