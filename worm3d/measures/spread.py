"""Spread of runs with different start positions: on uneven ground the start position decides the distance."""

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
"""Smallest number of starts for a mean: the error of the mean is then a fifth of the spread."""
UNEVEN_GROUND_ADVICE = (
    "on uneven ground every stone decides, and a single distance means little: take the mean over "
    f"{MIN_STARTS} starts or more (worm3d.scattered, worm3d.simulate_batch, worm3d.Spread)"
)


@with_fields
@dataclass(frozen=True)
class Spread:
    """Distance of many runs that differ in unknown details, such as the exact start position."""

    mean: float
    """Mean [m]."""
    standard_error: float
    """Standard deviation of the mean [m]; for a single run, multiply by the square root of `count`."""
    count: int

    @classmethod
    def of(cls, results: Sequence[FinishedRun]) -> Spread:
        """Return the spread of runs.

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
    """Return whether the ground has bumps of 1 % of a segment length, so that the start decides the distance."""
    length = result.worm.l0
    return result.world is not None and result.world.bumps(length) > 0.01 * length


def scattered(state: State, count: int = MIN_STARTS, within: float | None = None, seed: int = 0) -> list[State]:
    """Return copies of a state with small horizontal shifts, for runs on uneven ground.

    Parameters
    ----------
    state : State
    count : int
    within : float, optional
        Largest shift along x and y [m]; a thousandth of the length of the body if left out, which no worm feels.
    seed : int

    Raises
    ------
    ValueError
        No start, or a shift that is not above 0.
    """
    arguments.whole("count", count)
    length = float(np.linalg.norm(np.diff(state.joints, axis=0), axis=1).sum())
    most = 1e-3 * length if within is None else within
    arguments.number("within", most, "m", gt=0.0)
    shifts = np.random.default_rng(seed).uniform(-most, most, (count, 3)) * [1.0, 1.0, 0.0]
    return [state.with_changes(joints=state.joints + shift) for shift in shifts]
