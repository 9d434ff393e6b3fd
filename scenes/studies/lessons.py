"""What a designer learns from a study: sentences that follow from the figures of its cases."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from scenes.studies.curves import Shape, sentence
from scenes.studies.study import MOST_CURVES, Grid, Measure
from worm3d.values.arrays import FloatArray

VERDICTS = {"rises": ("rises", "falls"), "falls": ("falls", "rises")}
"""Shape of a curve for yes, and for no."""


def answers(grid: Grid) -> Iterator[str]:
    """Yield the answer to a study's yes-or-no question, a sentence for each figure that decides it and each curve."""
    for name, way in grid.asked.yes.items():
        better = grid.asked.measures.get(name, "")
        for where, measure, values in views(grid):
            if measure.name == name:
                for curve, y in zip(grid.curves, values.T, strict=True):
                    told = _sentence(grid, measure, y)
                    yield f"{_verdict(y, way, better)}{_where(where, curve)}: {told}."


def _verdict(y: FloatArray, way: str, better: str) -> str:
    kind = Shape.of(y).kind
    if kind == "none":
        return "Not known"
    yes, no = VERDICTS[way]
    turned = "Up to a point" if better and kind in ("dip" if better == "less" else "peak") else "Not throughout"
    return {yes: "Yes", no: "No", "flat": "No"}.get(kind, turned)


def lessons(grid: Grid) -> Iterator[str]:
    """Yield what a study tells, a sentence each: how each figure goes along each curve, then what is best where."""
    if grid.x.is_number:
        shown = set(range(len(grid.curves)))
        if len(shown) > MOST_CURVES:
            shown = {0, len(shown) - 1} if grid.is_map else set()
        for where, measure, values in views(grid):
            for c, (curve, y) in enumerate(zip(grid.curves, values.T, strict=True)):
                if c in shown:
                    told = _sentence(grid, measure, y)
                    head = "; ".join(part for part in (curve, where) if part)
                    yield f"{head}: {told}." if head else f"{told[0].upper()}{told[1:]}."
    yield from verdicts(grid)


def verdicts(grid: Grid) -> Iterator[str]:
    """Yield what is marked or failed, and what is best where; cases that are marked are not recommended."""
    marks = grid.marked()
    for name, marked in marks.items():
        yield _extent(grid, name, marked)
    left_out = np.logical_or.reduce(list(marks.values())) if marks else np.zeros(grid.failed.shape, dtype=bool)
    for where, measure, every in views(grid):
        values = np.where(left_out, np.nan, every)
        if not grid.x.is_number:
            yield from _ranking(grid, measure, values, where)
        elif len(grid.curves) > 1 and measure.better and np.isfinite(values).any():
            yield (_moving if grid.other is not None and grid.other.is_number else _each)(grid, measure, values, where)
            yield _overall(grid, measure, values, where)
    if grid.failed.any():
        reasons = [reason for reason, lost in zip(grid.table.reasons, grid.table.failed.tolist(), strict=True) if lost]
        yield f"{len(reasons)} of {len(grid.table)} cases fail, the first because {reasons[0].rstrip('.')}."


def views(grid: Grid) -> Iterator[tuple[str, Measure, FloatArray]]:
    """Yield the figures of a study, shape (X, C): as they are, then costs at equal figures, and words for which."""
    for measure in grid.measures:
        yield grid.own, measure, grid.values(measure.name)
    for figure, target in grid.asked.equal.items():
        equal = grid.measure(figure)
        for measure in grid.measures:
            if measure.name != figure and measure.better == "less" and grid.by is not None:
                values = grid.equal_values(measure.name, figure, target, measure.better)
                yield f"at equal {equal.words} of {equal.told(target)}, by the {grid.by.words}", measure, values


def _where(where: str, curve: str) -> str:
    said = "; ".join(part for part in (curve, where) if part)
    return f" ({said})" if said else ""


def _sentence(grid: Grid, measure: Measure, y: FloatArray) -> str:
    return sentence(y, f"the {measure.words}", f"the {grid.x.words}", grid.x.told, measure.told, measure.better)


