"""The page with all figures of a summary, from the table of measures and the models."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from textwrap import dedent
from typing import Any

import worm3d
from control.tracking.metrics import REASONS
from pages.text import Definition, bullets, code, definitions, page, prose, sentence
from scenes import models
from scenes.records.record import Record
from worm3d.measures import MEASURES
from worm3d.values.metrics import named

PAGE_INTRODUCTION = """
A figure is a number in the summary of a run. `result.summary()` returns the figures in Python, `summary.json` in the
folder of a run has the same figures, and a sweep writes a column for each figure. The program makes this page from the
table in `worm3d.measures` and from the models of scenes.

The name of a figure ends in the unit. BL is the length of the body at rest. A figure that has no value for a run is
`null` in `summary.json` and `None` in Python. The summary then names the reason. Below, "null" lists possible reasons.
""".strip()

FORMULAS = re.compile(r"^\| `(\w+)` \| [^|]* \| ((?:\\\||[^|])*) \| ([^|]*) \|$", re.MULTILINE)
"""A row of the table of measures in NOTATION.md: name, unit, formula, tag."""


def summary(records: Mapping[str, Record]) -> str:
    """Return the page; `records` has a short run of each model, by the name of the model."""
    formulas = _formulas()
    blocks = [PAGE_INTRODUCTION, "## All runs of a 3D worm"]
    blocks.append(definitions(_measure(name, formulas) for name in MEASURES))
    for model in map(models.get, models.names()):
        blocks += [f"## Further figures of scenes of {code(model.name)}", _further(model.name, records[model.name])]
    return page("Figures of a summary", *blocks)


def _formulas() -> dict[str, str]:
    text = (Path(worm3d.__file__).parent / "NOTATION.md").read_text(encoding="utf-8")
    return {name: f"{formula} {tag}".replace(r"\|", "|").strip() for name, formula, tag in FORMULAS.findall(text)}


def _measure(name: str, formulas: Mapping[str, str]) -> Definition:
    known = MEASURES[name]
    formula = f"Definition: {prose(formulas[name])}." if name in formulas else ""
    return _entry(name, known.meaning, formula, list(dict.fromkeys(reasons_of(known.function))))


def _entry(name: str, meaning: str, formula: str, reasons: list[str]) -> Definition:
    null = "Null: " + prose(reasons[0]) + "." if len(reasons) == 1 else ""
    listed = "Null:\n\n" + bullets(f"{prose(reason)}." for reason in reasons) if len(reasons) > 1 else ""
    unit = f"Unit {code(named(name)[1])}." if named(name)[1] else ""
    return code(name), [f"{sentence(meaning)} {unit}".strip(), formula, null or listed]


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
    waiting, seen = [function], set[Any]()
    while waiting:
        each = waiting.pop()
        if each not in seen:
            seen.add(each)
            texts, called = _raised(each)
            yield from texts
            waiting += called


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
