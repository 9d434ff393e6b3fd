"""Run the paper's study and write it down: `paper.json`, `report.md`, the figures and the animation."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import typer
from matplotlib.figure import Figure

from planar.animation import Movie
from planar.published import Run
from scenes import folder as folders
from scenes.files import write_bytes, written_whole
from scenes.paper import figures, tables
from scenes.paper.claims import Claim, claims
from scenes.paper.differences import Difference, differences
from scenes.paper.report import markdown, terminal_lines
from scenes.paper.tables import Key, Row
from scenes.progress import busy, progress
from scenes.versions import versions

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
    folder = folders.prepared(out, "paper", force=force)
    runs = _simulate(quiet)
    rows = tables.rows(runs)
    with busy("judging the claims", quiet=quiet):
        verdicts = claims(runs, rows)
    with busy("measuring the differences between text and program", quiet=quiet):
        deviations = differences(runs[6, 2.0])
    _write(folder, rows, verdicts, deviations)
    with busy("drawing", quiet=quiet):
        _draw(folder, runs)
    if not quiet:
        for line in terminal_lines(rows, verdicts, deviations, shutil.get_terminal_size().columns):
            typer.echo(line)
        typer.echo(f"Written to {folder}: report.md, paper.json, figures 7 to 13, {MOVIE}")
    return 0


def _simulate(quiet: bool) -> dict[Key, Run]:
    keys = tables.keys()
    runs = {}
    with progress("the paper's runs", len(keys), quiet=quiet) as show:
        for done, key in enumerate(keys, start=1):
            runs[key] = tables.simulate(key)
            show(done)
    return runs


def _write(folder: Path, rows: Sequence[Row], verdicts: Sequence[Claim], deviations: Sequence[Difference]) -> None:
    content = {
        "rows": [row.as_dict() for row in rows],
        "claims": [claim.as_dict() for claim in verdicts],
        "differences": [difference.as_dict() for difference in deviations],
        "versions": dict(versions()),
    }
    write_bytes(folder / "paper.json", (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode())
    write_bytes(folder / "report.md", markdown(rows, verdicts, deviations).encode())


def _draw(folder: Path, runs: dict[Key, Run]) -> None:
    for stem, figure in figures.draw(runs).items():
        _save(figure, folder / f"{stem}.png")
    with written_whole(folder / MOVIE) as part:
        unfinished = part.with_name(f"{part.name}.gif")  # the writer goes by the ending
        _movie(runs[6, 2.0]).save(unfinished)
        unfinished.replace(part)


def _save(figure: Figure, path: Path) -> None:
    with written_whole(path) as part:
        figure.savefig(part, format="png", metadata={"Software": None})


def _movie(run: Run) -> Movie:
    net, p = run.net, run.parameters
    activation = np.vstack([run.activation[:1], run.activation])
    ground = float(net.rest[:, 1].min()) - p.ground_clearance
    return Movie(run.time, run.q[:, net.main], run.q[:, net.top], run.q[:, net.bottom], activation, ground)
