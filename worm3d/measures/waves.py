"""The last whole periods of a run, for measures of a gait."""

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
"""Smallest number of recorded instants in a period that resolves the motion within the period."""
SPARSE_IN_PERIOD = f"the result has fewer than {FEWEST_ROWS} rows in a period of the gait: record more of them"


class Waves:
    """The last whole periods in the second half of a run, at least one; K periods.

    The first half is left out since a worm that starts at rest needs some waves until the waves repeat.

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
        """Instants between the periods, shape (K+1,) [s]."""
        self._k = np.clip(np.searchsorted(time, self.edges, side="right") - 1, 0, len(time) - 2)
        self._share = (self.edges - time[self._k]) / (time[self._k + 1] - time[self._k])

    def at_edges(self, values: FloatArray) -> FloatArray:
        """Return a series, shape (T, ...), at the instants between the periods, shape (K+1, ...)."""
        share = self._share.reshape(-1, *(1,) * (values.ndim - 1))
        found: FloatArray = values[self._k] + share * (values[self._k + 1] - values[self._k])
        return found

    @cached_property
    def first(self) -> int:
        """Row before the first period, or at the start of the first period."""
        return int(self._k[0])

    @cached_property
    def weights(self) -> FloatArray:
        """Share of the time before each row after `first` that is counted, shape (T - 1 - first,)."""
        weights = np.ones(len(self._result.time) - 1 - self.first)
        weights[0] = 1.0 - self._share[0]
        return weights

    def mean(self, values: FloatArray) -> float:
        """Return the mean over the periods of values for the time before each row after `first`."""
        return float(self.weights @ values / self.weights.sum())

    @cached_property
    def turns(self) -> FloatArray:
        """Turn to the left in each period, shape (K,) [rad]; NoValueError for a vertical body."""
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
        """Progress of the worm along the course of the world (a pipe) in each period, shape (K,) [m]."""
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
    """Return the last whole periods of a run; NoValueError if there are none."""
    return Waves(result)
