"""The runs that are measured: default worm, plane, friction and travelling wave."""

from __future__ import annotations

import numpy as np

import worm3d
from control.gaits import TravellingWave
from scenes.bench.task import steps_of
from scenes.language.errors import SceneError
from worm3d import Plane, Result, Status, Worm

DT = 0.01
"""Time step of the speeds [s]."""
FINER = 20
"""By which the step of the reference is smaller."""


TOLERANCE = 1e-9
"""Of Newton: distances change by less than 1e-6 of themselves."""

FLATTENED = 3
"""The default worm of so few segments is pressed flat by its own weight."""
STIFFER = 3.0
"""By which the chambers of such a worm are stiffer, so that it stands."""


class StoppedError(SceneError):
    """A run that was to be measured did not reach its end."""

    exit_code = 3


def standing(segments: int) -> Worm:
    """Return the default worm of N segments, with stiffer chambers where it would not stand."""
    worm = Worm(segments=segments)
    return worm if segments > FLATTENED else Worm(segments=segments, k_spring=STIFFER * np.asarray(worm.k_spring))


def crawl(segments: int, duration: float, dt: float = DT, *, recorded: bool = True) -> Result:
    """Return a run of whole steps of at most dt, with every step recorded or only start and end.

    Raises
    ------
    StoppedError
        It did not reach its end.
    """
    steps = steps_of(duration, dt)
    result = worm3d.simulate(
        standing(segments),
        Plane(),
        actuation=TravellingWave(),
        duration=duration,
        dt=duration / steps,
        record_every=1 if recorded else steps,
        tolerance=TOLERANCE,
    )
    if result.status is not Status.DONE:
        raise StoppedError(f"bench: the worm of {segments} segments at dt = {dt:.4g} s: {result.stop.sentence}")
    return result


def us_per_step(result: Result) -> float:
    """Return the wall time of a step [µs]."""
    return 1e6 * result.wall_s / len(result.newton_iterations)
