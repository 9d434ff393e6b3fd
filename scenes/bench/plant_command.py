"""`worm3d bench plant`: measure, print, and write `plant.json`, `plant.md` and `plant.png`."""

from __future__ import annotations

import json
from pathlib import Path

import typer

from scenes.bench import plant, plant_figure
from scenes.bench.plant import Study
from scenes.bench.plant_report import markdown, terminal_lines
from scenes.records import folder as folders
from scenes.records.drawing import save_figure
from scenes.records.files import write_bytes
from scenes.records.summary import without_nan

PICTURE = "plant.png"


def run(out: Path | None, *, quick: bool, with_rivals: bool, force: bool, quiet: bool) -> int:
    """Measure the plant, write what was found and return the exit code.

    Parameters
    ----------
    out : Path, optional
        Folder to write to; `runs/bench-plant-<time>` if left out.
    quick : bool
        Whether to measure short worms and runs only.
    with_rivals : bool
        Whether to measure other simulators too.
    force : bool
        Whether to write into a folder that has something in it.
    quiet : bool
        Whether to print nothing.

    Raises
    ------
    SceneError
        The folder cannot be used, the disc refused a file, or a run failed.
    """
    with folders.prepared(out, "bench-plant", force=force) as folder:
        study = plant.study(plant.QUICK if quick else plant.FULL, with_rivals=with_rivals, quiet=quiet)
        _write(folder, study)
        if not quiet:
            for line in terminal_lines(study):
                typer.echo(line)
            typer.echo(f"Written to {folder}: plant.md, plant.json, {PICTURE}")
    return 0


def _write(folder: Path, study: Study) -> None:
    text = json.dumps(without_nan(study.as_dict()), indent=2, ensure_ascii=False, allow_nan=False)
    write_bytes(folder / "plant.json", f"{text}\n".encode())
    write_bytes(folder / "plant.md", markdown(study, PICTURE).encode())
    save_figure(plant_figure.draw(study.speeds, study.growth, study.shares), folder / PICTURE)
