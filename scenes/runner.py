"""From a scene to a folder of results, whatever happens on the way."""

from __future__ import annotations

from pathlib import Path

import typer

from scenes import folder as folders
from scenes import report
from scenes.drawing import animate, is_drawable, plot
from scenes.interrupt import Interruption
from scenes.kinds.base import Observer, Outcome
from scenes.loader import Scene
from scenes.progress import busy, progress
from scenes.record import Record, Variable
from scenes.store import FILE_NAME, save
from scenes.summary import Summary, write_summary
from scenes.versions import versions

EXIT_CODES = {"done": 0, "diverged": 3, "incomplete": 5, "interrupted": 130}
"""What a run ends the program with, by its status."""


def run_scene(scene: Scene, out: Path | None = None, *, force: bool = False, quiet: bool = False) -> int:
    """Run a scene, write everything that was computed, and return the exit code.

    Parameters
    ----------
    scene : Scene
        From `load_scene`.
    out : Path, optional
        Folder to write to; `runs/<scene>-<time>` if left out.
    force : bool
        Whether to replace the results in a folder that has some.
    quiet : bool
        Whether to print only what went wrong.

    Raises
    ------
    SceneError
        The folder cannot be used, or the disc refused a file.
    """
    folder = folders.prepared(out, scene.name, force=force)
    with Interruption() as interruption:
        with progress(scene.name, scene.settings.steps, quiet=quiet) as show:

            def observer(done: int) -> bool:
                show(done)
                return not interruption.requested

            record = simulate(scene, observer)
        folders.clear(folder, scene.kind)
        save(record, folder / FILE_NAME)
        write_summary(record.summary, report.timing(record), folder / folders.SUMMARY)
    with busy("drawing", quiet=quiet):
        _draw(record, scene, folder)
    _tell(record, scene, folder, quiet=quiet)
    return EXIT_CODES[record.status]


def simulate(scene: Scene, observer: Observer = lambda done: True) -> Record:
    """Run a scene and return its record; the observer is called with the number of finished steps."""
    outcome: Outcome = scene.kind.run(scene.settings, observer)
    return Record(
        name=scene.name,
        kind=scene.kind.name,
        scene=scene.to_toml(),
        status=outcome.status,
        sentence=outcome.sentence,
        seed=scene.settings.seed,
        versions=versions(),
        summary=Summary({"status": outcome.status, **outcome.summary}, outcome.reasons),
        variables=outcome.variables,
        timing=_timing(outcome),
    )


def _timing(outcome: Outcome) -> tuple[Variable, ...]:
    simulated = outcome.summary["duration_s"]
    factor = (simulated if isinstance(simulated, float) else 0.0) / outcome.wall_s
    return (
        Variable("wall_s", (), outcome.wall_s, "s", "wall time of the simulation"),
        Variable("real_time_factor", (), factor, "1", "simulated time over wall time"),
    )


def _draw(record: Record, scene: Scene, folder: Path) -> None:
    if not is_drawable(record):
        return
    plot(record, scene.kind, folder)
    if record.status != "interrupted":  # who presses Ctrl-C does not want to wait; `worm3d animate` draws it
        animate(record, scene.kind, folder / folders.ANIMATION)


def _tell(record: Record, scene: Scene, folder: Path, *, quiet: bool) -> None:
    if report.failed(record):
        typer.echo(report.failure(record, scene.kind), err=True)
    if not quiet:
        typer.echo(report.ending(record, scene.kind, folder))
