"""The tutorials as Jupyter notebooks, for `worm3d init --tutorials DIR`.

A tutorial is a Markdown file in `scenes/tutorials`. The code of a cell stands between a line ```{code-cell} and a line
```. The rest is text. No package of Jupyter is needed: a notebook is a JSON file in the format nbformat 4.5.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from scenes.language.errors import DiscError, SceneError
from scenes.language.loader import SHIPPED_FOLDER
from scenes.records.folder import made, write_bytes

TUTORIALS = SHIPPED_FOLDER / "tutorials"
"""Folder of the tutorials that come with the program."""

METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
"""Metadata of every notebook."""

HEADER = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
"""The YAML header of a tutorial."""
CODE = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```[ \t]*$", re.DOTALL | re.MULTILINE)
"""A cell with code."""
OPTION = re.compile(r"\A(?::[^\n]*\n)+")
"""Options at the beginning of a cell, such as `:tags: [hide-input]`."""
MARKDOWN_LINK = re.compile(r"!?\[([^\]]*)\]\((?!https?:)[^)\s]+\)")
"""A link to another page of the book, or a picture of the book. These files are not beside a notebook."""


class Cell(NamedTuple):
    """A cell of a notebook."""

    is_code: bool
    text: str


def shipped_tutorials() -> dict[str, Path]:
    """Return the files of the tutorials by name."""
    return {path.stem: path for path in sorted(TUTORIALS.glob("*.md"))}


def cells(text: str) -> Iterator[Cell]:
    """Yield the cells of a tutorial in order. Text between two cells of code is one cell; empty text is left out."""
    text = HEADER.sub("", text.replace("\r\n", "\n"))
    end = 0
    for found in CODE.finditer(text):
        yield from _said(text[end : found.start()])
        yield Cell(is_code=True, text=OPTION.sub("", found[1]).strip("\n"))
        end = found.end()
    yield from _said(text[end:])


def _said(text: str) -> Iterator[Cell]:
    if text.strip():
        yield Cell(is_code=False, text=text.strip())


def plain(text: str) -> str:
    """Return text for a notebook, where links to pages of the book become words."""
    return MARKDOWN_LINK.sub(r"\1", text)


def notebook(text: str) -> dict[str, Any]:
    """Return a tutorial as the content of a notebook, without outputs."""
    made_cells = [_entry(number, cell) for number, cell in enumerate(cells(text))]
    return {"cells": made_cells, "metadata": METADATA, "nbformat": 4, "nbformat_minor": 5}


def _entry(number: int, cell: Cell) -> Mapping[str, Any]:
    source = (cell.text if cell.is_code else plain(cell.text)).splitlines(keepends=True)
    entry = {"id": f"cell-{number}", "metadata": {}, "source": source}
    if cell.is_code:
        return {"cell_type": "code", "execution_count": None, "outputs": [], **entry}
    return {"cell_type": "markdown", **entry}


def write_tutorials(folder: Path, *, force: bool = False) -> list[Path]:
    """Write all tutorials as notebooks into a folder, which is created, and return the paths of the notebooks.

    Raises
    ------
    SceneError
        If the path is a file, or if a notebook exists and `force` is false. No notebook is then written.
    DiscError
        If a notebook cannot be written.
    """
    tutorials = shipped_tutorials()
    if not tutorials:
        raise DiscError(f"{TUTORIALS}: no tutorials there; install worm3d again")
    if folder.exists() and not folder.is_dir():
        raise SceneError(f"{folder} is a file: name a folder for the tutorials")
    targets = {name: folder / f"{name}.ipynb" for name in tutorials}
    there = [str(path) for path in targets.values() if path.exists()]
    if there and not force:
        raise SceneError(f"{', '.join(there)} exists: choose another folder, or replace the notebooks with --force")
    made(folder)
    for name, path in tutorials.items():
        content = json.dumps(notebook(path.read_text(encoding="utf-8")), indent=1, ensure_ascii=False)
        write_bytes(targets[name], f"{content}\n".encode())
    return [*targets.values()]
