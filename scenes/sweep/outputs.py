"""Outputs of a sweep in addition to the cases: a table, a data set, a summary, and figures.

The table `sweep.csv` has a row for each case. The data set `sweep.nc` has an array over the varied keys for each
quantity (NetCDF4, in the format of `worm3d.values.netcdf`). Their content depends neither on the order of the runs
nor on the machine, except for the computing times in the group `timing` of `sweep.nc`.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from scenes.language.sweep_section import SWEEP
from scenes.models.loading import Scene
from scenes.records.folder import SUMMARY, remove, write_bytes, written_whole
from scenes.records.record import Cell, Metric, Summary
from scenes.records.text import aligned, json_bytes
from scenes.running.drawing import save_figure
from scenes.running.packages import versions
from scenes.running.terminal import HEADLINES
from scenes.sweep.case_file import NOT_RUN, CaseResult
from scenes.sweep.design import Design, Varied
from scenes.sweep.plan import SEED_KEY
from scenes.sweep.table import OF_A_CASE, Table, cell, is_numeric
from worm3d.values import netcdf
from worm3d.values.arrays import FloatArray
from worm3d.values.metrics import METRIC_ROUNDING, named, written
from worm3d.values.netcdf import Content
from worm3d.values.variable import Variable

CSV, DATASET = "sweep.csv", "sweep.nc"
FIGURE = "sweep_{}.png"
"""Pattern for the file name of the figure of a metric."""

NOT_DRAWN = ("energy_balance_error",)
"""Headlines without a figure, since they only show the numerical accuracy of a run."""

MOST_ROWS = 1000
"""Largest number of cases, and of failed cases, that `summary.json` lists. `sweep.csv` lists all cases."""
MOST_LINES = 20
"""Largest number of cases in the report on the terminal, and of failed cases that are reported one by one."""
REPORTED = ("distance_m", "cost_of_transport")
"""Headlines that the report on the terminal shows for every model."""

PER_CASE = "a sweep has one for each case: see sweep.csv"
NONE_DONE = "no case came to its end"
NO_SINGLE_VALUE = (
    *("distance_m", "path_length_m", "mean_speed_m_s", "heading_change_deg", "work_contract_J", "work_friction_J"),
    *("cost_of_transport", "real_time_factor"),
)
"""Entries that every `summary.json` must have, but that have no single value for a sweep."""


def write_outputs(folder: Path, base: Scene, design: Design, results: Iterable[CaseResult]) -> Table:
    """Write the outputs of a sweep, each file completely or not at all, and return the table of the results.

    Parameters
    ----------
    folder : Path
    base : Scene
        Scene whose keys are varied.
    design : Design
    results : iterable of CaseResult
        Result of each case, in the order of `design.cases()`. A case without a file has a result with the status
        `not run`.

    Raises
    ------
    DiscError
        If a file cannot be written.
    """
    table = Table.of(design, results)
    summary = _summary(table)
    with written_whole(folder / CSV) as part:
        _write_csv(table, part)
    write_bytes(folder / DATASET, netcdf.packed(netcdf.signed(_content(base, table, summary))))
    write_bytes(folder / SUMMARY, json_bytes(summary.to_dict()))
    _draw(folder, base, table)
    return table


def headlines(base: Scene) -> dict[str, tuple[str, str]]:
    """Return the label and the unit of the main entries of the summary, by name."""
    given = (*HEADLINES, *base.model.headlines)
    return {name: (label, unit) for name, label, unit in given if name not in NOT_DRAWN}


def report(base: Scene, table: Table) -> list[str]:
    """Return a table for the terminal, as lines, with the varied values and the headlines of the first cases."""
    own = [name for name, _, _ in base.model.headlines][:3]  # at most three, so that the table is not too wide
    known = {name for name, column in table.figures.items() if np.isfinite(column).any()}
    shown = {name: each for name, each in headlines(base).items() if name in {*REPORTED, *own} & known}
    keys = [varied.key for varied in table.design.varied]
    header = [*keys, *(f"{label} [{unit}]" if unit else label for label, unit in shown.values()), "status"]
    rows = []
    for row, _ in zip(table.rows(), range(MOST_LINES), strict=False):
        figures = (_shown(row[name], unit) for name, (_, unit) in shown.items())
        rows.append([*(_shown(row[key]) for key in keys), *figures, str(row["status"])])
    more = [f"and {len(table) - MOST_LINES} more: see {CSV}"] if len(table) > MOST_LINES else []
    none = [label for name, label, _ in base.model.headlines if name in own and name in table.figures.keys() - known]
    reasons = dict.fromkeys(reason for reason, ended in zip(table.reasons, table.done, strict=True) if ended and reason)
    why = [f"no case has {', '.join(none)}: {next(iter(reasons), 'it has no value')}"] if none else []
    return [*aligned(header, rows), *more, *why]


def _shown(figure: Cell, unit: str = "") -> str:
    return written(figure, unit, 5) if isinstance(figure, float | int) else "none" if figure is None else figure


def _write_csv(table: Table, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        keys = [varied.key for varied in table.design.varied]
        case, *others = OF_A_CASE
        columns = dict.fromkeys([case, *keys, *others, *table.figures])  # without duplicates, if the seed is varied
        writer = csv.DictWriter(file, list(columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows(table.rows())


def _summary(table: Table) -> Summary:
    """Return the summary of the sweep: its status, numbers of cases, and lists of cases and of failed cases.

    The list of cases is left out if there are more than `MOST_ROWS`, and the list of failed cases is cut.
    """
    done, failed, skipped = int(table.done.sum()), int(table.failed.sum()), table.status.count(NOT_RUN)
    rows = [dict(row) for row in table.rows()] if len(table) <= MOST_ROWS else None
    failures = [row for row, lost in zip(table.rows(), table.failed, strict=True) if lost][:MOST_ROWS]
    keys = [varied.key for varied in table.design.varied]
    metrics: dict[str, Metric] = {
        "status": table.ending,
        "duration_s": _merged(table, "duration_s", np.sum) or 0.0,
        **dict.fromkeys(NO_SINGLE_VALUE),
        "energy_balance_error": _merged(table, "energy_balance_error", np.max),
        "newton_iterations_mean": _merged(table, "newton_iterations_mean", np.mean),
        "cases_total": len(table),
        "cases_done": done,
        "cases_diverged": table.status.count("diverged"),
        "cases_failed": failed - table.status.count("diverged"),
        "cases_not_run": skipped,
        "vary": ", ".join(keys),
        "cases": rows,
        "failures": [{name: row[name] for name in ("case", *keys, "status", "reason")} for row in failures],
    }
    reasons = dict.fromkeys(NO_SINGLE_VALUE, PER_CASE)
    reasons |= dict.fromkeys(("energy_balance_error", "newton_iterations_mean"), NONE_DONE)
    return Summary(metrics, {**reasons, "cases": f"more than {MOST_ROWS}: see {CSV}"})


def _merged(table: Table, name: str, merge: Any) -> float | None:
    column = table.figures.get(name, np.array([]))
    known = column[np.isfinite(column)]
    return float(merge(known)) if known.size else None


def _content(base: Scene, table: Table, summary: Summary) -> Content:
    """Return the results of a sweep as the content of a NetCDF4 file."""
    sizes = table.design.sizes
    keys = [varied.key for varied in table.design.varied]
    texts = {"case": "key of the case", "status": "how the case ended", "reason": "reason of the status"}
    cells = {"case": table.keys, "status": table.status, "reason": table.reasons}
    dims, shape = tuple(sizes), tuple(sizes.values())
    seed = Variable(SEED_KEY, dims, np.array(table.seeds).reshape(shape), "1", "seed of all random numbers")
    attributes = {
        "name": base.name,
        "model": SWEEP,
        "scene": base.to_toml(),
        "status": str(summary["status"]),
        "sentence": f"{summary['cases_done']} of {summary['cases_total']} cases came to their end",
        "seed": base.settings.seed,
        "versions": json.dumps(versions()),
        "summary": json.dumps({"status": summary["status"], "vary": summary["vary"], "reasons": {}}),
    }
    variables = (
        *map(_coordinate, table.design.varied),
        *(Variable(name, dims, np.array(cells[name]).reshape(shape), "1", text) for name, text in texts.items()),
        *([] if SEED_KEY in keys else [seed]),
        *_figures(table.figures, dims, shape),
    )
    return Content(attributes, {netcdf.ROOT: variables, netcdf.TIMING: tuple(_figures(table.timing, dims, shape))})


def _coordinate(varied: Varied) -> Variable:
    values = varied.values if is_numeric(varied) else [str(cell(value)) for value in varied.values]
    return Variable(varied.key, (varied.dim,), values, varied.unit or "1", varied.title or varied.key)


def _figures(columns: dict[str, FloatArray], dims: tuple[str, ...], shape: tuple[int, ...]) -> Iterator[Variable]:
    for name, column in columns.items():
        words, unit = named(name)
        yield Variable(name, dims, column.reshape(shape), unit or "1", words)


def _draw(folder: Path, base: Scene, table: Table) -> None:
    """Draw the headlines over the varied keys, and remove the figures of an earlier sweep.

    There are no figures for more than two varied keys, or for headlines that are zero in all cases.
    """
    for path in folder.glob(FIGURE.format("*")):
        remove(path)
    if len(table.design.varied) > 2:
        return
    from scenes.sweep.figures import draw  # imports matplotlib

    title = getattr(base.settings, "title", "") or base.name
    for name, (label, unit) in headlines(base).items():
        if (np.abs(table.figures.get(name, np.zeros(1))) > METRIC_ROUNDING.get(unit, 0.0)).any():
            figure = draw(table, name, f"{label} [{unit}]" if unit else label, title)
            save_figure(figure, folder / FIGURE.format(name))
