"""Conversion of an agent's action into the wave for the next control period.

course: V_cmd = V_ref (1 + TRIM a_0),  w_cmd = kappa V_ref + TURN a_1 V_ref / L, and the wave of the identified map
        with this speed and turn rate. The agent only learns feedback, like the line-of-sight baseline, (B1) to (B3)
wave:   amplitude, frequency and steering, each over its identified range. Apart from these ranges, the map is not used

a_0 and a_1 are the numbers of the action, kappa is the curvature of the path, and L the body length.
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
"""Greatest relative change of the reference speed by an agent. On a slope of 3 degrees a worm needs 0.2."""
TURN = 3.0
"""Greatest curvature that an agent can add to the curvature of the path [1/body length]. Line-of-sight steering needs 2
at a heading error of 0.1 rad."""


class Act:
    """Base class of the conversions. An action consists of `size` numbers in [-1, 1].

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
        """Return the wave for an action, shape (A,).

        `seen` is the observation that led to the action, see `control.learned.senses`.
        """


class Course(Act):
    """The action sets speed and turn rate, relative to the reference."""

    size = 2

    def __call__(self, action: FloatArray, seen: FloatArray) -> GaitParameters:
        """Return the wave; see `Act`."""
        asked = float(seen[SPEED]) * self.length / FAST
        turn_rate = (float(seen[CURVATURE]) + TURN * float(action[1])) * asked / self.length
        amplitude, frequency, steering = self.feed_forward(asked * (1.0 + TRIM * float(action[0])), turn_rate)
        return GaitParameters(float(amplitude), float(frequency)).steered(self.mechanism, float(steering))


class Wave(Act):
    """The action sets amplitude, frequency and steering."""

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
"""Conversions of actions by name."""
