"""Run the paper's study and write it down: `paper.json`, `report.md`, the figures and the animation."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
import typer
from matplotlib.figure import Figure

from planar import linkage
from planar.animation import Movie
from planar.published import Run
from scenes.commands.paper import corrected, corrected_figures, figures, tables
from scenes.commands.paper.claims import claims
from scenes.commands.paper.corrected_claims import corrected_claims
from scenes.commands.paper.differences import differences
from scenes.commands.paper.report import Study, markdown, terminal_lines
from scenes.commands.paper.tables import Key
from scenes.commands.progress import busy, progress
from scenes.records import folder as folders
from scenes.records.drawing import save_figure, save_movie
from scenes.records.files import write_bytes
from scenes.records.summary import without_nan
from scenes.records.versions import versions

K = TypeVar("K")
R = TypeVar("R")

MOVIE = "animation_6_segments.gif"


def run(out: Path | None, force: bool, quiet: bool) -> int:
    """Make all runs of the paper, write the study and return the exit code.

    Parameters
    ----------
    out : Path, optional
        Folder to write to; `runs/paper-<time>` if left out.
    force : bool
        Whether to write into a folder that has something in it.
    quiet : bool
        Whether to print nothing.

    Raises
    ------
    SceneError
        The folder cannot be used, or the disc refused a file.
    """
    with folders.prepared(out, "paper", force=force) as folder:
        runs = _simulate("the paper's runs", tables.keys(), tables.simulate, quiet)
        corrected_runs = _simulate("the corrected worm's runs", corrected.cases(), corrected.run, quiet)
        with busy("judging the claims", quiet=quiet):
            study = _study(runs, corrected_runs)
        with busy("drawing", quiet=quiet):
            drawn = figures.draw(runs)
            drawn |= corrected_figures.draw(corrected_runs, study.corrected, study.overstatements)
            _write(folder, study, list(drawn))
            _draw(folder, runs[6, 2.0], drawn)
        if not quiet:
            for line in terminal_lines(study, shutil.get_terminal_size().columns):
                typer.echo(line)
            typer.echo(
                f"Written to {folder}: report.md, paper.json, figures 7 to 13, those of the corrected worm, {MOVIE}"
            )
    return 0


def _simulate(title: str, keys: Sequence[K], simulate: Callable[[K], R], quiet: bool) -> dict[K, R]:
    runs = {}
    with progress(title, len(keys), quiet=quiet, what="run") as show:
        for done, key in enumerate(keys, start=1):
            runs[key] = simulate(key)
            show(done)
    return runs


def _study(runs: Mapping[Key, Run], corrected_runs: Mapping[corrected.Key, linkage.Run]) -> Study:
    rows, corrected_rows = tables.rows(runs), corrected.rows(corrected_runs)
    return Study(
        rows=rows,
        claims=claims(runs, rows),
        differences=differences(runs[6, 2.0]),
        corrected=corrected_rows,
        corrected_claims=corrected_claims(corrected_runs, corrected_rows),
        overstatements=corrected.overstatements(lambda key: corrected_runs[key].distance),
    )


def _write(folder: Path, study: Study, figure_stems: Sequence[str]) -> None:
    content = {**study.as_dict(), "versions": dict(versions())}
    text = json.dumps(without_nan(content), indent=2, ensure_ascii=False, allow_nan=False)
    write_bytes(folder / "paper.json", f"{text}\n".encode())
    write_bytes(folder / "report.md", markdown(study, [*(f"{stem}.png" for stem in figure_stems), MOVIE]).encode())


def _draw(folder: Path, main: Run, drawn: Mapping[str, Figure]) -> None:
    for stem, figure in drawn.items():
        save_figure(figure, folder / f"{stem}.png")
    save_movie(_movie(main), folder / MOVIE)


def _movie(run: Run) -> Movie:
    net = run.net
    activation = np.vstack([run.activation[:1], run.activation])
    return Movie(run.time, run.q[:, net.main], run.q[:, net.top], run.q[:, net.bottom], activation, run.ground)
