"""Tables as text, for terminals and in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

Cells = tuple[str, ...]


def aligned(header: Sequence[str], rows: Iterable[Cells]) -> Iterator[str]:
    """Yield the lines of a table for a terminal."""
    body = list(rows)
    widths = [max(map(len, column)) for column in zip(header, *body, strict=True)]
    for cells in (header, *body):
        yield "  ".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip()


def markdown_table(header: Sequence[str], rows: Iterable[Cells]) -> Iterator[str]:
    """Yield the lines of a table in Markdown."""
    yield "| " + " | ".join(header) + " |"
    yield "|---" * len(header) + "|"
    yield from ("| " + " | ".join(cells) + " |" for cells in rows)
