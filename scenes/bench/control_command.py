"""`worm3d bench control`: run, print, and write `control.csv`, `control.md` and `control.png`."""

from __future__ import annotations

from pathlib import Path

import typer

from scenes.bench import control, control_figure, control_report
from scenes.bench.control import Plan, Row, Study
from scenes.bench.control_bars import BROKEN, verdicts
from scenes.bench.machine import machine
from scenes.commands.progress import counted, progress
from scenes.language.errors import SceneError
from scenes.records import folder as folders
from scenes.records.drawing import save_figure
from scenes.records.files import write_bytes

PICTURE = "control.png"
FAILED, BAR_BROKEN = 5, 6
"""Exit codes: runs that did not come to their end, or else bars that are not kept."""


def run(out: Path | None, *, seeds: int, quick: bool, quiet: bool) -> int:
    """Run what is not in the folder yet, write what was found and return the exit code.

    It is 5 if runs failed, else 6 if a bar is not kept, else 0; short runs are not held to bars.

    Parameters
    ----------
    out : Path, optional
        Folder to write to, or to go on in; `runs/bench-control-<time>` if left out.
    seeds : int
        Of each scene and controller.
    quick : bool
        Whether to run two short scenes only.
    quiet : bool
        Whether to print nothing.

    Raises
    ------
    SceneError
        The folder cannot be used, or the disc refused a file.
    """
    if seeds < 1:
        raise SceneError(f"--seeds: got {seeds}, must be at least 1")
    with folders.prepared(out, "bench-control", force=True) as folder:
        folders.made(folder / "cases")
        plan = Plan(control.QUICK if quick else control.FULL, 1 if quick else seeds)
        with progress("control", len(plan.cases()), quiet=quiet, what="run") as show:
            study = control.study(plan, folder, show)
        rows = list(control.rows(study.found))
        _write(folder, study, rows, judged=not quick)
        if not quiet:
            for line in control_report.terminal_lines(rows, judged=not quick):
                typer.echo(line)
            typer.echo(_of_the_folder(study))
            typer.echo(f"Written to {folder}: control.md, control.csv, {PICTURE}, cases/")
    return _exit_code(study, rows, judged=not quick)


def _exit_code(study: Study, rows: list[Row], *, judged: bool) -> int:
    if any(each.status != "done" for each in study.found):
        return FAILED
    return BAR_BROKEN if judged and any(verdict.word == BROKEN for verdict in verdicts(rows)) else 0


def _of_the_folder(study: Study) -> str:
    """Return which of the cases were there already."""
    new = len(study.found) - study.kept - study.outdated
    return (
        f"Of {counted(len(study.found), 'run')} {study.kept} kept from before, {study.outdated} run again (scene, "
        f"programs or map have changed since), {new} new"
    )


def _write(folder: Path, study: Study, rows: list[Row], *, judged: bool) -> None:
    write_bytes(folder / "control.csv", control_report.as_csv(study.found).encode())
    write_bytes(folder / "control.md", control_report.markdown(rows, machine(), PICTURE, judged=judged).encode())
    save_figure(control_figure.draw(study.found), folder / PICTURE)
