"""Tables as text for terminals and Markdown, and tables and data as CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

Cells = tuple[str, ...]


class Column(NamedTuple):
    """A column of a table: an attribute of the objects in the rows, and the format of its values."""

    attribute: str
    """Name of the attribute, which may be an attribute of an attribute, such as `own.speed`."""
    form: str = ""
    """Format specification of the values, as after the colon in an f-string."""
    scale: float = 1.0
    """Factor that multiplies the values."""
    none: str = ""
    """Text for None and NaN."""
    name: str = ""
    """Title of the column in CSV files; the name of the attribute if left out."""

    def value(self, row: object) -> Any:
        """Return the value of a row."""
        value = attrgetter(self.attribute)(row)
        return value if self.scale == 1.0 or value is None else self.scale * value

    def cell(self, row: object) -> str:
        """Return the value of a row as text."""
        value = self.value(row)
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return self.none
        return value if isinstance(value, str) else format(value, self.form)


def table(columns: Mapping[str, Column], rows: Iterable[object]) -> tuple[Cells, list[Cells]]:
    """Return the header and the rows of a table as texts; the keys of `columns` are the titles."""
    return tuple(columns), [tuple(column.cell(row) for column in columns.values()) for row in rows]


def aligned(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table for a terminal, with aligned columns."""
    body = list(rows)
    widths = [max(map(len, column)) for column in zip(header, *body, strict=True)]
    for cells in (header, *body):
        yield "  ".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip()


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table in Markdown."""
    yield "| " + " | ".join(header) + " |"
    yield "|---" * len(header) + "|"
    yield from ("| " + " | ".join(cells) + " |" for cells in rows)


def csv_bytes(rows: Iterable[Iterable[Any]]) -> bytes:
    """Return rows as the bytes of a CSV file. The first row has the titles.

    Cells with None or a number that is not finite are empty.
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(finite, row) for row in rows)
    return text.getvalue().encode()


def csv_table(columns: Iterable[Column], rows: Iterable[object]) -> bytes:
    """Return a table as the bytes of a CSV file."""
    shown = list(columns)
    titles = [column.name or column.attribute for column in shown]
    return csv_bytes([titles, *([column.value(row) for column in shown] for row in rows)])


def json_bytes(content: Any, indent: int | None = 2) -> bytes:
    """Return content as the bytes of a JSON file. Numbers that are not finite become null."""
    text = json.dumps(finite(content), indent=indent, ensure_ascii=False, allow_nan=False)
    return f"{text}\n".encode()


def finite(content: Any) -> Any:
    """Return content as data for JSON.

    Mappings become dictionaries, sequences become lists, and numbers that are not finite become None.
    """
    if isinstance(content, Mapping):
        return {key: finite(item) for key, item in content.items()}
    if isinstance(content, list | tuple):
        return [finite(item) for item in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
