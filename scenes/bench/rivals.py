"""What a rival simulator has to answer, and how it is measured: speed at an equal distance error of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from time import perf_counter
from typing import Protocol

from scenes.bench.search import REFERENCE_RUNGS, Step, largest_step, relative_error
from scenes.bench.task import steps_of

DURATION = 10.0
"""Of the run whose distance counts [s]."""
TOLERANCE = 0.01
"""Distance error at which speeds are compared."""
REPEATS = 3
"""Timed runs, of which the fastest counts."""
WARM_UP = 0.1
"""Length of the run before them [s]."""
COARSEST = 0.02
"""First step of the search [s]."""
SEARCH_SECONDS = 300.0
"""Wall clock that the search for a step may take."""

_CLASSES = {
    "mujoco": ("scenes.bench.mujoco_worm", "MuJoCoWorm"),
    "pyelastica": ("scenes.bench.pyelastica_worm", "PyElasticaWorm"),
}


class MissingRivalError(ImportError):
    """A rival simulator is not installed; the sentence says how to get it."""


class Rival(Protocol):
    """A simulator on the task of `scenes.bench.task`, N segments at a time step of one's choice."""

    @property
    def name(self) -> str:
        """Name and version."""

    @property
    def cannot(self) -> tuple[str, ...]:
        """What of the worm it cannot express, a phrase each."""

    def settings(self, segments: int) -> str:
        """Return the configuration it runs in, in words."""

    def run(self, segments: int, duration: float, dt: float) -> float:
        """Return how far the centre of mass goes along x [m]; NaN if the run fails."""

    def step_at_error(self, segments: int, tolerance: float = TOLERANCE) -> float:
        """Return the largest step with that error of the distance [s]."""

    def distance_error(self, segments: int, dt: float) -> float:
        """Return the error of the distance at that step, relative to a reference of its own."""

    def real_time_factor(self, segments: int, dt: float, duration: float) -> float:
        """Return simulated over computing time."""


@dataclass(frozen=True)
class Measured:
    """A rival at the step where its own distance error is at most the tolerance.

    Attributes
    ----------
    dt : float
        [s].
    error : float
        Of the distance after 10 s, relative.
    us_per_step : float
        [µs].
    real_time_factor : float
        Simulated over computing time, of one core.
    """

    dt: float
    error: float
    us_per_step: float
    real_time_factor: float


def names() -> tuple[str, ...]:
    """Return the names of all rivals."""
    return tuple(_CLASSES)


def load(name: str, seconds: float = SEARCH_SECONDS) -> Rival:
    """Return a rival by its name; KeyError if there is none.

    Parameters
    ----------
    name : str
    seconds : float
        Wall clock that the search for a step may take.

    Raises
    ------
    MissingRivalError
        It is not installed.
    """
    module, attribute = _CLASSES[name]
    try:
        rival: Rival = getattr(import_module(module), attribute)(seconds=seconds)
    except ImportError as error:
        raise MissingRivalError(
            f"{name} cannot be imported ({error}); it comes with the extra 'bench': "
            "pip install -c requirements.lock -e '.[bench]'"
        ) from error
    return rival


def measure(rival: Rival, segments: int, tolerance: float = TOLERANCE) -> Measured:
    """Measure a rival at the largest step with that error of the distance after 10 s."""
    dt = rival.step_at_error(segments, tolerance)
    factor = rival.real_time_factor(segments, dt, DURATION)
    return Measured(dt, rival.distance_error(segments, dt), 1e6 * dt / factor, factor)


class Searching(ABC):
    """The part of a rival that is the same for all: the search for the step, and the timing.

    Parameters
    ----------
    seconds : float
        Wall clock that the search for a step may take.
    """

    def __init__(self, seconds: float = SEARCH_SECONDS) -> None:
        self.seconds = seconds
        self._found: dict[tuple[int, float], Step] = {}

    @abstractmethod
    def prepare(self, segments: int, duration: float, steps: int) -> Callable[[], float]:
        """Return a simulation, ready to go: called once, it returns the distance along x [m]."""

    def run(self, segments: int, duration: float, dt: float) -> float:
        """Return how far the centre of mass goes along x [m]; NaN if the run fails."""
        return self.prepare(segments, duration, steps_of(duration, dt))()

    def step_at_error(self, segments: int, tolerance: float = TOLERANCE) -> float:
        """Return the largest step with that error of the distance [s].

        Raises
        ------
        NotConvergedError
            The search took too long.
        """
        return self._search(segments, tolerance).dt

    def distance_error(self, segments: int, dt: float) -> float:
        """Return the error of the distance at that step: as `step_at_error` found it, else against dt/8."""
        for (n, _), step in self._found.items():
            if (n, dt) == (segments, step.dt):
                return step.error
        return relative_error(self.run(segments, DURATION, dt), self.run(segments, DURATION, dt / 2**REFERENCE_RUNGS))

    def real_time_factor(self, segments: int, dt: float, duration: float) -> float:
        """Return simulated over computing time: the fastest of some runs, after a warm-up."""
        self.run(segments, min(WARM_UP, duration), dt)
        runs = (self.prepare(segments, duration, steps_of(duration, dt)) for _ in range(REPEATS))
        return duration / min(_seconds(go) for go in runs)

    def _search(self, segments: int, tolerance: float) -> Step:
        key = segments, tolerance
        if key not in self._found:
            self._found[key] = largest_step(
                lambda dt: self.run(segments, DURATION, dt),
                coarsest=COARSEST,
                tolerance=tolerance,
                seconds=self.seconds,
            )
        return self._found[key]


def _seconds(go: Callable[[], float]) -> float:
    start = perf_counter()
    go()
    return perf_counter() - start
