"""`worm3d study technologies`: run the worm of a scene on each technology, and write a table, a text and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from scenes.language.errors import SceneError
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.running.drawing import save_figure
from scenes.running.terminal import busy, each
from scenes.studies.technologies import report
from scenes.studies.technologies.limits import Verdict, judged
from scenes.studies.technologies.runs import Bench
from worm3d.physics.actuator_names import TECHNOLOGIES

TECHNOLOGY_TABLE_FILE, TECHNOLOGY_TEXT_FILE, TECHNOLOGY_FIGURE_FILE = (
    "technologies.csv",
    "technologies.md",
    "technologies.png",
)


def run(
    scene: str, overrides: Sequence[str], only: Sequence[str], out: Path | None, *, force: bool, quiet: bool
) -> int:
    """Run, write and report; return the exit code. The default folder is `runs/technologies-<scene>-<time>`.

    Raises
    ------
    SceneError
        The scene has no worm with a gait, a technology is unknown, or the folder cannot be used.
    """
    if unknown := [kind for kind in only if kind not in TECHNOLOGIES]:
        raise SceneError(f"--only: got {unknown[0]!r}, must be one of {', '.join(TECHNOLOGIES)}")
    bench = Bench(scene, overrides)
    with folders.prepared(out, f"technologies-{bench.name}", force=force) as folder:
        kinds = [kind for kind in TECHNOLOGIES if kind in only or not only]
        found = each("technologies", kinds, lambda kind: judged(bench, kind), "actuator", quiet=quiet)
        _keep(bench, list(found.values()), folder, quiet=quiet)
    return 0


def _keep(bench: Bench, verdicts: Sequence[Verdict], folder: Path, *, quiet: bool) -> None:
    from scenes.studies.technologies.figure import draw  # imports matplotlib

    write_bytes(folder / TECHNOLOGY_TABLE_FILE, report.table(verdicts))
    write_bytes(folder / TECHNOLOGY_TEXT_FILE, report.text(bench, verdicts).encode())
    with busy("drawing", quiet=quiet):
        save_figure(draw(bench, verdicts), folder / TECHNOLOGY_FIGURE_FILE)
    if not quiet:
        for one in verdicts:
            typer.echo(one.sentence)
        typer.echo(f"  written to {folder}: {TECHNOLOGY_TABLE_FILE}, {TECHNOLOGY_TEXT_FILE}, {TECHNOLOGY_FIGURE_FILE}")
