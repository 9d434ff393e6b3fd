"""Spread of the distances of runs with different start positions, which matter on uneven ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from worm3d.measures.way import distance
from worm3d.recorded.finished import FinishedRun
from worm3d.recorded.state import State
from worm3d.values import arguments
from worm3d.values.documented import with_fields

MIN_STARTS = 24
"""Smallest number of starts for a mean. The standard error of the mean is then a fifth of the standard deviation."""
UNEVEN_GROUND_ADVICE = (
    "on uneven ground every stone decides, and a single distance means little: take the mean over "
    f"{MIN_STARTS} starts or more (worm3d.scattered, worm3d.simulate_batch, worm3d.Spread)"
)


@with_fields
@dataclass(frozen=True)
class Spread:
    """Mean and error of the distance of many runs that differ in unknown details, such as the exact start position."""

    mean: float
    """Mean of the distances [m]."""
    standard_error: float
    """Standard error of the mean [m]. The standard deviation of a single run is sqrt(`count`) times as large."""
    count: int
    """Number of runs."""

    @classmethod
    def of(cls, results: Sequence[FinishedRun]) -> Spread:
        """Return the spread of the distances of some runs.

        Raises
        ------
        ValueError
            Fewer than 24 runs, or a run that did not reach the end.
        """
        arguments.whole("results", len(results), ge=MIN_STARTS)
        for k, each in enumerate(results):
            if each.status.diverged:
                raise ValueError(f"results: got run {k}, of which {each.stop.sentence}; must have reached its end")
        way = np.array([distance(each) for each in results])
        return cls(float(way.mean()), float(way.std(ddof=1) / np.sqrt(len(way))), len(way))


def rough(result: FinishedRun) -> bool:
    """Return whether the ground has bumps above 1 % of a segment length. There the start affects the distance."""
    length = result.worm.l0
    return result.world is not None and result.world.bumps(length) > 0.01 * length


def scattered(state: State, count: int = MIN_STARTS, within: float | None = None, seed: int = 0) -> list[State]:
    """Return copies of a state with small horizontal shifts, for runs on uneven ground.

    Parameters
    ----------
    state : State
        State to copy.
    count : int
        Number of copies.
    within : float, optional
        Largest shift along x and y [m]. The default is a thousandth of the body length, which has no effect on even
        ground.
    seed : int
        Seed of the random shifts.

    Raises
    ------
    ValueError
        `count` is not at least 1, or `within` is not above 0.
    """
    arguments.whole("count", count)
    length = float(np.linalg.norm(np.diff(state.joints, axis=0), axis=1).sum())
    most = 1e-3 * length if within is None else within
    arguments.number("within", most, "m", gt=0.0)
    shifts = np.random.default_rng(seed).uniform(-most, most, (count, 3)) * [1.0, 1.0, 0.0]
    return [state.with_changes(joints=state.joints + shift) for shift in shifts]
