"""Pictures of a run on a robot. The body is reconstructed from measured chamber lengths, place and heading."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenes.records.record import Record
from worm3d.recorded.state import apexes_of, level_directors
from worm3d.results import files, pictures
from worm3d.values.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHORTEST = 0.05
"""Least length of a chamber in the picture, as a fraction of its length at rest: noise must not turn it inside out."""


def view(record: Record, path: Path, *, skin: bool = True) -> None:
    """Write the page that plays a run on a robot in a browser. The loads are unknown, and are drawn as none."""
    from worm3d.viewer import write_html

    worm, world = _restored(record, "worm"), _restored(record, "world")
    rows = pictures.rows_shown(record["time"], worm.segments, None, None)
    series = body(record, worm, rows)
    write_html(pictures.arrays(series, worm, world, None), path, skin=skin, title=record.title)


def chambers(record: Record) -> tuple[Figure, Axes]:
    """Draw the commands to the chambers and their strains over time and along the robot."""
    from planar.figures import space_time

    time, l0 = record["time"], _restored(record, "worm").l0
    strain = _filled(time, record["chamber_length"]) / l0 - 1.0
    both = {"command": record["command"], "strain": strain}
    sides = enumerate(("left", "right"))
    panels = {f"{name}, {side}": (time, values[..., k]) for k, side in sides for name, values in both.items()}
    return space_time(panels, "segment (0 = tail)", title=f"{record.title}: chambers")


def _restored(record: Record, name: str) -> Any:
    return files.restored(name, json.loads(record.run)[name], [variable.values for variable in record.parts])


def is_shown(record: Record) -> bool:
    """Return whether a measurement says enough for a page."""
    return bool(record.run) and all(name in record for name in ("com", "chamber_length"))


def body(record: Record, worm: Any, rows: list[int]) -> dict[str, FloatArray]:
    """Return the series of `worm3d.results.pictures.SERIES` at some rows of a record.

    The chord of the body has the measured or estimated heading. Neighbouring segments turn by the angle at which the
    yaw strain of (E5) is 0, and all of them are at the height of the centre of mass.
    """
    time, n = record["time"], worm.segments
    length = _filled(time, record["chamber_length"])[rows]
    reach = 2.0 * np.asarray(worm.segment.reach(worm))[:, None]
    length = np.clip(length, SHORTEST * worm.l0, 0.999 * reach)
    bend = (
        (length[..., 1] - length[..., 0]) / (2.0 * worm.chamber_offset) if worm.chamber_offset else 0.0 * length[..., 0]
    )
    hinge = record["hinge"][rows] if "hinge" in record else np.zeros((len(rows), n - 1))
    yaw = (bend[:, 1:] + bend[:, :-1]) / 2.0 + hinge
    azimuth = np.concatenate([np.zeros((len(rows), 1)), np.cumsum(yaw, axis=1)], axis=1)
    edges = _along(azimuth, length.mean(axis=2))
    chord = edges.sum(axis=1)
    turn = _heading(record)[rows] - np.arctan2(chord[:, 1], chord[:, 0])
    edges = _along(azimuth + turn[:, None], length.mean(axis=2))
    joints = np.concatenate([np.zeros((len(rows), 1, 3)), np.cumsum(edges, axis=1)], axis=1)
    com = _filled(time, record["com"])[rows]
    joints += (com - (joints[:, 1:] + joints[:, :-1]).mean(axis=1) / 2.0)[:, None]
    contraction = record["command"][rows]
    directors = np.array([level_directors(each) for each in joints])
    given = zip(joints, directors, length, contraction, strict=True)
    apexes = np.array([apexes_of(worm, *each) for each in given])
    ends = np.stack([joints[:, :-1], joints[:, 1:]], axis=2)
    unknown = {"contact_force": (n, 8, 3), "normal_load": (n, 6), "slip": (n, 6), "joint_load": (n + 1,)}
    return {
        "time": time[rows],
        "joints": joints,
        "points": np.concatenate([apexes, ends], axis=2),
        "directors": directors,
        "chamber_length": length,
        "com": com,
        **{name: np.zeros((len(rows), *inner)) for name, inner in {**unknown, "joint_slip": (n + 1,)}.items()},
    }


def _along(azimuth: FloatArray, length: FloatArray) -> FloatArray:
    return np.stack([length * np.cos(azimuth), length * np.sin(azimuth), np.zeros_like(length)], axis=2)


def _heading(record: Record) -> FloatArray:
    """Return the heading, shape (T,) [rad]; without one, the direction of the whole way."""
    time = record["time"]
    if "heading" in record and np.isfinite(record["heading"]).any():
        known = np.isfinite(record["heading"])
        return np.asarray(np.interp(time, time[known], np.unwrap(record["heading"][known])))
    com = _filled(time, record["com"])
    way = com[-1] - com[0]
    return np.full(len(time), np.arctan2(way[1], way[0]))


def _filled(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return a series with missing values interpolated, shape (T, ...)."""
    columns = values.reshape(len(values), -1).T
    filled = [
        np.interp(time, time[np.isfinite(c)], c[np.isfinite(c)]) if np.isfinite(c).any() else 0.0 * time
        for c in columns
    ]
    return np.asarray(filled).T.reshape(values.shape)
