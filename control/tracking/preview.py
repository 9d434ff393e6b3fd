"""Preview of the reference ahead of the worm.

The speeds of the preview are limited to speeds that the worm can reach and that stop it at the end of the path. The
speed at arc length s of the path and time t is the smallest of

    |V_ref(t)|,   V_reach(kappa(s)),   (length - s)/T, backwards s/T, if the path ends                          (P1)

V_reach is the greatest speed of the worm in turns as sharp as the path. With the last of these speeds, the distance
from the end decreases as exp(-t/T).

Around obstacles the worm follows a detour (`control.tracking.detour`). The corridor bounds the offset of the worm's
middle from the detour, and the obstacles bound the offset of both ends of the body. These bounds are fixed before the
planning. Otherwise the optimisation could get stuck between the two ways around an obstacle.
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
from worm3d.values.documented import with_fields

APPROACH = 2.0
"""The distance from the end of a path decreases to 37 % in this time T [waves]. T is longer than the lag of the speed,
which is one wave."""
TURNS_IN = 0.3
"""Distance over which the curvature of a path is averaged [body lengths]. A worm needs at least this distance to turn
by a right angle."""
AWAY = 1.3
"""Angle between the worm and its path above which the worm first turns round without following the path [rad]."""

Reach = Callable[[FloatArray], FloatArray]
"""Function that returns the greatest speeds on curves of given curvatures, of the same shape [1/m] -> [m/s]."""


@with_fields
@dataclass(frozen=True, eq=False)
class Preview:
    """Requested motion at K instants."""

    speed: FloatArray
    """Forward speed [m/s], shape (K,)."""
    point: FloatArray
    """Points of the path [m], shape (K, 2). Zeros without a path."""
    heading: FloatArray
    """Heading of the path or of the reference [rad], shape (K,). Zeros without either. Whole turns are added, so that
    the first value is nearest to the worm's heading."""
    follows: bool
    """Whether there is a path, and the worm faces along it (see `AWAY`)."""
    heads: bool
    """Whether there is a path or a requested heading."""
    progress: float
    """Arc length of the point of the path nearest to the worm [m]. 0 without a path."""
    left: FloatArray
    """Greatest allowed offset to the left of the path [m], shape (K,). Infinite without a bound."""
    right: FloatArray
    """Greatest allowed offset to the right of the path, a positive number [m], shape (K,)."""
    room_left: FloatArray
    """Greatest allowed offset of both ends of the body to the left [m], shape (K,)."""
    room_right: FloatArray
    """Greatest allowed offset of both ends of the body to the right, a positive number [m], shape (K,)."""
    way: FloatArray
    """Distance covered in each step [body lengths], shape (K,). Negative backwards."""
    walled: bool = False
    """Whether walls keep the worm on its path."""

    @property
    def ways(self) -> FloatArray:
        """1 for forward and -1 for backward motion, shape (K,).

        While the worm has to stand, the previous value is kept.
        """
        moving = np.where(self.speed != 0.0, np.arange(len(self.speed)), 0)
        return np.where(np.signbit(self.speed[np.maximum.accumulate(moving)]), -1.0, 1.0)


class Ability(NamedTuple):
    """Properties of a worm that limit the requested motion."""

    reach: Reach
    length: float
    """Length of the body [m]."""
    wave: float
    """Period of the wave at the preferred frequency [s]."""


ANY = Ability(lambda curvature: np.full(np.shape(curvature), np.inf), 1.0, 1.25)
"""Ability to reach any speed, with the length and the wave period of the default worm."""


def speed_at(reference: Reference, t: ArrayLike, s: ArrayLike, able: Ability = ANY) -> FloatArray:
    """Return the speeds (P1) of a reference at times `t` [s] and arc lengths `s` [m] of the same shape [m/s].

    In a rising pipe, the reference speed is along the pipe. The returned speed is seen from above, and smaller.
    """
    along, turning = np.asarray(s, dtype=float), _turning(reference, s, able)
    begin, end = _ending(reference, along, able.wave)
    asked = np.asarray(reference.speed(t), dtype=float)
    speed = np.asarray(np.clip(asked, -np.minimum(turning, begin), np.minimum(turning, end)))
    return np.asarray(speed / lengthening(reference.path, along))


def _turning(reference: Reference, s: ArrayLike, able: Ability) -> FloatArray:
    """Return the greatest speeds that still let the worm follow the path, at arc lengths `s` of any shape [m/s]."""
    s, path, way = np.asarray(s, dtype=float), reference.path, TURNS_IN * able.length
    if path is None:
        return able.reach(np.zeros(s.shape))
    ahead, behind = path.heading(np.stack([s + way / 2.0, s - way / 2.0]))
    return able.reach((ahead - behind) / way)


def _ending(reference: Reference, s: FloatArray, wave: float) -> tuple[FloatArray, FloatArray]:
    """Return the greatest backward and forward speeds that let the worm stop at the ends of the path [m/s]."""
    if reference.path is None or not reference.ends:
        return np.full(s.shape, np.inf), np.full(s.shape, np.inf)
    T = APPROACH * wave
    return np.maximum(s, 0.0) / T, np.maximum(reference.path.length - s, 0.0) / T


def _advance(reference: Reference, times: FloatArray, step: float, progress: float, able: Ability) -> FloatArray:
    """Return the arc lengths after each step, if the worm moves with the speeds (P1) from `progress` on [m]."""
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
    """Return the requested motion at the ends of the steps of a horizon.

    The point of the path advances with the speed (P1) from the worm's present position, whatever the worm does.

    Parameters
    ----------
    reference : Reference
    begin : float
        Start of the horizon [s].
    step, steps
        Duration [s] and number of the steps.
    place : ndarray, shape (2,)
        Position of the worm [m].
    azimuth : float
        Heading of the worm [rad].
    near : float, optional
        Previous progress on the path, near which the present progress is searched [m].
    able : Ability
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
    """Return the bounds of the offset at arc lengths `s`, shape (4, K) for `s` of shape (K,) [m].

    The rows are the bounds to the left and right for the middle, then for the ends of the body.
    """
    if isinstance(reference.path, Detour):
        return reference.path.bounds_at(s)
    return np.repeat([reference.corridor, reference.corridor, np.inf, np.inf], len(s)).reshape(4, -1)


def turn_rate(reference: Reference, t: float, progress: float, able: Ability = ANY) -> float:
    """Return the turn rate of a reference at time t [s] and the arc length `progress` [m], in rad/s."""
    if reference.path is not None:
        return float(reference.path.curvature(progress)) * float(speed_at(reference, t, progress, able))
    if reference.heading is not None:
        return (float(reference.heading(t + 0.05)) - float(reference.heading(t))) / 0.05
    return 0.0


def turn_of_path(reference: Reference, t: float, place: FloatArray) -> float:
    """Return the turn rate of the path at its point nearest to a place (2,) [m], in rad/s. It is 0 without a path."""
    if reference.path is None or not np.isfinite(place).all():
        return 0.0
    return turn_rate(reference, t, float(reference.path.project(place)))


def _on_turn(heading: FloatArray, first: float, azimuth: float) -> FloatArray:
    """Return headings shifted by whole turns, so that `first` is shifted as near as possible to an azimuth [rad]."""
    turns = float(np.round((first - azimuth) / (2.0 * np.pi)))
    return np.asarray(heading - 2.0 * np.pi * turns)
