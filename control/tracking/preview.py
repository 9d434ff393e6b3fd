"""Preview: the reference ahead of the worm, within the worm's greatest speed, and up to the end of the path.

The speed at arc length s of the path and time t is the least of

    |V_ref(t)|,   V_reach(kappa(s)),   (length - s)/T, backwards s/T, if the path ends                          (P1)

V_reach is the greatest speed at which the worm can turn as the path does. With the last speed, the distance to the end
falls as exp(-t/T). Around obstacles the worm follows a detour, `control.tracking.detour`. The corridor bounds the
offset of the worm's middle from the detour, and the obstacles on either side bound the offset of both ends of the body.
These bounds are fixed before the planning, so that the optimisation is not stuck between two ways around.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from control.tracking.detour import Detour
from control.tracking.paths import lengthening
from control.tracking.references import Reference
from worm3d.values.arrays import FloatArray

APPROACH = 2.0
"""Time T in which the distance to the end of a path falls to 37 % [waves]: the speed lags behind by one wave."""
TURNS_IN = 0.3
"""Distance for averaging the curvature of a path [body lengths], over which a worm turns by a right angle at best."""
AWAY = 1.3
"""Angle between a worm and its path above which the worm turns round before following the path [rad]."""

Reach = Callable[[FloatArray], FloatArray]
"""Function of curvatures (...) [1/m] that returns the greatest speeds along such curves (...) [m/s]."""


@dataclass(frozen=True, eq=False)
class Preview:
    """Demands of a reference at K instants."""

    speed: FloatArray
    """Speed forward [m/s], shape (K,)."""
    point: FloatArray
    """Points of the path [m], shape (K, 2); zeros without a path."""
    heading: FloatArray
    """Heading of the path or reference, on the same turn as the worm's heading [rad], shape (K,); zeros without one."""
    follows: bool
    """Whether there is a path."""
    heads: bool
    """Whether there is a heading."""
    progress: float
    """Arc length of the path's point nearest to the worm [m]; 0 without a path."""
    left: FloatArray
    """Greatest allowed offset to the left of the path [m], shape (K,); infinite without a bound."""
    right: FloatArray
    """Greatest offset to the right, as a positive number [m], shape (K,)."""
    room_left: FloatArray
    """Greatest allowed offset to the left of both ends of the body, shape (K,) [m]."""
    room_right: FloatArray
    """Greatest offset of both ends to the right, as a positive number [m], shape (K,)."""
    way: FloatArray
    """Way forward in each step [body lengths], shape (K,)."""
    walled: bool = False
    """Whether walls keep the worm to its path."""

    @property
    def ways(self) -> FloatArray:
        """-1 for motion backwards, else 1; while the worm has to stand, the value before, shape (K,)."""
        moving = np.where(self.speed != 0.0, np.arange(len(self.speed)), 0)
        return np.where(np.signbit(self.speed[np.maximum.accumulate(moving)]), -1.0, 1.0)


class Ability(NamedTuple):
    """Abilities of a worm, which limit the demands."""

    reach: Reach
    length: float
    """Length of the body [m]."""
    wave: float
    """Period of the usual wave [s]."""


ANY = Ability(lambda curvature: np.full(np.shape(curvature), np.inf), 1.0, 1.25)
"""Ability to go at any speed, of a worm with the length and the wave of the default worm."""


def speed_at(reference: Reference, t: ArrayLike, s: ArrayLike, able: Ability = ANY) -> FloatArray:
    """Return the speeds [m/s] of a reference at times [s] and arc lengths [m] of one shape, (P1).

    In a pipe that rises the speeds are along the pipe, and less as seen from above.
    """
    along, turning = np.asarray(s, dtype=float), _turning(reference, s, able)
    begin, end = _ending(reference, along, able.wave)
    asked = np.asarray(reference.speed(t), dtype=float)
    speed = np.asarray(np.clip(asked, -np.minimum(turning, begin), np.minimum(turning, end)))
    return np.asarray(speed / lengthening(reference.path, along))


def _turning(reference: Reference, s: ArrayLike, able: Ability) -> FloatArray:
    """Return the greatest speeds at which the worm can follow the path, at arc lengths of any shape [m/s]."""
    s, path, way = np.asarray(s, dtype=float), reference.path, TURNS_IN * able.length
    if path is None:
        return able.reach(np.zeros(s.shape))
    return able.reach((path.heading(s + way / 2.0) - path.heading(s - way / 2.0)) / way)


