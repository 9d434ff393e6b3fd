"""Lessons of a study: sentences for a designer, which are computed from the figures of the cases and their errors.

A figure is a number from the summary of a run. Two values are level if they differ by at most the sum of their errors;
then neither is called better. If the best value is at the end of a range, the sentence says so. Marked cases, which
include cases with aliased waves, are never called best. A place is an index along an axis of the study.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from scenes.running.terminal import counted
from scenes.studies.study.curves import NEGLIGIBLE_LOSS, Shape, apart, sentence
from scenes.studies.study.study import MOST_CURVES, Grid
from scenes.studies.study.view import Axis, View
from worm3d.values.arrays import FloatArray

VERDICTS = {"rises": ("rises", "falls"), "falls": ("falls", "rises")}
"""For each expected shape of a curve: the shape that means yes, and the shape that means no."""
MOST_LEVEL = 3
"""Largest number of cases that are listed as level with the best case."""
TIES = "; '=' joins cases whose values differ by no more than their errors"


def answers(grid: Grid) -> Iterator[str]:
    """Yield the answers to a study's yes-or-no question, a sentence for each figure in `yes` and for each curve."""
    for name, way in grid.asked.yes.items():
        better = grid.asked.measures.get(name, "")
        for view in judged(grid):
            if view.measure.name == name:
                for c, curve in enumerate(grid.curves):
                    told = _sentence(grid, view, c)
                    yield f"{_verdict(_shape(view, c), way, better)}{_where(view.where, curve)}: {told}."


def _verdict(shape: Shape, way: str, better: str) -> str:
    if shape.kind == "none":
        return "Not known"
    yes, no = VERDICTS[way]
    turned = "Up to a point" if better and shape.kind in ("dip" if better == "less" else "peak") else "Not throughout"
    return {yes: "Yes", no: "No", "flat": "No"}.get(shape.kind, turned)


def lessons(grid: Grid) -> Iterator[str]:
    """Yield the sentences of a study: first on the shapes of the curves, then on the best cases."""
    if grid.x.is_number:
        shown = set(range(len(grid.curves)))
        if len(shown) > MOST_CURVES:
            shown = {0, len(shown) - 1} if grid.is_map else set()
        for view in judged(grid):
            for c in sorted(shown):
                told, head = _sentence(grid, view, c), "; ".join(part for part in (grid.curves[c], view.where) if part)
                yield f"{head}: {told}." if head else f"{told[0].upper()}{told[1:]}."
    yield from verdicts(grid)


def judged(grid: Grid) -> Iterator[View]:
    """Yield the views of a study without the cases that cannot be best."""
    left_out = grid.left_out()
    for view in grid.views():
        yield view.without(left_out)


def verdicts(grid: Grid) -> Iterator[str]:
    """Yield sentences on marked cases, on the best cases, on unknown errors, and on failed cases."""
    for name, marked in grid.marked().items():
        yield _extent(grid, name, marked)
    for view in judged(grid):
        if not grid.x.is_number:
            yield from _ranking(grid, view)
        elif view.measure.better and np.isfinite(view.values).any() and len(grid.curves) > 1:
            yield (_moving if grid.other is not None and grid.other.is_number else _each)(grid, view)
            yield _overall(grid, view)
    yield from _elsewhere(grid)
    yield from _unknown(grid)
    if grid.failed.any():
        reasons = [reason for reason, lost in zip(grid.table.reasons, grid.table.failed.tolist(), strict=True) if lost]
        yield f"{len(reasons)} of {len(grid.table)} cases fail, the first because {reasons[0].rstrip('.')}."


def _where(where: str, curve: str) -> str:
    said = "; ".join(part for part in (curve, where) if part)
    return f" ({said})" if said else ""


def _shape(view: View, curve: int) -> Shape:
    return Shape.of(view.values[:, curve], view.off[:, curve])


def _sentence(grid: Grid, view: View, curve: int) -> str:
    words, along, better = f"the {view.measure.words}", f"the {grid.x.words}", view.measure.better
    return sentence(_shape(view, curve), words, along, grid.x.told, lambda k: view.told(k, curve), better)


def _most(view: View) -> str:
    return f"{'least' if view.measure.better == 'less' else 'greatest'} {view.measure.words}{_where(view.where, '')}"


def _ranking(grid: Grid, view: View) -> Iterator[str]:
    """Yield, for each curve, a sentence that lists the names on the x axis from the best to the worst."""
    for c, curve in enumerate(grid.curves):
        known = np.flatnonzero(np.isfinite(view.values[:, c])).tolist()
        none = [grid.x.told(k) for k in range(len(view.values)) if k not in known]
        told = _ordered(view, [(k, c, f"{grid.x.told(k)} ({view.told(k, c)})") for k in known])
        yield f"By {view.measure.words}{_where(view.where, curve)}: {told or 'none'}" + (
            f"; without: {', '.join(none)}." if none else "."
        )


