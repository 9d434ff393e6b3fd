"""Reading of CSV files that have header lines `# name: text`, a row of column names, and rows of numbers."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from pathlib import Path

import numpy as np

from scenes.language.errors import DiscError, SceneError
from worm3d.values import regular_file
from worm3d.values.arrays import FloatArray

LARGEST_FILE = 1_000_000_000
"""Largest size of a file that can be read [byte]."""

LARGEST_NUMBER = 1e100
"""Largest number in a cell. Its square, and its product with the factor of a unit, do not overflow."""

PACKED = ".gz"
"""Suffix of gzip files."""

_HEADER_LINE = re.compile(r"#\s*(?P<name>[^:]+?)\s*:\s*(?P<text>.*?)\s*")

Rows = list[tuple[int, list[str]]]
"""Rows of a table, each with the line number in the file and the cells."""


def split(path: Path) -> tuple[dict[str, str], list[str], Rows]:
    """Return the texts of the header lines by name, the column names, and the rows with their line numbers.

    Raises
    ------
    SceneError
        If the file does not exist, is not text, or has no row of column names.
    DiscError
        If the file cannot be read.
    """
    try:
        text = _unpacked(regular_file.read(path, LARGEST_FILE), path).decode("utf-8-sig")
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file") from None
    except OSError as error:
        raise DiscError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from error
    except UnicodeDecodeError:
        raise SceneError(f"{path}: not a text in UTF-8: no table of measurements") from None
    header: dict[str, str] = {}
    lines = text.splitlines()
    start = next((n for n, line in enumerate(lines) if line.strip() and not line.startswith("#")), len(lines))
    for line in lines[:start]:
        if match := _HEADER_LINE.fullmatch(line):
            header[match["name"]] = match["text"]
    if start == len(lines):
        raise SceneError(f"{path}: no row of column names, such as time_s,com_x_m,com_y_m")
    if ";" in lines[start] and "," not in lines[start]:
        raise SceneError(f"{path}: separated by semicolons, must be by commas, with decimal points")
    try:
        rows = list(csv.reader(io.StringIO("\n".join(lines[start:])), strict=True))
    except csv.Error as error:
        raise SceneError(f"{path}: not a table: {error}") from None
    numbered = [(number, row) for number, row in enumerate(rows[1:], start=start + 2) if any(map(str.strip, row))]
    return header, [title.strip() for title in rows[0]], numbered


def _unpacked(data: bytes, path: Path) -> bytes:
    """Return the data of a file, unpacked if the name of the file ends in .gz.

    Raise SceneError if the data are damaged or too large.
    """
    if path.suffix.lower() != PACKED:
        return data
    try:
        with gzip.open(io.BytesIO(data)) as file:
            unpacked = file.read(LARGEST_FILE + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise SceneError(f"{path}: damaged, or not packed by gzip: {str(error).lower()}") from None
    if len(unpacked) > LARGEST_FILE:
        raise SceneError(f"{path}: unpacked larger than {LARGEST_FILE / 1e6:g} MB")
    return unpacked


def table(titles: list[str], rows: Rows) -> FloatArray:
    """Return the cells as numbers, shape (T, K), with NaN for blank cells.

    Raises
    ------
    SceneError
        If there are fewer than two rows, a row has the wrong number of cells, or a cell is not a number.
    """
    if len(rows) < 2:
        raise SceneError(f"got {len(rows)} rows of numbers, must be two or more")
    numbers = np.empty((len(rows), len(titles)))
    for k, (line, row) in enumerate(rows):
        if len(row) != len(titles):
            raise SceneError(f"line {line}: got {len(row)} cells, must be {len(titles)} as in the row of column names")
        try:
            numbers[k] = [float(cell) if cell.strip() else np.nan for cell in row]
        except ValueError:
            wrong = next(n for n, cell in enumerate(row) if cell.strip() and not _is_number(cell))
            raise SceneError(
                f"line {line}: {titles[wrong]}: got '{row[wrong]}', must be a number, or blank where it is missing"
            ) from None
    if (large := np.abs(numbers) > LARGEST_NUMBER).any():
        k, n = np.argwhere(large)[0]
        raise SceneError(
            f"line {rows[k][0]}: {titles[n]}: got {numbers[k, n]}, must be finite, below {LARGEST_NUMBER:g}, or blank "
            "where it is missing"
        )
    return numbers


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