def _ending(reference: Reference, s: FloatArray, wave: float) -> tuple[FloatArray, FloatArray]:
    """Return the greatest speeds backward and forward that still stop at the ends, at arc lengths (...) [m/s]."""
    if reference.path is None or not reference.ends:
        return np.full(s.shape, np.inf), np.full(s.shape, np.inf)
    T = APPROACH * wave
    return np.maximum(s, 0.0) / T, np.maximum(reference.path.length - s, 0.0) / T


def _advance(reference: Reference, times: FloatArray, step: float, progress: float, able: Ability) -> FloatArray:
    """Return arc lengths [m] after each step, at the speeds (P1) from a progress [m] on."""
    asked = np.asarray(reference.speed(times), dtype=float)
    path, straight = reference.path, float(able.reach(np.zeros(1))[0])
    asked = np.clip(asked, -straight, straight)
    back, forth = step * np.minimum(asked, 0.0).sum(), step * np.maximum(asked, 0.0).sum()
    places = np.linspace(progress + float(back), progress + float(forth), 65)
    turning, longer = _turning(reference, places, able), lengthening(path, places)
    s, along = progress, []
    for speed in asked.tolist():
        limit, ending = float(np.interp(s, places, turning)), _ending(reference, np.array(s), able.wave)
        begin, end = (min(limit, float(each)) for each in ending)
        s += step * min(max(speed, -begin), end) / float(np.interp(s, places, longer))
        along.append(s)
    return np.array(along)


def look_ahead(
    reference: Reference,
    begin: float,
    step: float,
    steps: int,
    place: FloatArray,
    azimuth: float,
    near: float | None,
    able: Ability = ANY,
) -> Preview:
    """Return the demands at the ends of the steps of a horizon that begins at a time [s].

    The point of the path advances at the speed (P1) from the worm's place, whatever the worm does. The worm is at a
    place (2,) [m] with an azimuth [rad]; the search for the worm's progress begins near the previous progress [m].
    """
    ends = begin + step * np.arange(1, steps + 1, dtype=np.float64)
    free = np.full(steps, np.inf)
    path, heading = reference.path, reference.heading
    if path is None:
        asked = np.zeros(steps)
        if heading is not None:
            asked = np.asarray(heading(ends), dtype=float)
            asked = _on_turn(asked, float(asked[0]), azimuth)
        speed = speed_at(reference, ends, asked, able)
        way = speed * step / able.length
        return Preview(speed, np.zeros((steps, 2)), asked, False, heading is not None, 0.0, free, free, free, free, way)
    progress = float(path.project(place, near))
    along = _advance(reference, ends - step / 2.0, step, progress, able)
    point, turned = path.point(along), path.heading(along)
    turned = _on_turn(turned, float(path.heading(progress)), azimuth)
    speed, follows = speed_at(reference, ends, along, able), bool(abs(turned[0] - azimuth) < AWAY)
    way = speed * step / able.length
    left, right, room_left, room_right = bounds(reference, along)
    limits = left, right, room_left, room_right
    return Preview(speed, point, turned, follows, True, progress, *limits, way, reference.walled)


def bounds(reference: Reference, s: FloatArray) -> FloatArray:
    """Return the bounds to the left and right for the middle, then for the ends, at arc lengths (K,), (4, K) [m]."""
    if isinstance(reference.path, Detour):
        return reference.path.bounds_at(s)
    return np.repeat([reference.corridor, reference.corridor, np.inf, np.inf], len(s)).reshape(4, -1)


def turn_rate(reference: Reference, t: float, progress: float, able: Ability = ANY) -> float:
    """Return the turn rate of a reference at time t [s], `progress` [m] along the path, in rad/s."""
    if reference.path is not None:
        return float(reference.path.curvature(progress)) * float(speed_at(reference, t, progress, able))
    if reference.heading is not None:
        return (float(reference.heading(t + 0.05)) - float(reference.heading(t))) / 0.05
    return 0.0


def turn_of_path(reference: Reference, t: float, place: FloatArray) -> float:
    """Return the turn rate of the path at the point nearest to a place (2,) [m], in rad/s; 0 without a path."""
    if reference.path is None or not np.isfinite(place).all():
        return 0.0
    return turn_rate(reference, t, float(reference.path.project(place)))


def _on_turn(heading: FloatArray, first: float, azimuth: float) -> FloatArray:
    """Return headings shifted by whole turns, so that `first` is nearest to an azimuth [rad]."""
    turns = float(np.round((first - azimuth) / (2.0 * np.pi)))
    return np.asarray(heading - 2.0 * np.pi * turns)