def _ordered(view: View, items: Sequence[tuple[int, int, str]]) -> str:
    """Return the texts of cases from the best to the worst, where `=` joins neighbours that are level.

    Each item has the place along x, the index of the curve, and the text of a case.
    """
    sign = 1.0 if view.measure.better == "less" else -1.0
    order = sorted(items, key=lambda each: sign * float(view.values[each[:2]]))
    told, tied = "", False
    for k, (x, c, text) in enumerate(order):
        tie = k > 0 and not _apart(view, (x, c), order[k - 1][:2])
        told += f"{(' = ' if tie else ', ') if k else ''}{text}"
        tied |= tie
    return told + (TIES if tied else "")


def _apart(view: View, first: tuple[int, int], second: tuple[int, int]) -> bool:
    off = np.nan_to_num(view.off)
    return bool(apart(view.values[first], view.values[second], off[first], off[second]))


def _each(grid: Grid, view: View) -> str:
    """Return a sentence with the best value of each curve and the x where it is reached, the best curve first."""
    found = []
    for c, curve in enumerate(grid.curves):
        if np.isfinite(view.values[:, c]).any():
            shape = _shape(view, c)
            x = shape.best(view.measure.better)
            found.append((x, c, f"{curve} ({view.told(x, c)} at {_best_place(grid.x, shape, x)})"))
    return f"The {_most(view)} of each: {_ordered(view, found)}."


def _moving(grid: Grid, view: View) -> str:
    """Return a sentence with the x of the best value for each curve or each row of a map."""
    assert grid.other is not None
    runs: list[tuple[str, list[int]]] = []
    for c in range(len(grid.curves)):
        if np.isfinite(view.values[:, c]).any():
            shape = _shape(view, c)
            best = _best_place(grid.x, shape, shape.best(view.measure.better), near=True)
            if not runs or runs[-1][0] != best:
                runs.append((best, []))
            runs[-1][1].append(c)
    if len(runs) == 1:
        return f"The {_most(view)} is at {grid.x.words} {runs[0][0]} in every case of {grid.other.words}."
    places = "; ".join(f"{best} for {_curves(grid, curves)}" for best, curves in runs)
    return f"The {grid.x.words} of the {_most(view)}: {places}."


def _best_place(axis: Axis, shape: Shape, best: int, *, near: bool = False) -> str:
    """Return a text with the x of the best value, the x of values level with it, and whether the range ends there.

    With `near`, the text also has the range of x whose values are nearly the best.
    """
    level = [k for k in shape.level(best) if k != best]
    said = [f"level with {_runs(axis, level)}"] if level else []
    low, high = shape.near(best)
    said += [f"within {NEGLIGIBLE_LOSS:.0%} of it from {axis.told(low, high)}"] if near and low < high else []
    said += [edge] if (edge := shape.edge(best)) else []
    return axis.told(best) + (f" [{', '.join(said)}]" if said else "")


def _overall(grid: Grid, view: View) -> str:
    """Return a sentence with the curve that is best at most places, and these places."""
    rows = [k for k in range(len(view.values)) if np.isfinite(view.values[k]).any()]
    level = np.array([_level_with_best(view, view.values[k], view.off[k]) for k in rows])
    alone = level & (level.sum(axis=1) == 1)[:, None]
    first = int(np.argmax((alone if alone.any() else level).sum(axis=0)))
    ahead = [k for k, lead in zip(rows, alone[:, first].tolist(), strict=True) if lead]
    tied = [k for k, here in zip(rows, (level & ~alone)[:, first].tolist(), strict=True) if here]
    said = [f"ahead at {_places(grid.x, ahead)}"] if ahead else []
    said += [f"level with others at {_places(grid.x, tied)}"] if tied else []
    best = _best_of_all(grid, view)
    return f"By {view.measure.words}{_where(view.where, '')}, '{grid.curves[first]}' is {' and '.join(said)}; {best}."


def _level_with_best(view: View, values: FloatArray, off: FloatArray) -> NDArray[np.bool_]:
    """Return whether each value is level with the best value, in an array with the shape of the values."""
    off, known = np.nan_to_num(off), np.isfinite(values)
    best = int(np.nanargmin(values) if view.measure.better == "less" else np.nanargmax(values))
    return np.asarray(known & ~apart(values, values.flat[best], off, off.flat[best]))


