"""Preview: what a reference asks of a worm from where it is on, no faster than it can go, and not past the end.

The speed at arc length s of the path and time t is the least of

    |V_ref(t)|,   V_reach(kappa(s)),   (length - s)/T if the path ends                                          (P1)

V_reach being the greatest speed at which the worm can turn as the path does. The last one leads to the end as
exp(-t/T). Bounds of the offset e from the path are those of the corridor; an obstacle of radius R whose middle lies at
the arc length s_o and the offset e_o is passed on the side away from its middle,

    e >= e_o + sqrt(R^2 - (s - s_o)^2),   or   e <= e_o - sqrt(R^2 - (s - s_o)^2),   |s - s_o| < R              (P2)

on the other side where the corridor is too narrow for that: bounds that are given before a plan is sought, so that it
is not stuck between two ways around.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from control.tracking.paths import lengthening, offset
from control.tracking.references import Disc, Reference
from worm3d.values.arrays import FloatArray

MOMENT = 0.05
"""Time over which the rate of a heading is taken [s]."""
APPROACH = 2.5
"""Time T in which the way to the end of a path falls to 37 % [s]: two waves, since the speed lags behind by one."""
PASSES = 2
"""Number of times that the speed is looked up where it leads."""

Reach = Callable[[FloatArray], FloatArray]
"""Function of curvatures (...) [1/m] that gives the greatest speeds at which they can be followed (...) [m/s]."""


@dataclass(frozen=True, eq=False)
class Preview:
    """What a reference asks for at K instants."""

    speed: FloatArray
    """Speed forward [m/s], shape (K,)."""
    point: FloatArray
    """Points of the path [m], shape (K, 2); zeros without a path."""
    heading: FloatArray
    """Heading of the path, or as asked for, on the turn of the worm's own [rad], shape (K,); zeros if there is none."""
    follows: bool
    """Whether there is a path."""
    heads: bool
    """Whether there is a heading."""
    progress: float
    """Arc length of the path's point nearest to the worm [m]; 0 without a path."""
    left: FloatArray
    """Greatest offset to the left of the path that is allowed [m], shape (K,); infinite without a bound."""
    right: FloatArray
    """Greatest offset to the right, as a positive number [m], shape (K,)."""


def anywhere(curvature: FloatArray) -> FloatArray:
    """Return infinite speeds: those of a worm that can do anything."""
    return np.full(np.shape(curvature), np.inf)


def speed_at(reference: Reference, t: ArrayLike, s: ArrayLike, reach: Reach = anywhere) -> FloatArray:
    """Return the speeds [m/s] that a reference asks for at times [s] and arc lengths [m] of one shape, (P1).

    In a pipe that rises they are along it, and less as seen from above.
    """
    speed = np.asarray(reference.speed(t), dtype=float)
    path = reference.path
    most = reach(np.zeros(np.shape(t)) if path is None else path.curvature(s))
    if path is not None and reference.ends:
        most = np.minimum(most, np.maximum(path.length - np.asarray(s, dtype=float), 0.0) / APPROACH)
    speed = np.asarray(np.clip(speed, -most, most))
    return speed if path is None else speed / lengthening(path, s)


def look_ahead(
    reference: Reference,
    begin: float,
    step: float,
    steps: int,
    place: FloatArray,
    azimuth: float,
    near: float | None,
    reach: Reach = anywhere,
) -> Preview:
    """Return what is asked for at the ends of the steps of a horizon that begins at a time [s].

    The point of the path advances at the speed (P1) from where the worm is, whatever the worm does. The worm is at a
    place (2,) [m] with an azimuth [rad]; its progress is looked for near the one before [m].
    """
    ends, free = begin + step * np.arange(1, steps + 1), np.full(steps, np.inf)
    path, heading = reference.path, reference.heading
    if path is None:
        asked = np.zeros(steps)
        if heading is not None:
            asked = np.asarray(heading(ends), dtype=float)
            asked = _on_turn(asked, float(asked[0]), azimuth)
        speed = speed_at(reference, ends, asked, reach)
        return Preview(speed, np.zeros((steps, 2)), asked, False, heading is not None, 0.0, free, free)
    progress = float(path.project(place, near))
    s = np.full(steps + 1, progress)
    for _ in range(PASSES):
        s[1:] = progress + np.cumsum(speed_at(reference, ends - step / 2.0, (s[1:] + s[:-1]) / 2.0, reach)) * step
    along = s[1:]
    turned = _on_turn(path.heading(along), float(path.heading(progress)), azimuth)
    speed = speed_at(reference, ends, along, reach)
    return Preview(speed, path.point(along), turned, True, True, progress, *bounds(reference, along))


def bounds(reference: Reference, s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far a worm may be to the left and to the right at arc lengths (K,) of the path [m], (P2)."""
    left, right = np.full(len(s), reference.corridor), np.full(len(s), reference.corridor)
    for disc in reference.obstacles:
        beside, aside, on_left = passing(reference, disc)
        half = np.sqrt(np.maximum(disc.radius**2 - (s - beside) ** 2, 0.0))
        inside = half > 0.0
        if on_left:
            right[inside] = np.minimum(right, -(aside + half))[inside]
        else:
            left[inside] = np.minimum(left, aside - half)[inside]
    return left, right


def passing(reference: Reference, disc: Disc) -> tuple[float, float, bool]:
    """Return arc length and offset of an obstacle's middle [m], and whether it is passed on its left."""
    path, middle = reference.path, np.array([disc.x, disc.y])
    assert path is not None
    beside = float(path.project(middle))
    aside = float(offset(path, middle, beside))
    on_left = aside < 0.0
    if abs(aside) < disc.radius and disc.radius - abs(aside) > reference.corridor:
        on_left = not on_left  # too narrow on the shorter way; it may be so on the other
    return beside, aside, on_left


def turn_rate(reference: Reference, t: float, progress: float, reach: Reach = anywhere) -> float:
    """Return the turn rate that a reference asks for at time t [s], `progress` [m] along its path, in rad/s."""
    if reference.path is not None:
        return float(reference.path.curvature(progress)) * float(speed_at(reference, t, progress, reach))
    if reference.heading is not None:
        return (float(reference.heading(t + MOMENT)) - float(reference.heading(t))) / MOMENT
    return 0.0


def turn_of_path(reference: Reference, t: float, place: FloatArray) -> float:
    """Return the turn rate of the path at its point nearest to a place (2,) [m], in rad/s; 0 without a path."""
    if reference.path is None or not np.isfinite(place).all():
        return 0.0
    return turn_rate(reference, t, float(reference.path.project(place)))


def _on_turn(heading: FloatArray, first: float, azimuth: float) -> FloatArray:
    """Return headings counted on or back by whole turns, so that `first` comes nearest to an azimuth [rad]."""
    turns = float(np.round((first - azimuth) / (2.0 * np.pi)))
    return np.asarray(heading - 2.0 * np.pi * turns)