def _ranking(grid: Grid, measure: Measure, values: FloatArray, where: str) -> Iterator[str]:
    """Yield the order of names, best first."""
    for curve, y in zip(grid.curves, values.T, strict=True):
        known = [int(k) for k in np.argsort(y, kind="stable") if np.isfinite(y[k])]
        order = known if measure.better == "less" else known[::-1]
        none = [grid.x.told(k) for k in range(len(y)) if k not in known]
        told = ", ".join(f"{grid.x.told(k)} ({measure.told(float(y[k]))})" for k in order)
        yield f"By {measure.words}{_where(where, curve)}: {told or 'none'}" + (
            f"; without: {', '.join(none)}." if none else "."
        )


def _each(grid: Grid, measure: Measure, values: FloatArray, where: str) -> str:
    """Return the best of each named curve, and where it lies, the best one first."""
    found = []
    for curve, y in zip(grid.curves, values.T, strict=True):
        if np.isfinite(y).any():
            place = Shape.of(y).best(measure.better)
            found.append((float(y[place]), f"{curve} ({measure.told(float(y[place]))} at {grid.x.told(place)})"))
    found.sort(key=lambda each: each[0], reverse=measure.better == "more")
    most = f"{'least' if measure.better == 'less' else 'greatest'} {measure.words}{_where(where, '')}"
    return f"The {most} of each: {', '.join(text for _, text in found)}."


def _moving(grid: Grid, measure: Measure, values: FloatArray, where: str) -> str:
    """Return where the best of each curve, or row of a map, lies."""
    runs: list[tuple[int, list[str]]] = []
    for curve, y in zip(grid.curves, values.T, strict=True):
        if np.isfinite(y).any():
            best = Shape.of(y).best(measure.better)
            if not runs or runs[-1][0] != best:
                runs.append((best, []))
            runs[-1][1].append(curve)
    most = f"{'least' if measure.better == 'less' else 'greatest'} {measure.words}{_where(where, '')}"
    if len(runs) == 1:
        return f"The {most} is at {grid.x.words} {grid.x.told(runs[0][0])} in every case of {_other(grid)}."
    places = "; ".join(f"{grid.x.told(best)} for {_span(curves)}" for best, curves in runs)
    return f"The {grid.x.words} of the {most}: {places}."


def _span(names: Sequence[str]) -> str:
    """Return one name, two, or the first and the last one."""
    return names[0] if len(names) == 1 else f"{names[0]} {'and' if len(names) == 2 else 'to'} {names[-1]}"


def _overall(grid: Grid, measure: Measure, values: FloatArray, where: str) -> str:
    """Return which curve is best, and where."""
    sign = -1.0 if measure.better == "less" else 1.0
    rows = np.flatnonzero(np.isfinite(values).any(axis=1))
    ahead = np.array([int(np.nanargmax(sign * values[k])) for k in rows])
    x, c = np.unravel_index(int(np.nanargmax(sign * values)), values.shape)
    leads = f"best of all is {measure.told(float(values[x, c]))} at {grid.x.told(int(x))} with '{grid.curves[c]}'"
    first = max(set(ahead.tolist()), key=ahead.tolist().count)
    places = _places(grid, [int(k) for k in rows[ahead == first]])
    return f"By {measure.words}{_where(where, '')}, '{grid.curves[first]}' is ahead at {places}; {leads}."


def _extent(grid: Grid, name: str, marked: np.ndarray) -> str:
    """Return a sentence on the cases that have a property."""
    if not marked.any():
        return f"In no case: {name}."
    rows = [
        f"{_places(grid, np.flatnonzero(column).tolist())}{_where('', curve)}"
        for curve, column in zip(grid.curves, marked.T, strict=True)
        if column.any()
    ]
    begin = f"In {int(marked.sum())} of {marked.size} cases, {name}: at {grid.x.words} {'; '.join(rows)}."
    return f"{begin} The best is looked for among the others."


def _places(grid: Grid, places: Sequence[int]) -> str:
    """Return places along x as text, runs of them as ranges."""
    if len(places) == len(grid.x.varied.values):
        return f"every {grid.x.words}"
    runs: list[list[int]] = []
    for place in places:
        if runs and place == runs[-1][-1] + 1:
            runs[-1].append(place)
        else:
            runs.append([place])
    return ", ".join(grid.x.told(r[0]) + (f" to {grid.x.told(r[-1])}" if len(r) > 1 else "") for r in runs)


def _other(grid: Grid) -> str:
    assert grid.other is not None
    return grid.other.words
