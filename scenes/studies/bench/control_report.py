"""`worm3d study control`: run, print, and write `control.csv`, `control.md` and `control.png`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

import typer
from matplotlib.figure import Figure

from control import controllers
from scenes.language.errors import SceneError
from scenes.records import folder as folders
from scenes.records.text import csv_bytes
from scenes.running.packages import machine
from scenes.running.report import Block, Heading, Items, Picture, Report, Table, report_study
from scenes.running.terminal import counted, progress
from scenes.studies.bench import control
from scenes.studies.bench.control import CONTROLLERS, DONE, Case, Found, Study
from scenes.studies.bench.control_score import SCORE_COLUMNS, names, scores
from scenes.studies.bench.control_trials import CLASSES, QUICK, SHORT, chosen

CONTROL_FIGURE_FILE = "control.png"
LOST_TRIAL_EXIT_CODE = 5
"""Exit code of `worm3d study control` if a trial is lost, see `scenes.studies.bench.control.Found.status`."""
SAYS = (
    "Error of a run: 0 if the worm always does its task exactly, 1 if the worm stands still or does worse, or if the "
    "trial is lost. Score: geometric mean over the trials of the error divided by the error of pi_los. Real time: "
    "simulated seconds per second of computing time of simulator and controller together, in the slowest trial. Step: "
    "computing time of a controller in a control period, as a fraction of the period, median and 99th percentile, each "
    "in the trial where it is largest; a controller with more than 100 % is too slow."
)
METRICS = ("way", "offset_bl", "heading_deg", "real_time_factor", "step_share_p50", "step_share_p99")
"""Columns of `control.csv` after the error."""
CONTROLLER_COLOURS = ("#1f5a94", "#d9793a", "#a0a0a0", "#4f9d5d", "#8a5fa8", "#b8433f", "#4fa6a6")
"""Colours of the controllers, in turn."""


class Options(NamedTuple):
    """Options of the command."""

    seed: int = 0
    seeds: int = 1
    trials: int = 30
    only: Sequence[str] = ()
    guests: Sequence[str] = ()
    overrides: Sequence[str] = ()
    quick: bool = False
    workers: int = 1

    @property
    def cases(self) -> list[Case]:
        """Return all runs; SceneError for a mistake."""
        for name, least in (("seed", 0), ("seeds", 1), ("trials", 1), ("workers", 1)):
            if getattr(self, name) < least:
                raise SceneError(f"--{name}: got {getattr(self, name)}, must be at least {least}")
        only, count = (QUICK, len(CLASSES)) if self.quick and not self.only else (self.only, self.trials)
        trials = chosen(only, range(self.seed, self.seed + self.seeds), count)
        changed = (*(SHORT if self.quick else ()), *self.overrides)
        _require_controllers(self.guests)
        by = dict.fromkeys((*CONTROLLERS, *self.guests))
        found = [Case(each._replace(overrides=(*each.overrides, *changed)), name) for each in trials for name in by]
        for case in found:
            case.load()
        return found

    @property
    def says(self) -> str:
        """Return a description of the trials of the run."""
        seeds = f"seed {self.seed}" if self.seeds == 1 else f"the seeds {self.seed} to {self.seed + self.seeds - 1}"
        changed = f", with {' '.join(self.overrides)}" if self.overrides else ""
        only = f", only {', '.join(self.only)}" if self.only else ""
        return f"Trials of {seeds}{only}{', short ones' if self.quick else ''}{changed}"


def show(options: Options) -> int:
    """Print the trials as commands, and return the exit code."""
    for trial in dict.fromkeys(case.trial for case in options.cases):
        typer.echo(f"# {trial.name}\n{trial.command}")
    return 0


def run(out: Path | None, options: Options, *, quiet: bool) -> int:
    """Run the missing cases and return the exit code, which is 5 if a trial was lost.

    Raises
    ------
    SceneError
        An option is wrong, the folder cannot be used, or the disc refused a file.
    """
    cases = options.cases

    def study(folder: Path) -> Report:
        folders.made(folder / "cases")
        with progress("control", len(cases), quiet=quiet, what="run") as show:
            ended = control.study(cases, folder, options.workers, show)
        return report(ended, options.says)

    return report_study("bench-control", study, out, force=True, quiet=quiet)


def _require_controllers(names: Sequence[str]) -> None:
    """Raise SceneError if a name is not the name of a controller."""
    for name in names:
        try:
            controllers.controller(name)
        except ValueError as error:
            raise SceneError(f"--controller: {error}") from error


def _of_the_folder(study: Study) -> str:
    """Return a text with the numbers of cases that were kept from before, were repeated, and are new."""
    new = len(study.found) - study.kept - study.outdated
    return (
        f"{counted(len(study.found), 'run')}: {study.kept} kept from before, {study.outdated} repeated (their scene, "
        f"programs or map have changed), {new} new"
    )


def report(study: Study, says: str) -> Report:
    """Return the report of a study, given a description of its trials in `says`."""
    found = study.found
    lost = [f"{x.controller} lost {x.trial}: {x.status}" for x in found if x.status != DONE]
    tables = [Table.of(SCORE_COLUMNS, scores(found)), by_class(found)]
    on = machine()
    page: list[Block] = [
        Heading("How well worms keep to their tasks", 1),
        f"{says}. {SAYS}",
        *tables,
        Picture(CONTROL_FIGURE_FILE, "errors"),
        Items(lost),
        f"{on['cpu']}, {on['system']}, {on['date']}.",
    ]
    return Report(
        said=[says, *reversed(tables), SAYS, Items(lost), _of_the_folder(study)],
        pages={"control.md": page},
        files={"control.csv": as_csv(found)},
        pictures={CONTROL_FIGURE_FILE: draw(found)},
        exit_code=LOST_TRIAL_EXIT_CODE if lost else 0,
    )


def as_csv(found: Sequence[Found]) -> bytes:
    """Return the results as CSV, one line for each run."""
    runs = ((x.trial, x.kind, x.controller, x.status, x.error, *map(x.metrics.get, METRICS)) for x in found)
    return csv_bytes([("trial", "class", "controller", "status", "error", *METRICS), *runs])


def by_class(found: Sequence[Found]) -> Table:
    """Return a table of the median and the worst error of each controller in each class of trials."""
    of: dict[tuple[str, str], list[float]] = {}
    for each in found:
        of.setdefault((each.kind, each.controller), []).append(each.error)
    rows = []
    for kind in dict.fromkeys(each.kind for each in found):
        errors = [of[kind, name] for name in names(found)]
        rows.append((kind, str(len(errors[0])), *(f"{median(e):.3f}, {max(e):.3f}" for e in errors)))
    return Table(("median, worst", "trials", *names(found)), rows)


def draw(found: Sequence[Found]) -> Figure:
    """Return the figure: one point for the error of each controller in each trial."""
    trials = list(dict.fromkeys(each.trial for each in found))
    figure = Figure(figsize=(8.0, 1.6 + 0.22 * len(trials)), layout="constrained", dpi=120)
    axes = figure.subplots()
    axes.set_prop_cycle(color=CONTROLLER_COLOURS)
    for name in names(found):
        errors = {each.trial: each.error for each in found if each.controller == name}
        axes.plot(list(errors.values()), [trials.index(each) for each in errors], "o", label=name)
    axes.set(xscale="log", xlabel="error (1: the worm stands still)", ylim=(len(trials) - 0.5, -0.5))
    axes.set_yticks(range(len(trials)), trials)
    axes.grid(True, alpha=0.3)
    figure.legend(loc="outside upper center", ncols=4, fontsize=9)
    return figure
