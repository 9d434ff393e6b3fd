"""`worm3d fit`: fit keys of a scene, and write `fit.json`, `fit.toml` and `fit.png`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

import typer

from scenes.language.loader import find_scene
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.records.text import json_bytes
from scenes.running.drawing import save_figure
from scenes.running.runner import EXIT_CODES
from scenes.running.terminal import Interruption, busy, progress
from scenes.studies.fit import report
from scenes.studies.fit.fitting import Fit, fit
from scenes.studies.fit.trials import StoppedError

FIT_DATA_FILE, FIT_SCENE_FILE, FIT_FIGURE_FILE = "fit.json", "fit.toml", "fit.png"


def run(
    scene: str,
    to: Path,
    vary: Sequence[str],
    overrides: Sequence[str],
    out: Path | None,
    *,
    runs: int,
    force: bool,
    quiet: bool,
) -> int:
    """Fit, write and report; return the exit code. The default folder is `runs/fit-<scene>-<time>`.

    Raises
    ------
    SceneError
        As in `scenes.studies.fit.fit`, or the folder cannot be used.
    """
    name = find_scene(scene).stem
    with folders.prepared(out, f"fit-{name}", force=force) as folder:
        with Interruption() as interruption, ExitStack() as shown:
            shows: list[Callable[[int], None]] = []

            def go_on(done: int) -> bool:
                if done and not shows:  # after the first run, the scene, the keys and the data are known to be right
                    shows.append(
                        shown.enter_context(progress(f"fit of {name}, at most", runs, quiet=quiet, what="run"))
                    )
                for show in shows:
                    show(done)
                return not interruption.requested

            try:
                found = fit(scene, to, vary, overrides, runs, go_on)
            except StoppedError:
                typer.echo(f"{name}: stopped by Ctrl-C; nothing of this fit was kept", err=True)
                return EXIT_CODES["interrupted"]
        with busy("drawing", quiet=quiet):
            _write(found, folder)
        _tell(found, folder, quiet=quiet)
    return 0


def _write(found: Fit, folder: Path) -> None:
    from scenes.studies.fit import figure  # imports matplotlib

    write_bytes(folder / FIT_DATA_FILE, json_bytes(report.content(found)))
    write_bytes(folder / FIT_SCENE_FILE, report.scene(found).encode())
    save_figure(figure.draw(found)[0], folder / FIT_FIGURE_FILE)


def _tell(found: Fit, folder: Path, *, quiet: bool) -> None:
    for warning in report.warnings(found):
        typer.echo(f"warning: {warning}", err=True)
    if not quiet:
        for line in report.lines(found):
            typer.echo(line)
        typer.echo(f"  written to {folder}: {FIT_DATA_FILE}, {FIT_SCENE_FILE}, {FIT_FIGURE_FILE}")
