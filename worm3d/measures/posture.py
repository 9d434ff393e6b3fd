"""Posture of a worm: its roll, and whether it lies on its side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from worm3d.recorded.finished import FinishedRun
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import kept

if TYPE_CHECKING:
    from worm3d.worlds import World

ON_ITS_SIDE = float(np.deg2rad(35.0))
"""A worm is considered to lie on its side above this roll [rad].

A default worm that lies on its side has a roll of 45 degrees. A crawling worm has a roll of at most 5 degrees on level
ground and on slopes, and 20 degrees in the bend of a pipe. For moments it has 18 degrees on rubble and 30 degrees in a
tunnel.
"""

MIN_SIDE_TIME = 0.5
"""Shortest time on the side that counts [s]. A worm that rocks is on its side for shorter times."""


def roll(result: FinishedRun, rows: slice = slice(None)) -> FloatArray:
    """Return the roll of a worm to its left, the median over the segments, at rows of a result, shape (T,) [rad].

    The roll is NaN at rows where the worm touches nothing or does not lie on ground. Walls are not ground, and without
    gravity no surface is ground.
    """
    joints, directors = result.joints[rows], result.directors[rows]
    rolls, weight = np.full(len(joints), np.nan), float(np.linalg.norm(result.gravity))
    if result.world is None or weight == 0.0:
        return rolls
    middle = joints[:1].mean(axis=1) if result.world.flat else (joints[:, 1:] + joints[:, :-1]) / 2.0
    normal = np.broadcast_to(_normals(result.world, middle, result.worm.length), directors.shape)
    load = result.normal_load[rows].sum(axis=(1, 2)) + result.joint_load[rows].sum(axis=1)
    level = normal @ (-result.gravity / weight) > 0.5  # a pipe's wall beside the worm is not ground
    seen = (load > 0.0) & level.all(axis=1)
    sine = (directors[seen] * normal[seen]).sum(axis=-1)
    rolls[seen] = -np.median(np.arcsin(np.clip(sine, -1.0, 1.0)), axis=1)
    return rolls


@dataclass(frozen=True, eq=False)
class Rolled:
    """Roll of a worm at some rows of a run: all rows on a plane, otherwise five rows per `MIN_SIDE_TIME`."""

    time: FloatArray
    """Instants, shape (R,) [s]."""
    roll: FloatArray
    """Roll, shape (R,) [rad]; NaN as in the function `roll`."""
    step: int
    """Stride in these rows with which `on_its_side` reads the roll; it corresponds to a tenth of a second."""

    @property
    def largest(self) -> float | None:
        """Largest roll to either side [rad]; None if the roll is NaN at all rows."""
        return None if np.isnan(self.roll).all() else float(np.nanmax(np.abs(self.roll)))


@kept
def rolled(result: FinishedRun) -> Rolled:
    """Return the roll of a run's worm."""
    apart = float(result.time[1] - result.time[0]) if len(result.time) > 1 else MIN_SIDE_TIME
    step = max(1, int(MIN_SIDE_TIME / (5.0 * apart)))
    even = result.world is not None and result.world.flat
    rows = slice(None, None, 1 if even else step)
    return Rolled(result.time[rows], roll(result, rows), step if even else 1)


@kept
def on_its_side(result: FinishedRun) -> float | None:
    """Return the time when a worm first begins to lie on its side for `MIN_SIDE_TIME` [s]; None if it never does."""
    if len(result.time) < 2:
        return None
    found = rolled(result)
    time, lies = found.time[:: found.step], np.abs(np.nan_to_num(found.roll[:: found.step])) > ON_ITS_SIDE
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lies.astype(int), [0]])))
    for begin, end in edges.reshape(-1, 2):
        if time[end - 1] - time[begin] >= MIN_SIDE_TIME * (1.0 - 1e-9):
            return float(time[begin])
    return None


def _normals(world: World, places: FloatArray, length: float) -> FloatArray:
    """Return unit normals of the world at places, an array (..., 3); zeros where the world has no normal."""
    gradient = world.normal(places, length)
    size = np.linalg.norm(gradient, axis=-1, keepdims=True)
    known = np.isfinite(size) & (size > 0.5)
    normals: FloatArray = np.where(known, gradient / np.where(known, size, 1.0), 0.0)
    return normals
