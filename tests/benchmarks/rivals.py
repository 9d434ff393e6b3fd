"""What a rival simulator is asked to do, and how it is measured: speed at an equal distance error of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from time import perf_counter
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from speed_measures import relative_error, steps_of

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

GROUNDS = {
    "bristles": Friction(forward=0.03, backward=0.20, lateral=0.20, static_ratio=1.2),
    "isotropic": Friction(forward=0.20, backward=0.20, lateral=0.20, static_ratio=1.0),
}
"""Grounds on which simulators are compared, by name: every one can express the second."""

RIVALS = {"mujoco": ("mujoco_worm", "MuJoCoWorm"), "pyelastica": ("pyelastica_worm", "PyElasticaWorm")}
"""Module and class of each rival, by name."""


class NotConvergedError(RuntimeError):
    """No step within reach holds the tolerance."""


class Step(NamedTuple):
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


def largest_step(
    distance: Callable[[float], float], seconds: float, *, coarsest: float = 0.02, tolerance: float = TOLERANCE
) -> Step:
    """Return the largest time step whose distance is within a tolerance of that of a much smaller one.

    Steps are halved from the coarsest on: dt_k = coarsest/2^k with the distance d_k. Step k holds if it and every
    smaller one agree with the reference d_r, r = k + 3 (an eighth of the step), or less if the time for the search is
    used up:

        |d_j - d_r| <= tolerance |d_r|   for j = k ... r - 1

    so that a coarse step which is right by luck between two wrong ones does not count. Quarters of an octave above
    the first step that holds are tried against the same reference.

    Parameters
    ----------
    distance : callable
        Time step [s] -> distance [m], NaN if the run failed.
    seconds : float
        Wall clock that all runs together may take; the next one is expected to take twice as long as the last.
    coarsest : float
        First step [s].
    tolerance : float

    Raises
    ------
    NotConvergedError
        Time was up first.
    """
    distances, last, left, rung = list[float](), 0.0, seconds, 0
    while True:
        while len(distances) <= rung + 3 and 2.0 * last <= left:
            began = perf_counter()
            distances.append(distance(coarsest / 2.0 ** len(distances)))
            last = perf_counter() - began
            left -= last
        if rung >= len(distances) - 1:
            raise NotConvergedError(
                f"no step from {coarsest:.3g} s down to {coarsest / 2.0 ** max(0, rung - 1):.3g} s gives the distance "
                f"to {tolerance:.3g} within {seconds:.0f} s of computing; allow more time"
            )
        reference = distances[-1]
        if all(relative_error(each, reference) <= tolerance for each in distances[rung:-1]):
            break
        rung += 1
    dt, error = coarsest / 2.0**rung, relative_error(distances[rung], reference)
    for quarter in (0.25, 0.5, 0.75) if rung else ():
        trial = coarsest / 2.0**rung * 2.0**quarter
        trial_error = relative_error(distance(trial), reference)
        if not trial_error <= tolerance:
            break
        dt, error = trial, trial_error
    return Step(dt, error, coarsest / 2.0 ** (len(distances) - 1))


@dataclass(frozen=True)
class Task:
    """A worm and its ground, with the default gait."""

    worm: Worm
    friction: Friction

    @classmethod
    def of(cls, segments: int, ground: str = "bristles") -> Task:
        """Return the task with the default worm of N segments on one of `GROUNDS`."""
        return cls(Worm(segments=segments), GROUNDS[ground])

    @property
    def gait(self) -> TravellingWave:
        """Commanded contraction."""
        return TravellingWave()

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
class Contender:
    """A simulator on the worm of N segments on one of `GROUNDS`.

    Attributes
    ----------
    name, settings : str
        With version; the configuration in words.
    segments : int
    ground : str
    dt_s : float
        Largest step with an error of at most 1 % [s].
    error : float
        Relative error of the distance after 10 s by its own reference.
    distance : float
        Way of the centre of mass along x in 10 s [m].
    us_per_step : float
        [µs].
    real_time_factor : float
        Simulated over computing time on one core, of the steps alone.
    real_time_factor_of_call : float or None
        Of the whole call, for worm3d.
    ratio, ratio_of_call : float or None
        Of worm3d's real-time factor to this one, of the steps alone and of the whole call.
    """

    name: str
    settings: str
    segments: int
    ground: str
    dt_s: float
    error: float
    distance: float
    us_per_step: float
    real_time_factor: float
    real_time_factor_of_call: float | None = None
    ratio: float | None = None
    ratio_of_call: float | None = None


class Rival(ABC):
    """A simulator on the task, with N segments at a time step of one's choice.

    A subclass has the class attributes `name` (with version) and `cannot` (what of the worm it cannot express, a phrase
    each), `settings` and `prepare`; the search for the step and the timing are the same for all.
    """

    name: ClassVar[str]
    cannot: ClassVar[tuple[str, ...]]

    @abstractmethod
    def settings(self, segments: int) -> str:
        """Return the configuration it runs in, in words."""

    @abstractmethod
    def prepare(self, task: Task, duration: float, steps: int) -> Callable[[], float]:
        """Return a simulation, ready to go: called once, it returns the distance along x [m]."""

    def run(self, task: Task, duration: float, dt: float) -> float:
        """Return how far the centre of mass goes along x [m]; NaN if the run fails."""
        return self.prepare(task, duration, steps_of(duration, dt))()

    def real_time_factor(self, task: Task, dt: float, duration: float) -> float:
        """Return simulated over computing time: the fastest of some runs, after a warm-up."""
        self.run(task, WARM_UP, dt)
        runs = (self.prepare(task, duration, steps_of(duration, dt)) for _ in range(REPEATS))
        return duration / min(_seconds(go) for go in runs)

    def measured(self, segments: int, ground: str, seconds: float) -> Contender:
        """Measure it at the largest step with an error of the distance after 10 s of at most 1 %.

        Raises
        ------
        NotConvergedError
            The search took longer than `seconds`.
        """
        task = Task.of(segments, ground)
        step = largest_step(lambda dt: self.run(task, DURATION, dt), seconds)
        factor = self.real_time_factor(task, step.dt, DURATION)
        return Contender(
            name=self.name,
            settings=self.settings(segments),
            segments=segments,
            ground=ground,
            dt_s=step.dt,
            error=step.error,
            distance=self.run(task, DURATION, step.dt),
            us_per_step=1e6 * step.dt / factor,
            real_time_factor=factor,
        )


def _seconds(go: Callable[[], float]) -> float:
    start = perf_counter()
    go()
    return perf_counter() - start


def load(name: str) -> Rival:
    """Return a rival by its name.

    Raises
    ------
    MissingPartError
        It is not installed.
    """
    module, attribute = RIVALS[name]
    try:
        rival: Rival = getattr(import_module(module), attribute)()
    except ImportError as error:
        raise MissingPartError(
            f"{name} cannot be imported ({error}); it comes with the extra 'bench': "
            "pip install -c requirements.lock -e '.[bench]'"
        ) from error
    return rival
