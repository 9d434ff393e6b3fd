"""Feed-forward: the wave that has a requested speed and turn rate according to the identified map.

Both amplitude and frequency determine the speed. At most speeds the frequency has a preferred value, and the amplitude
sets the speed. If the amplitude is at a limit, the frequency sets the speed instead. These waves form a line through
the map, along which the speed increases from almost zero.
"""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from control.estimation.reduced import ReducedInput
from control.identification.identified import SteeringMap
from control.identification.surrogate import MIN_WAVE_FREQUENCY
from worm3d.values.arrays import FloatArray

PREFERRED = 0.8
"""Preferred frequency [Hz]. At this frequency the default worm covers the largest range of speeds. For maps that do not
contain this frequency, the middle of their range is used."""
POINTS_PER_PART = 33
"""Number of points on each of the straight parts of the line of waves."""
SPARE = 0.1
"""Share of the greatest turn rate that is kept in reserve for corrections on sharp paths."""


class FeedForward:
    """Inverse of the identified map of one mechanism, valid in the identified `ranges`.

    Attributes
    ----------
    found : SteeringMap
        The map.
    frequency, wave : float
        Preferred frequency [Hz], and the period of a wave with this frequency [s].
    backward : bool
        Whether the worm can crawl backwards, with the same wave in the opposite direction.
    slowest, fastest : float
        Speed of the slowest wave and of the fastest wave [m/s]. At lower requested speeds than `slowest` the worm
        stands.
    least_divisor : float
        Smallest speed that is used as a divisor [m/s]: half of the smallest identified speed.
    """

    def __init__(self, found: SteeringMap, length: float, backward: bool = False) -> None:
        low, high = found.ranges.frequency
        self.frequency = PREFERRED if low <= PREFERRED <= high else (low + high) / 2.0
        self.wave = 1.0 / self.frequency
        self.found, self.ranges, self.backward = found, found.ranges, backward
        (least, greatest), preferred = found.ranges.amplitude, self.frequency
        self._amplitudes = _through(least, least, least, greatest, greatest)
        self._frequencies = _through(MIN_WAVE_FREQUENCY, low, preferred, preferred, high)
        self._steerings = np.linspace(0.0, found.ranges.steering, 97)  # close, since weak steering hardly turns a worm
        wave = ca.SX.sym("amplitude"), ca.SX.sym("frequency"), ca.SX.sym("steering")
        speed, rate = length * found.speed(*wave), found.turn_rate(*wave)
        self._speed = ca.Function("speed", [*wave], ca.cse([speed])).map(len(self._amplitudes))
        self._turn_rate = ca.Function("turn_rate", [*wave], ca.cse([rate])).map(len(self._steerings))
        self._straight = self._speeds(0.0)
        self.slowest, self.fastest = float(self._straight[0]), float(self._straight[-1])
        self.least_divisor = 0.5 * float(self._straight[POINTS_PER_PART])
        along = zip(self._amplitudes, self._frequencies, strict=True)
        rates = np.array([self._turn_rates(*place) for place in along])
        self._line = np.array([self._speeds(steering) for steering in self._steerings[::4]])
        self._rates = np.maximum.accumulate(rates, axis=1)[:, ::4]
        sharpest = (1.0 - SPARE) * rates.max(axis=1) / self._straight
        self._sharpest = np.maximum.accumulate(sharpest[::-1])[::-1]  # at a speed or at a greater one
        # From this point on a higher speed costs curvature; slower waves turn no sharper.
        self._rises = max(int(np.argmax(self._sharpest < self._sharpest[0])) - 1, 0)

    def __call__(self, speed: float, turn_rate: float) -> ReducedInput:
        """Return the wave that has a steady speed [m/s] and turn rate [rad/s], or the nearest possible wave.

        A negative speed is backwards.
        """
        steering = 0.0  # its magnitude: left and right are mirror images
        for _ in range(3):  # steering and speed change each other a little
            amplitude, frequency = self._on_line(abs(speed), self._speeds(steering))
            # The small slope makes zero steering the only one without a turn.
            rising = np.maximum.accumulate(self._turn_rates(amplitude, frequency)) + 1e-6 * self._steerings
            steering = float(np.interp(abs(turn_rate), rising, self._steerings))
        way = -1.0 if speed < 0.0 else 1.0
        return ReducedInput(way * amplitude, frequency, float(np.copysign(steering, turn_rate)))

    def goes(self, speed: float) -> bool:
        """Return whether the worm can crawl at a speed [m/s].

        It may be too low, or backward motion may be impossible.
        """
        return abs(speed) >= self.slowest and (speed > 0.0 or self.backward)

    def sharpest(self, speed: float) -> float:
        """Return the greatest turn rate of the map at a speed [rad/s]."""
        return float(self._turn_rates(*self._on_line(speed, self._straight)).max())

    def frequencies(self, speeds: FloatArray, curvatures: ArrayLike = 0.0) -> FloatArray:
        """Return the suitable frequencies [Hz] for speeds [m/s] on a path with given curvatures [1/m], shape (K,) each.

        A turning wave covers more distance than a straight wave of the same frequency, so that a slower wave suffices.
        """
        size = np.abs(speeds)
        wanted = np.abs(curvatures) * size
        frequencies = np.array([np.interp(size, speeds, self._frequencies) for speeds in self._line])
        rates = np.array([np.interp(size, *each) for each in zip(self._line, self._rates.T, strict=True)])
        return np.array([np.interp(w, rates[:, k], frequencies[:, k]) for k, w in enumerate(wanted)])

    def reach(self, curvature: ArrayLike) -> FloatArray:
        """Return the greatest speeds on paths of given curvatures, according to the map [m/s].

        `curvature` may have any shape [1/m]. For paths that are too sharp to follow, this is the greatest speed of the
        sharpest possible turn.
        """
        begin = self._rises
        return np.asarray(np.interp(np.abs(curvature), self._sharpest[begin:][::-1], self._straight[begin:][::-1]))

    def _on_line(self, speed: float, speeds: FloatArray) -> tuple[float, float]:
        """Return amplitude and frequency of the wave with a given speed.

        `speeds` are the speeds along the line [m/s].
        """
        return float(np.interp(speed, speeds, self._amplitudes)), float(np.interp(speed, speeds, self._frequencies))

    def _turn_rates(self, amplitude: float, frequency: float) -> FloatArray:
        """Return the turn rate at each steering [rad/s]."""
        return np.array(self._turn_rate(amplitude, frequency, self._steerings[None])).ravel()

    def _speeds(self, steering: float) -> FloatArray:
        """Return the speeds along the line [m/s].

        They are made to increase everywhere, since the fit of the map may decrease at its edges.
        """
        speeds = np.array(self._speed(self._amplitudes[None], self._frequencies[None], steering)).ravel()
        return np.maximum.accumulate(speeds)


def _through(*ends: float) -> FloatArray:
    """Return points along a line that consists of several parts, from the ends and corners of the line."""
    return np.concatenate([np.linspace(*part, POINTS_PER_PART) for part in pairwise(ends)])
