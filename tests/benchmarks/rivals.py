"""What a rival simulator is asked to do, and how it is measured: speed at an equal distance error of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from time import perf_counter
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from speed_measures import relative_error, steps_of
from step_search import REFERENCE_RUNGS, Step, largest_step

from control.gaits import TravellingWave
from scenes.language.errors import MissingPartError
from worm3d import Friction, Worm
from worm3d.values.arrays import FloatArray

DURATION = 10.0
"""Duration of the run whose distance is compared [s]."""
TOLERANCE = 0.01
"""Relative distance error at which speeds are compared."""
REPEATS = 3
"""Number of timed runs, of which the fastest counts."""
WARM_UP = 0.1
"""Duration of the untimed run before them [s]."""
COARSEST = 0.02
"""First time step of the search [s]."""
SEARCH_SECONDS = 300.0
"""Wall-clock limit of the search for a time step [s]."""

GROUNDS = {
    "bristles": {"forward": 0.03, "backward": 0.20, "lateral": 0.20, "static_ratio": 1.2},
    "isotropic": {"forward": 0.20, "backward": 0.20, "lateral": 0.20, "static_ratio": 1.0},
}
"""Friction of the grounds on which simulators are compared, by name: every one can express the second."""

RIVALS = {"mujoco": ("mujoco_worm", "MuJoCoWorm"), "pyelastica": ("pyelastica_worm", "PyElasticaWorm")}
"""Module and class of each rival, by name."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """A worm, its gait and its ground; the defaults are the default worm and gait.

    Attributes
    ----------
    worm : Worm
    gait : TravellingWave
        Commanded contraction.
    forward, backward, lateral : float
        Kinetic friction coefficients against motion towards the head, towards the tail and sideways.
    static_ratio : float
        Static over kinetic friction.
    gravity : float
        [m/s^2].
    """

    worm: Worm = field(default_factory=Worm)
    gait: TravellingWave = field(default_factory=TravellingWave)
    forward: float
    backward: float
    lateral: float
    static_ratio: float
    gravity: float = 9.81

    @classmethod
    def of(cls, segments: int, ground: str = "bristles") -> Task:
        """Return the task with the default worm of N segments on one of `GROUNDS`."""
        return cls(worm=Worm(segments=segments), **GROUNDS[ground])

    @property
    def friction(self) -> Friction:
        """Coefficients of friction, as worm3d takes them."""
        return Friction(self.forward, self.backward, self.lateral, self.static_ratio)

    def contractions(self, times: ArrayLike) -> FloatArray:
        """Return the commanded contraction of each segment at `times`, shape (T,) [s], shape (T, N)."""
        moments = np.asarray(times, dtype=float)
        return self.gait.amplitude * np.array([self.gait.activation(t, self.worm.segments) for t in moments])

    @property
    def pitch(self) -> FloatArray:
        """Stiffness of the joints in pitch, shape (N-1,) [J]."""
        return np.asarray(self.worm.k_torsion)

    @property
    def yaw(self) -> FloatArray:
        """Stiffness of the joints in yaw, in series with the chambers' (k b^2/l0), shape (N-1,) [J].

        The rivals have no bend of the chambers as a coordinate of its own.
        """
        k = np.asarray(self.worm.k_spring)
        chambers = (k[1:] + k[:-1]) / 2.0 * self.worm.chamber_offset**2 / self.worm.l0
        stiffness: FloatArray = 1.0 / (1.0 / np.asarray(self.worm.k_yaw) + 1.0 / chambers)
        return stiffness

    @property
    def twist(self) -> FloatArray:
        """Stiffness of the joints in twist, shape (N-1,) [J]."""
        return np.asarray(self.worm.k_twist)


@dataclass(frozen=True)
class Measured:
    """Speed of a rival at the step where its own distance error is at most the tolerance.

    Attributes
    ----------
    dt : float
        [s].
    error : float
        Relative error of the distance after 10 s.
    us_per_step : float
        [µs].
    real_time_factor : float
        Simulated over computing time on one core.
    distance : float
        Way of the centre of mass along x in 10 s [m].
    """

    dt: float
    error: float
    us_per_step: float
    real_time_factor: float
    distance: float


class Rival(ABC):
    """A simulator on the task, with N segments at a time step of one's choice.

    A subclass has the class attributes `name` (with version) and `cannot` (what of the worm it cannot express, a phrase
    each), `settings` and `prepare`; the search for the step and the timing are the same for all.

    Parameters
    ----------
    seconds : float
        Wall-clock limit of the search for a step [s].
    ground : str
        One of `GROUNDS`.
    """

    name: ClassVar[str]
    cannot: ClassVar[tuple[str, ...]]

    def __init__(self, seconds: float = SEARCH_SECONDS, ground: str = "bristles") -> None:
        self.seconds = seconds
        self.ground = ground
        self._found: dict[tuple[int, float], Step] = {}

    def task(self, segments: int) -> Task:
        """Return the task with N segments."""
        return Task.of(segments, self.ground)

    @abstractmethod
    def settings(self, segments: int) -> str:
        """Return the configuration it runs in, in words."""

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
        key = segments, tolerance
        if key not in self._found:
            self._found[key] = largest_step(
                lambda dt: self.run(segments, DURATION, dt),
                coarsest=COARSEST,
                tolerance=tolerance,
                seconds=self.seconds,
            )
        return self._found[key].dt

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


def _seconds(go: Callable[[], float]) -> float:
    start = perf_counter()
    go()
    return perf_counter() - start


def load(name: str, seconds: float = SEARCH_SECONDS, ground: str = "bristles") -> Rival:
    """Return a rival by its name, on one of `GROUNDS`; `seconds` limits its search for a step.

    Raises
    ------
    MissingPartError
        It is not installed.
    """
    module, attribute = RIVALS[name]
    try:
        rival: Rival = getattr(import_module(module), attribute)(seconds=seconds, ground=ground)
    except ImportError as error:
        raise MissingPartError(
            f"{name} cannot be imported ({error}); it comes with the extra 'bench': "
            "pip install -c requirements.lock -e '.[bench]'"
        ) from error
    return rival


def measure(rival: Rival, segments: int, tolerance: float = TOLERANCE) -> Measured:
    """Measure a rival at the largest step with that error of the distance after 10 s."""
    dt = rival.step_at_error(segments, tolerance)
    factor = rival.real_time_factor(segments, dt, DURATION)
    error, distance = rival.distance_error(segments, dt), rival.run(segments, DURATION, dt)
    return Measured(dt, error, 1e6 * dt / factor, factor, distance)
