"""Recordings of crawling animals in a CSV file.

A file has a column `time_s`, and one column per band of the body (for example per segment), in the order from the front
of the animal to the rear. The names of these columns are arbitrary. If a file contains several recordings, its column
`recording` has the name of the row's recording. A local minimum of a band's values is the time when
the band is pulled along. Cells that are blank or exactly 0 mean "not measured".
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
"""Names of the columns that are not bands."""


@dataclass(frozen=True)
class Recording:
    """One recording and its waves."""

    name: str
    time: FloatArray
    """Times [s], shape (T,)."""
    values: FloatArray
    """Recorded values of the bands, shape (T, bands), in the order of the arrival of a wave."""
    waves: Waves


def load(path: Path) -> tuple[Direction, list[Recording]]:
    """Return the direction of the waves, and the recordings of a file.

    Raises
    ------
    SceneError
        The file does not exist, does not have the required columns, or has a recording without waves.
    DiscError
        The file is not readable.
    """
    _, titles, rows = csv_file.split(path)
    try:
        bands = tuple(title for title in titles if title not in (TIME, NAME))
        if TIME not in titles or len(set(bands)) < max(3, len(bands)):
            raise SceneError(
                f"got the columns {', '.join(titles)}, must be {TIME} and at least 3 bands with different names, from "
                "the front of the animal to its rear"
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
    """Return a recording whose waves go in the direction `way`, and "".

    If there are no such waves, return None and the reason.
    """
    order = slice(None, None, -1 if way == "direct" else 1)  # direct waves reach the rear first
    time, values = table[:, 0], table[:, 1:][:, order]
    try:
        return Recording(name, time, values, pick(time, values, bands[order])), ""
    except ValueError as error:
        return None, f"recording '{name}': {str(error).removeprefix('recording: ')}"


def _ordered(found: Recording | None) -> int:
    """Return the number of pairs of neighbouring bands whose median delays have the order of the wave."""
    return int((np.diff(found.waves.median()) > 0.0).sum()) if found else 0


def _by_name(titles: list[str], rows: csv_file.Rows, path: Path) -> dict[str, csv_file.Rows]:
    """Return the rows of each recording by its name, with the time and the bands only."""
    named, kept = titles.index(NAME) if NAME in titles else None, [n for n, t in enumerate(titles) if t != NAME]
    time = kept.pop(kept.index(titles.index(TIME)))
    found: dict[str, csv_file.Rows] = {}
    for line, row in rows:
        if len(row) != len(titles):
            raise SceneError(f"line {line}: got {len(row)} cells, must be {len(titles)} as in the row of column names")
        name = path.name.partition(".")[0] if named is None else row[named].strip()
        found.setdefault(name, []).append((line, [row[time], *(row[n] for n in kept)]))
    return found
