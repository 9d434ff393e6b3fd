"""Reports of studies in Markdown: the report of one study, and the common report of several studies."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from scenes.records.text import csv_bytes
from scenes.running.report import Block, Heading, Items, Picture, Table, markdown
from scenes.studies.study.lessons import answers, lessons, verdicts
from scenes.studies.study.study import Grid
from scenes.sweep.table import cell

STUDY_FIGURE_FILE, STUDY_TEXT_FILE, STUDY_TABLE_FILE = "study.png", "study.md", "study.csv"
"""Files of a study in its folder."""
MOST_ROWS = 48
"""Largest number of cases in the table of a study; `study.csv` has all cases."""
OFF = "± is the estimated error of a number, caused by the time steps"


def document(grid: Grid) -> str:
    """Return the report of one study."""
    return markdown(_study(grid, 1, ""))


def numbers(grid: Grid) -> bytes:
    """Return a CSV table with the figures of all cases, their errors, and the marked properties of each case."""
    places = range(len(grid.by.varied.values)) if grid.by is not None else range(1)
    axes = [axis for axis in (grid.x, grid.other, grid.by) if axis is not None]
    names = [name for each in grid.measures for name in (each.name, f"{each.name}_off")]
    rows: list[list[Any]] = [[*(axis.varied.key for axis in axes), *names, "marked"]]
    for place in places:
        columns = [each for m in grid.measures for each in (grid.values(m.name, place), grid.errors(m.name, place))]
        marks = grid.marked(place)
        for k, c in itertools.product(range(len(grid.x.varied.values)), range(len(grid.curves))):
            at = [cell(axis.varied.values[p]) for axis, p in zip(axes, _at(grid, k, c, place), strict=True)]
            marked = "; ".join(name for name, each in marks.items() if each[k, c])
            rows.append([*at, *(float(each[k, c]) for each in columns), marked])
    return csv_bytes(rows)


def _at(grid: Grid, x: int, curve: int, by: int) -> list[int]:
    """Return the places of a case along the axes that the study has, in the order x, second axis, `by`."""
    return [x, *([curve] if grid.other is not None else []), *([by] if grid.by is not None else [])]


def together(grids: Mapping[str, Grid]) -> str:
    """Return the common report of several studies by name. The figure of each study is in a folder with its name."""
    blocks: list[Block] = [Heading("What the studies tell", 1), "Each sentence follows from the numbers of the runs."]
    for name, grid in grids.items():
        if grid.asked.question:
            told = list(answers(grid)) or list(verdicts(grid))
            blocks += [Heading(grid.asked.question), Items(told), f"See [{name}](#{name})."]
    for name, grid in grids.items():
        blocks += [f'<a id="{name}"></a>', *_study(grid, 2, f"{name}/")]
    return markdown(blocks)


def _study(grid: Grid, level: int, folder: str) -> Iterator[Block]:
    asked = grid.asked
    yield Heading(getattr(grid.scene.settings, "title", "") or grid.scene.name, level)
    if asked.question:
        yield from (asked.question, Items(list(answers(grid))))
    if asked.held:
        yield f"Held constant: {asked.held}."
    yield Items(list(lessons(grid)))
    yield Picture(f"{folder}{STUDY_FIGURE_FILE}", grid.scene.name)
    yield from _table(grid)


def _table(grid: Grid) -> Iterator[Block]:
    rows = len(grid.x.varied.values) * len(grid.curves)
    if rows > MOST_ROWS:
        yield f"All cases are in `{STUDY_TABLE_FILE}`, with the estimated error of each number (`_off`)."
        return
    views, marks = [grid.view(measure) for measure in grid.measures], grid.marked()
    header = [grid.x.label, *([grid.other.label] if grid.other else []), *(each.measure.label for each in views)]
    body = []
    for k, c in np.ndindex(len(grid.x.varied.values), len(grid.curves)):
        cells = [grid.x.told(k), *([grid.other.told(c)] if grid.other else [])]
        marked = "; ".join(name for name, each in marks.items() if each[k, c])
        body.append([*cells, *(each.number(k, c) for each in views), *([marked] if marks else [])])
    header += ["marked"] if marks else []
    known = any(np.isfinite(each.off).any() for each in views)
    said = "; ".join([*([f"with {grid.own}"] if grid.own else []), *([OFF] if known else [])])
    if said:
        yield f"{said[0].upper()}{said[1:]}:"
    yield Table(header, body)
