"""Meaning of an agent's action: the wave for the next control period.

course: V_cmd = V_ref (1 + TRIM a_0),  w_cmd = kappa V_ref + TURN a_1 V_ref / L, and the wave of the identified map
        with this speed and turn rate: an agent learns feedback only, as the line-of-sight baseline does, (B1) to (B3)
wave:   amplitude, frequency and steering, each over its identified range; nothing else of the map is used
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from control.gaits.steering import GaitParameters, Mechanism
from control.identification.identified import SteeringMap
from control.learned.senses import CURVATURE, FAST, SPEED
from control.planning.feed_forward import FeedForward
from worm3d.values.arrays import FloatArray

TRIM = 0.5
"""Greatest relative change of the reference speed by an agent: a worm on a slope of 3 degrees needs 0.2."""
TURN = 3.0
"""Greatest curvature that an agent adds to the path's [1/body length]; line-of-sight steering needs 2 at 0.1 rad."""


class Act:
    """Meaning of an action of `size` numbers in [-1, 1].

    Parameters
    ----------
    found : SteeringMap
        Identified map of the mechanism that steers.
    mechanism : str
    length : float
        Body length [m].
    """

    size: ClassVar[int]

    def __init__(self, found: SteeringMap, mechanism: Mechanism, length: float) -> None:
        self.found, self.mechanism, self.length = found, mechanism, length
        self.feed_forward = FeedForward(found, length)

    @abstractmethod
    def __call__(self, action: FloatArray, seen: FloatArray) -> GaitParameters:
        """Return the wave of an action (A,), decided from the observation `seen`, `control.learned.senses`."""


class Course(Act):
    """Speed and turn rate, relative to the reference."""

    size = 2

    def __call__(self, action: FloatArray, seen: FloatArray) -> GaitParameters:
        """Return the wave; see `Act`."""
        asked = float(seen[SPEED]) * self.length / FAST
        turn_rate = (float(seen[CURVATURE]) + TURN * float(action[1])) * asked / self.length
        amplitude, frequency, steering = self.feed_forward(asked * (1.0 + TRIM * float(action[0])), turn_rate)
        return GaitParameters(float(amplitude), float(frequency)).steered(self.mechanism, float(steering))


class Wave(Act):
    """Amplitude, frequency and steering."""

    size = 3

    def __call__(self, action: FloatArray, seen: FloatArray) -> GaitParameters:
        """Return the wave; see `Act`."""
        ranges = self.found.ranges
        amplitude, frequency = (
            low + 0.5 * (1.0 + float(a)) * (high - low)
            for a, (low, high) in zip(action, (ranges.amplitude, ranges.frequency), strict=False)
        )
        return GaitParameters(amplitude, frequency).steered(self.mechanism, float(action[2]) * ranges.steering)


ACTS: dict[str, type[Act]] = {"course": Course, "wave": Wave}
"""Meanings of actions by name."""
