"""The page with all figures of a summary, from the table of measures and the models."""

from __future__ import annotations

import ast
import inspect
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from textwrap import dedent
from types import MappingProxyType
from typing import Any

import worm3d
from control.tracking.metrics import REASONS
from pages.text import Definition, bullets, code, definitions, page, prose, sentence
from scenes import models
from scenes.records.record import Record
from worm3d.measures import MEASURES
from worm3d.measures.waves import Waves
from worm3d.recorded.status import Status
from worm3d.values.metrics import named

PAGE_INTRODUCTION = """
A figure is a number in the summary of a run. `result.summary()` returns the figures in Python, `summary.json` in the
folder of a run has the same figures, and a sweep writes a column for each figure. The program makes this page from the
table in `worm3d.measures` and from the models of scenes.

The name of a figure ends in the unit. BL is the length of the body at rest. A figure that has no value for a run is
`null` in `summary.json` and `None` in Python. The summary then names the reason. Below, "null" lists possible reasons.
""".strip()

SPEEDS = """
Four figures describe the speed, and each suits a purpose:

* `stride_bl` and `speed_bl_s` compare gaits and worms. Both count the last waves only, so that the start of the run has
  no effect. Use `stride_bl` if the duration of a wave does not matter, and `speed_bl_s` otherwise.
* `mean_speed_m_s` is the speed of the whole run along the first heading, and includes the slow start.
* `speed_BL_per_period` is `mean_speed_m_s` in body lengths per period.
""".strip()

LAST_WAVES = """
The *last waves* are the whole periods of the gait that fit into the second half of a run, and at least one period. The
first half is left out because a worm that starts at rest needs some waves until the motion repeats. These figures count
the last waves only: {}. The figures {} compare the waves of the whole run. All other figures of this section count the
whole run, from the first to the last row.
""".strip()

WHOLE_RUN = ("return_map_radius", "response_time_s")
"""Figures that use the last waves as a reference, and look at the whole run."""

LETTERS = """
The definitions (J1) to (J8) use these letters:

* L is the length of the body at rest. T is the period of the gait, and K is the number of the last waves.
* In wave k, the centre of mass moves by the vector d\\_k along the ground, and the body turns to the left by the angle
  phi\\_k. The mean of all phi\\_k is phi.
* e\\_k is the mean heading of wave k as a unit vector, and n\\_k is the unit vector to the left of e\\_k.
* D is the sum of all |d\\_k|. In a pipe, |d\\_k| and d\\_k.e\\_k are measured along the centre line.
* Between two rows, contact point p slides by the distance s\\_p, and N\\_p is the mean of both normal loads. The
  contact points are the apexes, the end faces and the joints.
* x\\_k is the shape of the body at the end of wave k, where k counts all waves of the run. The shape has the joints
  relative to the centre of mass, over L. On level ground, the shape is also rotated to the heading 0.
* In the definition of `effort`, c is the contraction that a chamber gives, f is the extra force along the chamber, and
  k is the stiffness of the two springs of a segment.
""".strip()

SHARED = 3
"""A reason that at least so many figures have is written once, in a list at the top of the page."""
SHARED_TITLE = "## Reasons of many figures"
SHARED_INTRODUCTION = "Many figures have the same reasons for a missing value. The entries below refer to this list:"

STATUS_OF_RECORDS = """
`summary.json` has the status `diverged` for every run that failed, and the command prints the sentence. In a sweep, the
column `reason` has the sentence. A sweep also has the status `failed` for a case without any result, and `not run` for
a case that the sweep did not start.
""".strip()

FORMULAS = re.compile(r"^\| `(\w+)` \| [^|]* \| ((?:\\\||[^|])*) \| ([^|]*) \|$", re.MULTILINE)
"""A row of the table of measures in NOTATION.md: name, unit, formula, tag."""


def summary(records: Mapping[str, Record]) -> str:
    """Return the page; `records` has a short run of each model, by the name of the model."""
    formulas, shared = _formulas(), _shared()
    listed = bullets(f"{number}: {prose(reason)}." for reason, number in shared.items())
    blocks = [PAGE_INTRODUCTION, "## Which figure for the speed?", SPEEDS, "## Whole run or last waves?", _last_waves()]
    blocks += ["## Letters", LETTERS, SHARED_TITLE, SHARED_INTRODUCTION, listed, "## All runs of a 3D worm"]
    blocks.append(definitions(_measure(name, formulas, shared) for name in MEASURES))
    for model in map(models.get, models.names()):
        blocks += [f"## Further figures of scenes of {code(model.name)}", _further(model.name, records[model.name])]
    return page("Figures of a summary", *blocks)


def _formulas() -> dict[str, str]:
    text = (Path(worm3d.__file__).parent / "NOTATION.md").read_text(encoding="utf-8")
    return {name: f"{formula} {tag}".replace(r"\|", "|").strip() for name, formula, tag in FORMULAS.findall(text)}


def _last_waves() -> str:
    """Return which figures count the last waves, from the functions that the measures call."""
    of_waves = [name for name in MEASURES if Waves in called_by(MEASURES[name].function) and name not in WHOLE_RUN]
    return LAST_WAVES.format(", ".join(map(code, of_waves)), " and ".join(map(code, WHOLE_RUN)))


