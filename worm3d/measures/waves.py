"""The last whole periods ("waves") of a run, over which measures of a gait are taken."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from worm3d.measures.table import NoValueError
from worm3d.measures.way import NO_HEADING, NO_PERIOD, along_the_ground
from worm3d.recorded.finished import FinishedRun
from worm3d.values.arrays import FloatArray
from worm3d.values.period_means import SHORT_RUN, integrals
from worm3d.values.read_only import kept

FEWEST_ROWS = 8
"""Minimum number of recorded rows per period. With fewer, the motion within the period is not resolved."""
SPARSE_IN_PERIOD = f"the result has fewer than {FEWEST_ROWS} rows in a period of the gait: record more rows"


class Waves:
    """The K last whole periods of a run: as many as fit into the second half of the run, but at least one.

    The first half is left out because a worm that starts at rest needs some waves until its motion repeats.

    Raises
    ------
    NoValueError
        The run has no period, is shorter than a period, or has too few rows.
    """

    def __init__(self, result: FinishedRun) -> None:
        time, period = result.time, result.period
        if period is None:
            raise NoValueError(NO_PERIOD)
        span = float(time[-1] - time[0])
        if len(time) < 2 or span < period * (1.0 - 1e-9):
            raise NoValueError(SHORT_RUN)
        if float(time[1] - time[0]) * FEWEST_ROWS > period * (1.0 + 1e-9):
            raise NoValueError(SPARSE_IN_PERIOD)
        self._result, self.period = result, period
        self.count = max(1, int(0.5 * span / period + 1e-9))
        self.edges = np.maximum(time[-1] - period * np.arange(self.count, -1.0, -1.0), time[0])
        """Instants at the ends of the periods, shape (K+1,) [s]."""
        self._k = np.clip(np.searchsorted(time, self.edges, side="right") - 1, 0, len(time) - 2)
        self._share = (self.edges - time[self._k]) / (time[self._k + 1] - time[self._k])

    def at_edges(self, values: FloatArray) -> FloatArray:
        """Return a series, shape (T, ...), interpolated at `edges`, shape (K+1, ...)."""
        share = self._share.reshape(-1, *(1,) * (values.ndim - 1))
        found: FloatArray = values[self._k] + share * (values[self._k + 1] - values[self._k])
        return found

    @cached_property
    def first(self) -> int:
        """Index of the last row that is not after the start of the first period."""
        return int(self._k[0])

    @cached_property
    def weights(self) -> FloatArray:
        """Fraction of each interval between rows that lies in the periods, from row `first` on, shape (T-1-first,)."""
        weights = np.ones(len(self._result.time) - 1 - self.first)
        weights[0] = 1.0 - self._share[0]
        return weights

    def mean(self, values: FloatArray) -> float:
        """Return the mean of `values` over the periods. Each value belongs to one of the intervals of `weights`."""
        return float(self.weights @ values / self.weights.sum())

    @cached_property
    def turns(self) -> FloatArray:
        """Turn to the left in each period, shape (K,) [rad]. Raises NoValueError for a vertical body."""
        return np.diff(self.at_edges(self._heading))

    @property
    def _heading(self) -> FloatArray:
        heading = self._result.heading
        if np.isnan(heading[self.first :]).any():
            raise NoValueError(NO_HEADING)
        return heading

    @cached_property
    def forward(self) -> FloatArray:
        """Mean heading of each period as a vector in the world's tangent plane, shape (K, 3)."""
        world, joints = self._result.world, self._result.joints
        turned = np.diff(integrals(self._heading[:, None], self._result.time, self.edges)[:, 0])
        azimuth = turned / self.period
        level = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(self.count)])
        if world is None:
            return level
        return np.array([world.forward(joints[k], each) for k, each in zip(self._k, level, strict=False)])

    @cached_property
    def course(self) -> FloatArray | None:
        """Progress along the course of the world (for example, of a pipe) in each period, shape (K,) [m].

        None if the world has no course.
        """
        result = self._result
        if result.world is None:
            return None
        course = result.world.course(self.at_edges(result.com), result.joints[0])
        return None if course is None else np.diff(course)

    @cached_property
    def steps(self) -> FloatArray:
        """Displacement of the centre of mass in each period, along the ground, shape (K, 3) [m]."""
        return np.diff(self.at_edges(along_the_ground(self._result)), axis=0)

    @cached_property
    def path(self) -> FloatArray:
        """Distance travelled in each period, in any direction, shape (K,) [m]."""
        return np.linalg.norm(self.steps, axis=1) if self.course is None else np.abs(self.course)


@kept
def waves_of(result: FinishedRun) -> Waves:
    """Return the last whole periods of a run; raise NoValueError if there are none."""
    return Waves(result)
