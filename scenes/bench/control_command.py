"""`worm3d bench control`: run, print, and write `control.csv`, `control.md` and `control.png`."""

from __future__ import annotations

from pathlib import Path

import typer

from scenes import folder as folders
from scenes.bench import control, control_figure, control_report
from scenes.bench.control import Found, Plan
from scenes.bench.machine import machine
from scenes.drawing import save_figure
from scenes.errors import SceneError
from scenes.files import write_bytes
from scenes.progress import progress

PICTURE = "control.png"


def run(out: Path | None, *, seeds: int, quick: bool, quiet: bool) -> int:
    """Run what is not in the folder yet, write what was found and return the exit code, 5 if runs failed.

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
    folder = folders.prepared(out, "bench-control", force=True)
    folders.made(folder / "cases")
    plan = Plan(control.QUICK if quick else control.FULL, 1 if quick else seeds)
    with progress("control", len(plan.cases()), quiet=quiet, what="run") as show:
        found = control.study(plan, folder, show)
    rows = list(control.rows(found))
    _write(folder, found)
    if not quiet:
        for line in control_report.terminal_lines(rows):
            typer.echo(line)
        typer.echo(f"Written to {folder}: control.md, control.csv, {PICTURE}, cases/")
    return 5 if any(each.status != "done" for each in found) else 0


def _write(folder: Path, found: list[Found]) -> None:
    rows = list(control.rows(found))
    write_bytes(folder / "control.csv", control_report.as_csv(found).encode())
    write_bytes(folder / "control.md", control_report.markdown(rows, machine(), PICTURE).encode())
    save_figure(control_figure.draw(found), folder / PICTURE)