def _best_of_all(grid: Grid, view: View) -> str:
    """Return a text with the best case, the cases that are level with it, and the ranges at whose ends it lies."""
    pick = np.nanargmin if view.measure.better == "less" else np.nanargmax
    x, c = map(int, np.unravel_index(int(pick(view.values)), view.values.shape))
    told = f"best of all is {view.told(x, c)} at {_case(grid, x, c)}"
    level = [
        (int(k), int(m)) for k, m in np.argwhere(_level_with_best(view, view.values, view.off)) if (k, m) != (x, c)
    ]
    if level:
        named = [_case(grid, *each) for each in level[:MOST_LEVEL]]
        more = [f"{len(level) - MOST_LEVEL} more"] if len(level) > MOST_LEVEL else []
        told += f", level with {_listed([*named, *more])}"
    axes = [(grid.x, x), *([(grid.other, c)] if grid.other is not None and grid.other.is_number else [])]
    ended = [axis.words for axis, place in axes if _at_end(axis, place)]
    end = (
        f"ranges of {_listed(ended)} end" if len(ended) > 1 else f"range of the {_listed(ended)} ends" if ended else ""
    )
    return told + (f"; the {end} there, the best may lie beyond" if ended else "")


def _at_end(axis: Axis, place: int) -> bool:
    """Return whether the value at a place is the smallest or the largest of several values of an axis."""
    values = axis.varied.values
    return len(values) > 1 and values[place] in (min(values), max(values))


def _case(grid: Grid, x: int, curve: int) -> str:
    return grid.x.told(x) + (f" with '{grid.curves[curve]}'" if grid.curves[curve] else "")


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]


def _elsewhere(grid: Grid) -> Iterator[str]:
    """Yield sentences on the best cases at the other values of the axis `by`, a sentence for each figure."""
    if not grid.x.is_number:
        return
    for measure in grid.measures:
        every = [grid.view(measure, k).without(grid.left_out(k)) for k in grid.elsewhere] if measure.better else []
        views = [view for view in every if np.isfinite(view.values).any()]
        if grid.other is not None and grid.other.is_number:
            yield from (_moving(grid, view) for view in views)
        if views:
            told = [f"at {view.where} {_best_of_all(grid, view)}" for view in views]
            yield f"By {measure.words} elsewhere: {'; '.join(told)}."


def _unknown(grid: Grid) -> Iterator[str]:
    """Yield sentences on figures whose errors are unknown, and on cases that are left out for this reason."""
    without = [measure.words for measure in grid.measures if not np.isfinite(grid.errors(measure.name)).any()]
    if without:
        yield f"The errors of the {_listed(without)} that the time steps cause are not known."
    for view in grid.views():
        if view.unknown.any():
            words, number = f"{view.measure.words}{_where(view.where, '')}", int(view.unknown.sum())
            yield f"The error of the {words} is not known in {counted(number, 'case')}, which cannot be best."


def _extent(grid: Grid, name: str, marked: NDArray[np.bool_]) -> str:
    """Return a sentence on the cases with the marked property `name`. `marked` has a shape of (X, C)."""
    if not marked.any():
        return f"In no case: {name}."
    rows: dict[str, list[int]] = {}
    for c in np.flatnonzero(marked.any(axis=0)).tolist():
        rows.setdefault(_places(grid.x, np.flatnonzero(marked[:, c]).tolist()), []).append(c)
    told = [f"{at}{_where('', _curves(grid, curves))}" for at, curves in rows.items()]
    begin = f"In {int(marked.sum())} of {marked.size} cases, {name}: at {grid.x.words} {'; '.join(told)}."
    return f"{begin} These cases cannot be best."


def _places(axis: Axis, places: Sequence[int]) -> str:
    """Return a text with the values at places along an axis, where consecutive places are joined to ranges."""
    return f"every {axis.words}" if len(places) == len(axis.varied.values) else _runs(axis, places)


def _runs(axis: Axis, places: Sequence[int]) -> str:
    runs: list[list[int]] = []
    for place in places:
        if runs and place == runs[-1][-1] + 1:
            runs[-1].append(place)
        else:
            runs.append([place])
    return ", ".join(axis.told(*dict.fromkeys((run[0], run[-1]))) for run in runs)


def _curves(grid: Grid, curves: Sequence[int]) -> str:
    """Return a text with the names of curves, where consecutive numbers are joined; empty without a second axis."""
    if grid.other is None:
        return ""
    if not grid.other.is_number:
        return _listed([grid.curves[c] for c in curves])
    every = len(curves) == len(grid.curves)
    return _places(grid.other, curves) if every else f"{grid.other.words} {_runs(grid.other, curves)}"
