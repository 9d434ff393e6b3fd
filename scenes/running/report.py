"""The report of a study: blocks of text, tables and pictures, as a page in Markdown and as lines for a terminal.

A study computes a `Report`. `report_study` prepares the folder, calls the study, writes the files, and prints the
lines. Therefore all studies behave in the same way: the folder is checked before the computation starts, a file is
written completely or not at all, Ctrl-C ends the study with a message and an exit code, and the last line names the
files.
"""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import typer

from scenes.models.base import Movie
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.records.text import Column, aligned, markdown_table, table
from scenes.running.drawing import save_figure, save_movie
from scenes.running.runner import EXIT_CODES
from scenes.running.terminal import busy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HANGING_INDENT = "    "
"""Indentation of the second and further lines of a paragraph on a terminal."""


class Heading(NamedTuple):
    """Heading. Level 1 is the title of a page, level 2 the title of a part of the page."""

    text: str
    level: int = 2


class Items(NamedTuple):
    """List with a sentence for each item."""

    sentences: Sequence[str]


class Table(NamedTuple):
    """Table whose cells are texts."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    @classmethod
    def of(cls, columns: Mapping[str, Column], rows: Iterable[object]) -> Table:
        """Return the table with the given columns, by title, for the objects `rows`."""
        return cls(*table(columns, rows))


class Picture(NamedTuple):
    """Picture, a file in the folder of the page. On a terminal it is left out."""

    file: str
    text: str


Block = str | Heading | Items | Table | Picture
"""Part of a report. A `str` is a paragraph."""


def markdown(blocks: Iterable[Block]) -> str:
    """Return the blocks as a page in Markdown."""
    texts = ["\n".join(_markdown_lines(block)) for block in blocks]
    return "\n\n".join(text for text in texts if text) + "\n"


def _markdown_lines(block: Block) -> Iterable[str]:
    match block:
        case Heading(text, level):
            return [f"{'#' * level} {text}"]
        case Items(sentences):
            return [f"* {sentence}" for sentence in sentences]
        case Table(header, rows):
            return markdown_table(header, rows)
        case Picture(file, text):
            return [f"![{text}]({file})"]
    return [block]


def terminal_lines(blocks: Iterable[Block], width: int | None = None) -> Iterator[str]:
    """Yield the blocks as lines of text. Paragraphs and items are wrapped to the width of the terminal, if given."""
    previous: Block = Heading("")
    for block in blocks:
        if not isinstance(previous, Heading) and (isinstance(block, Heading | Table) or isinstance(previous, Table)):
            yield ""
        yield from _terminal_lines(block, width)
        previous = block


def _terminal_lines(block: Block, width: int | None) -> Iterable[str]:
    match block:
        case Heading(text, _):
            return [text]
        case Items(sentences):
            return [line for sentence in sentences for line in _wrapped(f"  {sentence}", width)]
        case Table(header, rows):
            return aligned(header, rows)
        case str(text):
            return _wrapped(text, width)
    return []


def _wrapped(text: str, width: int | None) -> list[str]:
    return [text] if width is None else textwrap.wrap(text, width, subsequent_indent=HANGING_INDENT)


@dataclass(frozen=True)
class Report:
    """Results of a study.

    Parameters
    ----------
    said : sequence of Block
        Blocks that are printed on the terminal.
    pages : mapping
        Blocks of each page in Markdown, by file name.
    files : mapping
        Content of each further file, by file name.
    pictures : mapping
        Figures (PNG) and movies (GIF), by file name.
    warnings : sequence of str
        Reasons to doubt the results, which are printed to standard error.
    exit_code : int
        Exit code of the command.
    """

    said: Sequence[Block]
    pages: Mapping[str, Sequence[Block]] = field(default_factory=dict)
    files: Mapping[str, bytes] = field(default_factory=dict)
    pictures: Mapping[str, Figure | Movie] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    exit_code: int = 0

    @property
    def names(self) -> list[str]:
        """Names of all files."""
        return [*self.pages, *self.files, *self.pictures]

    def write(self, folder: Path) -> None:
        """Write all files into a folder; DiscError if the folder cannot be written."""
        for name, blocks in self.pages.items():
            write_bytes(folder / name, markdown(blocks).encode())
        for name, content in self.files.items():
            write_bytes(folder / name, content)
        for name, picture in self.pictures.items():
            if isinstance(picture, Movie):
                save_movie(picture, folder / name)
            else:
                save_figure(picture, folder / name)


class StudyStoppedError(Exception):
    """A signal has stopped a study; the message is the cause."""

    def __init__(self, cause: str, kept: str = "nothing of it was kept") -> None:
        super().__init__(cause)
        self.kept = kept
        """Sentence about the results that the study has stored."""


def report_study(
    name: str, study: Callable[[Path], Report], out: Path | None, *, force: bool = False, quiet: bool = False
) -> int:
    """Carry out a study, write and print its report, and return the exit code.

    Parameters
    ----------
    name : str
        Name of the study.
    study : callable
        Function that computes the report. Its argument is the folder. Intermediate results may be stored there.
    out : Path, optional
        Folder for the files. The default is `runs/<name>-<time>`.
    force, quiet : bool
        The options --force and --quiet of the command.

    Raises
    ------
    SceneError
        If the folder cannot be used.
    DiscError
        If a file cannot be written.
    """
    with folders.prepared(out, name, force=force) as folder:
        try:
            report = study(folder)
        except StudyStoppedError as stop:
            typer.echo(f"{name}: stopped by {stop}; {stop.kept}", err=True)
            return EXIT_CODES["interrupted"]
        with busy("drawing", quiet=quiet):
            report.write(folder)
    for warning in report.warnings:
        typer.echo(f"warning: {warning}", err=True)
    if not quiet:
        width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
        for line in terminal_lines(report.said, width):
            typer.echo(line)
        typer.echo(f"Written to {folder}: {', '.join(report.names)}")
    return report.exit_code
