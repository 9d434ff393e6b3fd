"""What a reference asks for over a horizon, from where the worm is now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from control.tracking.references import Reference
from worm3d.values.arrays import FloatArray

MOMENT = 0.05
"""Over which a heading's rate is taken [s]."""


@dataclass(frozen=True, eq=False)
class Preview:
    """What is asked for at K instants.

    Attributes
    ----------
    speed : ndarray, shape (K,)
        Forward [m/s].
    point : ndarray, shape (K, 2)
        Of the path [m]; zeros where there is none.
    heading : ndarray, shape (K,)
        Of the path, or as asked for, on the turn of the worm's own heading [rad]; zeros where none is.
    follows, heads : bool
        Whether there is a path, and whether there is a heading.
    progress : float
        Arc length of the path's point nearest to the worm [m]; 0 without a path.
    """

    speed: FloatArray
    point: FloatArray
    heading: FloatArray
    follows: bool
    heads: bool
    progress: float


def look_ahead(
    reference: Reference, begin: float, step: float, steps: int, place: FloatArray, azimuth: float, near: float | None
) -> Preview:
    """Return what is asked for at the ends of the steps of a horizon.

    The point of the path advances at the reference speed from where the worm is, whatever the worm does.

    Parameters
    ----------
    reference : Reference
    begin, step : float
        Of the horizon [s].
    steps : int
    place : ndarray, shape (2,)
        Of the worm [m].
    azimuth : float
        Its heading [rad].
    near : float or None
        Progress before, near which the new one is looked for [m].
    """
    ends = begin + step * np.arange(1, steps + 1)
    speed = np.asarray(reference.speed(ends), dtype=float)
    point, heading, progress = np.zeros((steps, 2)), np.zeros(steps), 0.0
    if reference.path is not None:
        progress = float(reference.path.project(place, near))
        ahead = progress + np.cumsum(np.asarray(reference.speed(ends - step / 2.0), dtype=float)) * step
        point, heading = reference.path.point(ahead), reference.path.heading(ahead)
        heading = on_turn(heading, float(reference.path.heading(progress)), azimuth)
    elif reference.heading is not None:
        heading = np.asarray(reference.heading(ends), dtype=float)
        heading = on_turn(heading, float(heading[0]), azimuth)
    follows = reference.path is not None
    return Preview(speed, point, heading, follows, follows or reference.heading is not None, progress)


def on_turn(heading: FloatArray, first: float, azimuth: float) -> FloatArray:
    """Return headings counted on or back by whole turns, so that `first` comes nearest to an azimuth [rad]."""
    turns = float(np.round((first - azimuth) / (2.0 * np.pi)))
    return np.asarray(heading - 2.0 * np.pi * turns)


def turn_rate(reference: Reference, t: float, progress: float) -> float:
    """Return the turn rate that a reference asks for at time t [s], on the way at `progress` [m], in rad/s."""
    if reference.path is not None:
        return float(reference.path.curvature(progress)) * float(reference.speed(t))
    if reference.heading is not None:
        return (float(reference.heading(t + MOMENT)) - float(reference.heading(t))) / MOMENT
    return 0.0
