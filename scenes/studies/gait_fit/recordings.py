"""Recordings of crawling animals in a CSV file.

A file has a column `time_s`, and one column for each band, a marked place of the body. The bands are in the order from
the front of the animal to the rear, and have freely chosen names. A file with several recordings has a column
`recording` with the name of the recording to which a row belongs. A minimum of a band's values marks the time when the
wave passes the band. Cells that are blank or exactly 0 count as not measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from control.gaits import Direction
from control.gaits.neural.recording import Waves, pick
from scenes.language.errors import SceneError
from scenes.records import csv_file
from worm3d.values.arrays import FloatArray

TIME, NAME = "time_s", "recording"
"""Names of the two columns that do not belong to a band."""


@dataclass(frozen=True)
class Recording:
    """One recording and its waves."""

    name: str
    time: FloatArray
    """Times [s], shape (T,)."""
    values: FloatArray
    """Recorded values, shape (T, bands). The bands are in the order in which a wave passes them."""
    waves: Waves


def load(path: Path) -> tuple[Direction, list[Recording]]:
    """Return the direction of the waves, and the recordings of a file.

    Raises
    ------
    SceneError
        The file does not exist, does not have these columns, or has a recording without waves.
    DiscError
        The file is not readable.
    """
    _, titles, rows = csv_file.split(path)
    try:
        bands = tuple(title for title in titles if title not in (TIME, NAME))
        if TIME not in titles or len(set(bands)) < max(3, len(bands)):
            raise SceneError(
                f"got the columns {', '.join(titles)}, must be {TIME} and one for each of at least 3 bands, named "
                "differently, from the front of the animal to its rear"
            )
        tables = {name: csv_file.table([TIME, *bands], own) for name, own in _by_name(titles, rows, path).items()}
        ways = {way: [_picked(*each, bands, way) for each in tables.items()] for way in get_args(Direction)}
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
    direction: Direction = max(ways, key=lambda way: sum(_ordered(found) for found, _ in ways[way]))
    found, wrong = zip(*ways[direction], strict=True)
    if any(wrong):
        raise SceneError(*(f"{path}: {sentence}" for sentence in wrong if sentence))
    return direction, list(found)


def _picked(name: str, table: FloatArray, bands: tuple[str, ...], way: Direction) -> tuple[Recording | None, str]:
    """Return a recording and an empty string, or None and the reason if it has no waves in the direction `way`."""
    order = slice(None, None, -1 if way == "direct" else 1)  # direct waves reach the rear first
    time, values = table[:, 0], table[:, 1:][:, order]
    try:
        return Recording(name, time, values, pick(time, values, bands[order])), ""
    except ValueError as error:
        return None, f"recording '{name}': {str(error).removeprefix('recording: ')}"


def _ordered(found: Recording | None) -> int:
    """Return the number of pairs of neighbouring bands whose median delays are in the order of the wave."""
    return int((np.diff(found.waves.median()) > 0.0).sum()) if found else 0


def _by_name(titles: list[str], rows: csv_file.Rows, path: Path) -> dict[str, csv_file.Rows]:
    """Return the rows of each recording by its name, with the time first and without the column `recording`."""
    named, kept = titles.index(NAME) if NAME in titles else None, [n for n, t in enumerate(titles) if t != NAME]
    time = kept.pop(kept.index(titles.index(TIME)))
    found: dict[str, csv_file.Rows] = {}
    for line, row in rows:
        if len(row) != len(titles):
            raise SceneError(f"line {line}: got {len(row)} cells, must be {len(titles)} as in the row of column names")
        name = path.name.partition(".")[0] if named is None else row[named].strip()
        found.setdefault(name, []).append((line, [row[time], *(row[n] for n in kept)]))
    return found
