"""Reports of studies in Markdown: one study, and the questions that all of them answer together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from scenes.records.text import markdown_table
from scenes.studies.lessons import answers, lessons, verdicts
from scenes.studies.study import Grid

PICTURE, TEXT = "study.png", "study.md"
"""Files of a study in its folder."""
MOST_ROWS = 48
"""Largest number of cases that the table of a study has; `sweep.csv` has all."""


def document(grid: Grid) -> str:
    """Return the report of one study."""
    return "\n".join(_study(grid, "#", "")) + "\n"


def together(grids: Mapping[str, Grid]) -> str:
    """Return the report of several studies by name, whose pictures lie in folders of these names."""
    lines = ["# What the studies tell", "", "Each sentence follows from the numbers of the runs.", ""]
    for name, grid in grids.items():
        if grid.asked.question:
            told = list(answers(grid)) or list(verdicts(grid))
            lines += [
                f"## {grid.asked.question}",
                "",
                *(f"* {line}" for line in told),
                "",
                f"See [{name}](#{name}).",
                "",
            ]
    for name, grid in grids.items():
        lines += [f'<a id="{name}"></a>', "", *_study(grid, "##", f"{name}/"), ""]
    return "\n".join(lines) + "\n"


def _study(grid: Grid, level: str, folder: str) -> Iterator[str]:
    asked = grid.asked
    yield f"{level} {getattr(grid.scene.settings, 'title', '') or grid.scene.name}"
    yield ""
    if asked.question:
        yield from (asked.question, "", *(f"* {line}" for line in answers(grid)), "")
    if asked.held:
        yield from (f"Held constant: {asked.held}.", "")
    yield from (f"* {line}" for line in lessons(grid))
    yield from ("", f"![{grid.scene.name}]({folder}{PICTURE})", "")
    yield from _table(grid)


def _table(grid: Grid) -> Iterator[str]:
    rows = len(grid.x.varied.values) * len(grid.curves)
    if rows > MOST_ROWS:
        yield "All cases are in `sweep.csv`."
        return
    columns = {measure: grid.values(measure.name) for measure in grid.measures}
    header = [grid.x.label, *([grid.other.label] if grid.other else []), *(m.label for m in columns)]
    body = []
    for k, c in np.ndindex(len(grid.x.varied.values), len(grid.curves)):
        cells = [grid.x.told(k), *([grid.other.told(c)] if grid.other else [])]
        figures = (f"{values[k, c]:.3g}" if np.isfinite(values[k, c]) else "none" for values in columns.values())
        body.append([*cells, *figures])
    if grid.own:
        yield from (f"With {grid.own}:", "")
    yield from markdown_table(header, body)
