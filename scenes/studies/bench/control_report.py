"""`worm3d bench control`: run, print, and write `control.csv`, `control.md` and `control.png`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
import typer
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from control import controllers
from scenes.language.errors import SceneError
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.records.text import Cells, aligned, csv_bytes, markdown_table
from scenes.running.drawing import save_figure
from scenes.running.packages import machine
from scenes.running.terminal import counted, progress
from scenes.studies.bench import control
from scenes.studies.bench.control import BLIND, CONTROLLERS, METRICS, PERIOD, Found, Plan, Row, Study
from scenes.studies.bench.control_bars import BROKEN, MPC, RIVAL, Verdict, verdicts
from scenes.studies.bench.control_score import HEADER, cells, names
from scenes.studies.bench.control_trials import METRIC, QUICK, chosen

PICTURE = "control.png"
FAILED, BAR_BROKEN = 5, 6
"""Exit codes: runs that failed (`control.Row.failed`), or else bars of a complete run that are not kept."""

SAYS = (
    "The worst of all seeds, on the full 3D plant, without a sensor of the heading unless the scene has one. All is "
    "averaged over a moving window of one commanded period; the first three periods are left out, and from the settled "
    "bias and rms of the speed also three after each of its steps. BL: body lengths. A control step is all that a "
    "controller computes in a control period, its estimates included. open_loop looks at nothing: one seed is enough."
)
NAMES = tuple(METRICS)
TABLES = {
    "Speed [%], and its settling [periods]": NAMES[:5],
    "Heading [deg], and offset from the path [BL]": NAMES[5:10],
    "Offset of the head [BL], joining the path [periods], bias of the speed [mm/s]": NAMES[10:14],
    "Control steps [ms], and how many failed or took too long": NAMES[14:],
}
"""Title and metrics of each table."""
KEYS = ("scene", "controller", "seeds")
"""Columns of every table before its metrics."""
TOLD = {MPC: "MPC", RIVAL: "line-of-sight", BLIND: "open loop"}
SCORED = (
    "score: geometric mean over the trials of the error (rms of offset, heading or speed, whichever a trial is about, "
    "worst seed) over that of line-of-sight; a lost trial counts 10, none more."
)
VERDICTS = ("scene", "what", "found", "at most", "")
NO_VERDICTS = "These are not the complete runs of what ships that are held to bars."

PANELS = {
    "speed_error_rms_relative": ("speed error, rms [%]", 0.1),
    "cross_track_rms_bl": ("offset from the path, rms [BL]", 1e-3),
    "heading_error_rms_deg": ("heading error, rms [deg]", 0.1),
    "control_step_ms_p99": ("control step, 99th percentile [ms]", 0.1),
}
"""Label of each panel of the figure, and where its logarithmic scale begins; below it is linear down to zero."""
COLOURS = dict(zip(CONTROLLERS, ("#1f5a94", "#d9793a", "#a0a0a0"), strict=True))
GUESTS = ("#4f9d5d", "#8a5fa8", "#b8433f", "#4fa6a6")
"""Colours of further controllers, in turn."""


def run(
    out: Path | None, *, seeds: int, quick: bool, quiet: bool, guests: Sequence[str] = (), trials: Sequence[str] = ()
) -> int:
    """Run what is not in the folder yet, write what was found and return the exit code; options as of the command.

    It is 5 if runs failed, else 6 if a bar is not kept, else 0. Bars are for complete runs of what ships: not for short
    runs, chosen trials, or runs with controllers of others.

    Raises
    ------
    SceneError
        The folder cannot be used, or the disc refused a file.
    """
    if seeds < 1:
        raise SceneError(f"--seeds: got {seeds}, must be at least 1")
    judged = not (quick or guests or trials)
    asked = QUICK if quick and not trials else chosen(trials)
    _require_controllers(guests)
    plan = Plan(asked, 1 if quick else seeds, tuple(dict.fromkeys((*CONTROLLERS, *guests))))
    with folders.prepared(out, "bench-control", force=True) as folder:
        folders.made(folder / "cases")
        with progress("control", len(plan.cases()), quiet=quiet, what="run") as show:
            study = control.study(plan, folder, show)
        rows = list(control.rows(study.found))
        write_bytes(folder / "control.csv", as_csv(study.found))
        write_bytes(folder / "control.md", markdown(rows, machine(), PICTURE, judged=judged).encode())
        save_figure(draw(study.found), folder / PICTURE)
        if not quiet:
            for line in terminal_lines(rows, judged=judged):
                typer.echo(line)
            typer.echo(_of_the_folder(study))
            typer.echo(f"Written to {folder}: control.md, control.csv, {PICTURE}, cases/")
    if any(each.status != "done" for each in study.found):
        return FAILED
    return BAR_BROKEN if judged and any(verdict.word == BROKEN for verdict in verdicts(rows)) else 0


def _require_controllers(names: Sequence[str]) -> None:
    """Raise SceneError for what is no controller."""
    for name in names:
        try:
            controllers.controller(name)
        except ValueError as error:
            raise SceneError(f"--controller: {error}") from error


def _of_the_folder(study: Study) -> str:
    """Return which of the cases were there already."""
    new = len(study.found) - study.kept - study.outdated
    return (
        f"Of {counted(len(study.found), 'run')} {study.kept} kept from before, {study.outdated} run again (scene, "
        f"programs or map have changed since), {new} new"
    )


def as_csv(found: Sequence[Found]) -> bytes:
    """Return one line for each run."""
    names = (*NAMES, PERIOD)
    runs = ((each.trial, each.controller, each.seed, each.status, *map(each.metrics.get, names)) for each in found)
    return csv_bytes([("scene", "controller", "seed", "status", *names), *runs])


def markdown(rows: Sequence[Row], machine: dict[str, Any], picture: str, *, judged: bool = True) -> str:
    """Return the report; `picture` is the file beside it, which it shows; bars are left out unless `judged`."""
    bars = markdown_table(VERDICTS, map(_verdict_cells, verdicts(rows))) if judged else (NO_VERDICTS,)
    lines = (
        *("# How well worms keep to their references", "", SAYS, "", f"![the worst of the seeds]({picture})", ""),
        *(line for title in TABLES for line in (f"## {title}", "", *markdown_table(*_table(title, rows)), "")),
        *("## In one line each", "", SCORED, "", *markdown_table(HEADER, cells(rows)), ""),
        *("## In short", "", *markdown_table(("scene", "what", *(_told(name) for name in names(rows))), _short(rows))),
        *("", "## What the MPC is held to", "", *bars),
        *("", f"{machine['cpu']}, {machine['system']}, {machine['date']}, one core."),
    )
    return "\n".join(lines) + "\n"


def terminal_lines(rows: Sequence[Row], *, judged: bool = True) -> Iterator[str]:
    """Yield the lines to print; bars are left out unless `judged`."""
    for title in TABLES:
        yield from (title, *aligned(*_table(title, rows)), "")
    yield from aligned(VERDICTS, map(_verdict_cells, verdicts(rows))) if judged else (NO_VERDICTS,)
    yield from ("", *aligned(HEADER, cells(rows)), *wrap(SCORED, 100))


def _table(title: str, rows: Sequence[Row]) -> tuple[Cells, Iterator[Cells]]:
    """Return the header and the rows of a table."""
    names = TABLES[title]
    return (*KEYS, *(METRICS[name].column for name in names)), (_cells(row, names) for row in rows)


def _cells(row: Row, names: Sequence[str]) -> Cells:
    seeds = f"{row.seeds} ({row.failed} failed)" if row.failed else f"{row.seeds}"
    return (row.trial, row.controller, seeds, *(METRICS[name].number(row.metrics[name]) for name in names))


def _short(rows: Sequence[Row]) -> Iterator[Cells]:
    """Yield what each trial is about, of every controller."""
    of = {(row.trial, row.controller): row.metrics for row in rows}
    for trial in dict.fromkeys(row.trial for row in rows):
        name = METRIC[trial]
        values = (of.get((trial, controller), {}).get(name) for controller in names(rows))
        yield trial, METRICS[name].says, *map(METRICS[name].text, values)


def _told(controller: str) -> str:
    return TOLD.get(controller, controller)


def _verdict_cells(verdict: Verdict) -> Cells:
    text = METRICS[verdict.bar.metric].text
    return verdict.bar.trial, verdict.bar.says, text(verdict.found), text(verdict.bar.most), verdict.word


def draw(found: Sequence[Found]) -> Figure:
    """Return the figure: how well each controller did in each trial, every seed a point.

    The scales are logarithmic and go down to a true zero: a point on the left edge is a zero, no point is no value.
    """
    trials = list(dict.fromkeys(each.trial for each in found))
    figure = Figure(figsize=(11.0, 2.4 + 0.42 * len(trials)), layout="constrained", dpi=120)
    for axes, name in zip(figure.subplots(1, len(PANELS), sharey=True), PANELS, strict=True):
        _draw_panel(axes, found, trials, name)
    figure.axes[0].set_yticks(range(len(trials)), trials)
    figure.axes[0].set_ylim(len(trials) - 0.4, -0.6)
    handles = [Patch(color=colour, alpha=0.6, label=name) for name, colour in _colours(found).items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), fontsize=9)
    return figure


def _colours(found: Sequence[Found]) -> dict[str, str]:
    """Return the colour of each controller that was run."""
    there = dict.fromkeys(each.controller for each in found)
    others = (name for name in there if name not in COLOURS)
    more = {name: GUESTS[k % len(GUESTS)] for k, name in enumerate(others)}
    return {name: (COLOURS | more)[name] for name in (*COLOURS, *more) if name in there}


def _draw_panel(axes: Axes, found: Sequence[Found], trials: list[str], name: str) -> None:
    label, linear = PANELS[name]
    colours = _colours(found)
    height = 0.8 / len(colours)
    for k, (controller, colour) in enumerate(colours.items()):
        aside = (k - 0.5 * (len(colours) - 1)) * height
        for place, trial in enumerate(trials):
            of = (each.metrics[name] for each in found if (each.trial, each.controller) == (trial, controller))
            seen = METRICS[name].scale * np.abs([value for value in of if value is not None])
            if len(seen):
                axes.barh(place + aside, seen.max(), height, color=colour, alpha=0.6)
                axes.plot(seen, np.full(len(seen), place + aside), ".", color="black", ms=2.5, clip_on=False)
    axes.set_xscale("symlog", linthresh=linear, linscale=0.4)
    axes.set_xlim(left=0.0)
    axes.set_xlabel(label, fontsize=9)
    axes.grid(True, axis="x", alpha=0.3)
