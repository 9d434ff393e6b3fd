"""The largest time step whose distance is within a tolerance of that of a much smaller one.

Steps are halved from the coarsest on: dt_k = coarsest/2^k with the distance d_k. Step k holds if it and every smaller
one agree with the reference d_r, r = k + 3 (an eighth of the step), or less if the time for the search is used up:

    |d_j - d_r| <= tolerance |d_r|   for j = k ... r - 1

so that a coarse step which is right by luck between two wrong ones does not count. Quarters of an octave above
the first step that holds are tried against the same reference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

from speed_measures import relative_error

REFERENCE_RUNGS = 3
"""Halvings from a step to its reference: dt/8."""
QUARTERS = 4
"""Trial steps in an octave."""


class NotConvergedError(RuntimeError):
    """No step within reach holds the tolerance."""


@dataclass(frozen=True)
class Step:
    """A time step and how well it does.

    Attributes
    ----------
    dt : float
        [s].
    error : float
        Of the distance, relative to the reference.
    reference_dt : float
        Step of the reference [s].
    """

    dt: float
    error: float
    reference_dt: float


class Ladder:
    """Distances at a step that is halved again and again, until time is up.

    Parameters
    ----------
    distance : callable
        Time step [s] -> distance [m], NaN if the run failed.
    coarsest : float
        First step [s].
    seconds : float
        Wall clock that all runs together may take; the next one is expected to take twice as long as the last.
    """

    def __init__(self, distance: Callable[[float], float], coarsest: float, seconds: float) -> None:
        self.distance = distance
        self.coarsest = coarsest
        self.left = seconds
        self.last_run = 0.0
        self.distances: list[float] = []

    def reach(self, rung: int) -> int:
        """Run as far down as `rung` if time allows, and return the last rung there is."""
        while len(self.distances) <= rung and 2.0 * self.last_run <= self.left:
            start = perf_counter()
            self.distances.append(self.distance(self.dt(len(self.distances))))
            self.last_run = perf_counter() - start
            self.left -= self.last_run
        return len(self.distances) - 1

    def dt(self, rung: int) -> float:
        """Return the step of a rung [s]."""
        return self.coarsest / 2.0**rung

    def holds(self, rung: int, tolerance: float) -> bool:
        """Return whether all steps from `rung` on agree with the last one."""
        others = self.distances[rung:-1]
        return bool(others) and all(relative_error(d, self.distances[-1]) <= tolerance for d in others)


def largest_step(distance: Callable[[float], float], *, coarsest: float, tolerance: float, seconds: float) -> Step:
    """Return the largest step that holds the tolerance.

    Raises
    ------
    NotConvergedError
        Time was up first.
    """
    ladder = Ladder(distance, coarsest, seconds)
    rung = 0
    while rung < ladder.reach(rung + REFERENCE_RUNGS):
        if ladder.holds(rung, tolerance):
            return _between(ladder, rung, tolerance)
        rung += 1
    raise NotConvergedError(
        f"no step from {coarsest:.3g} s down to {ladder.dt(max(0, rung - 1)):.3g} s gives the distance to "
        f"{tolerance:.3g} within {seconds:.0f} s of computing; allow more time"
    )


def _between(ladder: Ladder, rung: int, tolerance: float) -> Step:
    """Return the largest step in the octave above a rung up to which all trial steps hold."""
    reference = ladder.distances[-1]
    dt, error = ladder.dt(rung), relative_error(ladder.distances[rung], reference)
    for quarter in range(1, QUARTERS if rung else 1):
        trial = ladder.dt(rung) * 2.0 ** (quarter / QUARTERS)
        trial_error = relative_error(ladder.distance(trial), reference)
        if not trial_error <= tolerance:
            break
        dt, error = trial, trial_error
    return Step(dt, error, ladder.dt(len(ladder.distances) - 1))