def _shared() -> dict[str, str]:
    """Return the reasons of many figures, each with a label."""
    counts = Counter(reason for known in MEASURES.values() for reason in dict.fromkeys(reasons_of(known.function)))
    return {reason: f"R{k}" for k, reason in enumerate((r for r, n in counts.items() if n >= SHARED), start=1)}


def _measure(name: str, formulas: Mapping[str, str], shared: Mapping[str, str]) -> Definition:
    known = MEASURES[name]
    formula = f"Definition: {prose(formulas[name])}." if name in formulas else ""
    if name == "status":
        formula = (
            bullets(f"{code(each.name.lower())}: {prose(each.value)}." for each in Status) + f"\n\n{STATUS_OF_RECORDS}"
        )
    return _entry(name, known.meaning, formula, list(dict.fromkeys(reasons_of(known.function))), shared)


def _entry(
    name: str, meaning: str, formula: str, reasons: list[str], shared: Mapping[str, str] = MappingProxyType({})
) -> Definition:
    unit = f"Unit {code(named(name)[1])}." if named(name)[1] else ""
    return code(name), [f"{sentence(meaning)} {unit}".strip(), formula, *_null(reasons, shared)]


def _null(reasons: list[str], shared: Mapping[str, str]) -> list[str]:
    """Return the blocks with the reasons for a missing value. Shared reasons are given by label, others in words."""
    labels = [label for reason, label in shared.items() if reason in reasons]
    own = [f"{prose(reason)}." for reason in reasons if reason not in shared]
    if not own:
        return [f"Null: {', '.join(labels)}."] if labels else []
    if len(own) == 1 and not labels:
        return [f"Null: {own[0]}"]
    return ["Null:", bullets([*([f"{', '.join(labels)}."] if labels else []), *own])]


def _further(model: str, record: Record) -> str:
    entries = models.get(model).entries
    given, shared = record.summary.metrics, sorted(set(record.summary.metrics) & set(MEASURES), key=[*MEASURES].index)
    reasons = {**record.summary.reasons, **REASONS}
    own = definitions(
        _entry(name, meaning, "", [reasons[name]] if name in reasons else []) for name, meaning in entries.items()
    )
    missing = set(given) - set(MEASURES) - set(entries) - {"status"}
    assert not missing, f"{model}: no meaning of {missing}"
    same = f"A summary of this model also has {', '.join(map(code, shared))}, with the meanings above."
    return f"{own}\n\n{same}" if len(shared) < len(MEASURES) - 5 else own


def reasons_of(function: Any) -> Iterator[str]:
    """Yield the texts of all NoValueError that a measure may raise, also in the functions that the measure calls."""
    for each in called_by(function):
        yield from _raised(each)[0]


def called_by(function: Any) -> list[Any]:
    """Return a function of a measure, and all functions and classes that the function calls."""
    waiting, seen = [function], dict[Any, None]()
    while waiting:
        each = waiting.pop()
        if each not in seen:
            seen[each] = None
            waiting += _raised(each)[1]
    return [*seen]


@cache
def _raised(function: Any) -> tuple[list[str], list[Any]]:
    """Return the texts of the NoValueError that a function raises itself, and the functions that the function calls."""
    function = inspect.unwrap(function.func if isinstance(function, partial) else function)
    texts: list[str] = []
    called: list[Any] = []
    if str(getattr(function, "__module__", "")).startswith("worm3d.measures"):
        names = vars(inspect.getmodule(function))
        for name, arguments in _calls(function):
            value = names.get(name)
            if name == "NoValueError":
                texts += _texts(arguments[0], names)
            elif inspect.isroutine(value) or inspect.isclass(value):
                called.append(value)
    return texts, called


def _calls(function: Any) -> Iterator[tuple[str, list[ast.expr]]]:
    """Yield name and arguments of each call in the source of a function or a class."""
    for node in ast.walk(ast.parse(dedent(inspect.getsource(function)))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            yield node.func.id, node.args


def _texts(node: ast.expr, names: Mapping[str, Any]) -> Iterator[str]:
    """Yield the texts that an expression may have. Values that only a run has are shown as an ellipsis."""
    if isinstance(node, ast.IfExp):
        yield from _texts(node.body, names)
        yield from _texts(node.orelse, names)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        tree = ast.parse(dedent(inspect.getsource(names[node.func.id])))
        for each in ast.walk(tree):
            if isinstance(each, ast.Return) and each.value is not None:
                yield from _texts(each.value, names)
    else:
        yield from _text(node, names)


def _text(node: ast.expr, names: Mapping[str, Any]) -> Iterator[str]:
    if isinstance(node, ast.JoinedStr):
        yield "".join(_part(each, names) for each in node.values)
        return
    value = _evaluated(node, names)
    if isinstance(value, str) and value:
        yield value


def _part(node: ast.expr, names: Mapping[str, Any]) -> str:
    if isinstance(node, ast.Constant):
        return str(node.value)
    value = _evaluated(ast.JoinedStr([node]), names)
    return "…" if value is None else str(value)


def _evaluated(node: ast.expr, names: Mapping[str, Any]) -> Any:
    """Return the value of an expression of constants of a module, or None if the expression needs a run."""
    expression = ast.fix_missing_locations(ast.Expression(node))
    try:
        return eval(compile(expression, "reason", "eval"), dict(names))
    except NameError:
        return None
