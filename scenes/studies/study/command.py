"""The command `worm3d study`: list the studies, run one study, or run all studies and write a common report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import typer

from scenes.language.errors import SceneError
from scenes.language.loader import SHIPPED_FOLDER, says
from scenes.models.loading import Scene
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.running.drawing import save_figure
from scenes.running.runner import EXIT_CODES
from scenes.studies.study.lessons import answers, lessons
from scenes.studies.study.report import (
    STUDY_FIGURE_FILE,
    STUDY_TABLE_FILE,
    STUDY_TEXT_FILE,
    document,
    numbers,
    together,
)
from scenes.studies.study.study import Grid
from scenes.sweep import command as sweeps
from scenes.sweep.links import given_keys
from scenes.sweep.plan import Source
from scenes.sweep.table import Table

REPORT = "report.md"
ACCURACY, INTEGRATOR = "run.accuracy", "run.integrator"
"""Keys of a scene that decide whether a run estimates its errors."""
CASE_ACCURACY = 0.01
"""Requested accuracy of the runs of a study. With 0.003, the errors are a third and the runs take twice as long. With
0.03, the runs take half as long."""


def shipped_studies() -> dict[str, Path]:
    """Return the files of the studies that ship with the program, by name."""
    return {path.stem: path for path in sorted((SHIPPED_FOLDER / "studies").glob("*.toml"))}


def list_studies() -> None:
    """Print the name and the description of each study that ships with the program."""
    for name, path in shipped_studies().items():
        typer.echo(f"{name}  {says(path)}")


def run(name: str, overrides: Sequence[str], out: Path | None, options: sweeps.Options) -> int:
    """Run a study and return the exit code. `name` is a shipped study, or any scene with a section [sweep]."""
    return _run(name, overrides, out, options, {})


def _run(name: str, overrides: Sequence[str], out: Path | None, options: sweeps.Options, found: dict[str, Grid]) -> int:
    def tell(folder: Path, scene: Scene, table: Table) -> Iterator[str]:
        if not scene.study:
            return
        grid = found[name] = Grid(scene, table)
        if not table.done.any():
            return
        from scenes.studies.study.figure import draw  # imports matplotlib

        write_bytes(folder / STUDY_TEXT_FILE, document(grid).encode())
        write_bytes(folder / STUDY_TABLE_FILE, numbers(grid))
        save_figure(draw(grid), folder / STUDY_FIGURE_FILE)
        yield from (*answers(grid), *lessons(grid))

    scene = shipped_studies().get(name, name)
    return sweeps.run(scene, with_accuracy(scene, overrides), out, options, tell)


def with_accuracy(scene: str | Path, overrides: Sequence[str]) -> Sequence[str]:
    """Return the overrides of a study, with `run.accuracy` added so that its runs estimate their errors.

    `run.accuracy` is not added if the model does not have this key, or if the scene or its sweep sets the accuracy or
    the integrator.
    """
    source = Source.of(scene, overrides)
    base = source.base()
    run = getattr(base.settings, "run", None)
    chosen = {ACCURACY, INTEGRATOR} & given_keys(base.sweep)
    if chosen or getattr(run, "accuracy", CASE_ACCURACY) is not None or getattr(run, "integrator", "") != "bdf2":
        return overrides
    return (*overrides, f"{ACCURACY}={CASE_ACCURACY}")


def run_all(out: Path | None, options: sweeps.Options) -> int:
    """Run all shipped studies, each in its own subfolder of `out`, and write `report.md` into `out`.

    If the studies were run in this folder before, only the missing cases run. If cases of a study fail, the other
    studies still run.

    Raises
    ------
    SceneError
        The folder contains other files, or a study cannot be run.
    """
    found: dict[str, Grid] = {}
    if out is not None and out.is_dir() and any(out.iterdir()) and not (options.force or (out / REPORT).is_file()):
        raise SceneError(f"{out} is not empty, and no folder of studies: choose another --out, or use it with --force")
    codes = []
    with folders.prepared(out, "studies", force=True) as folder:
        write_bytes(folder / REPORT, b"The studies have not come to their end: start them again.\n")
        for name in shipped_studies():
            codes.append(_run(name, (), folder / name, options, found))
            if codes[-1] == EXIT_CODES["interrupted"]:
                return codes[-1]
        write_bytes(folder / REPORT, together(found).encode())
        typer.echo(f"{folder / REPORT} is the common report of the studies")
    return EXIT_CODES["incomplete"] if any(codes) else 0
