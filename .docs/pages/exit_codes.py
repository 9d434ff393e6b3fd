"""The page with the exit codes, from the classes of errors and the tables of codes."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import scenes
from pages.text import code, page, prose, table
from scenes.commands.cli import INTERRUPTED_CODE
from scenes.running.runner import EXIT_CODES

PAGE_INTRODUCTION = """
A command of `worm3d` ends with an exit code. Scripts can act on the code: `worm3d run flat || echo failed`. A sentence
on standard error gives the reason. The program makes this page from its classes of errors.
""".strip()

STATUSES = {
    "done": "The command did all of the requested work.",
    "diverged": "The run diverged. The files contain the part of the run before the failure.",
    "incomplete": "A case of a sweep, or a study, failed. The other cases are complete.",
    "interrupted": "The command was stopped by Ctrl-C or another signal. The part that was computed before is kept.",
}
"""Meaning of each status in `EXIT_CODES`."""


def exit_codes() -> str:
    """Return the page."""
    found = {(number, STATUSES[status]) for status, number in EXIT_CODES.items()}
    found |= {*declared()}
    assert EXIT_CODES["interrupted"] == INTERRUPTED_CODE
    rows = [[code(number), prose(text)] for number, text in sorted(found)]
    return page("Exit codes", PAGE_INTRODUCTION, table(["code", "meaning"], rows))


def declared() -> Iterator[tuple[int, str]]:
    """Yield code and meaning of each class of errors, and of each constant, that sets an exit code."""
    for path in sorted(Path(scenes.__file__).parent.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "exit_code = " in text or "EXIT_CODE = " in text:
            yield from _in(ast.parse(text))


def _in(module: ast.Module) -> Iterator[tuple[int, str]]:
    for node, below in pairwise([*module.body, ast.Pass()]):
        if isinstance(node, ast.ClassDef):
            said = (ast.get_docstring(node) or node.name).split("\n\n")[0].replace("\n", " ")
            yield from ((number, said) for each in node.body for number in _numbers(each, "exit_code"))
        elif isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            yield from ((number, str(below.value.value)) for number in _numbers(node, "EXIT_CODE"))


def _numbers(node: ast.stmt, ending: str) -> Iterator[int]:
    """Yield the number that a statement assigns to a name with this ending."""
    if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, int):
        yield from (node.value.value for name in node.targets if ast.unparse(name).endswith(ending))
