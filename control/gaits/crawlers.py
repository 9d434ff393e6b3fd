"""Gaits of crawlers that make no wave: two anchors in turn, and breathing in unison.

`TwoAnchor`, for pipes: two anchors press the wall in turn, and a body between them extends and shortens. A contracted
segment is wide and presses the wall all round; an extended one is thin and slides. One period has six parts of equal
length:

    0  front lets go   1  body extends, front moves on   2  front anchors
    3  rear lets go    4  body shortens, rear moves up   5  rear anchors

At least one anchor holds at any time, and the worm begins with all segments contracted.

`Breathing`, for a single actuator: all segments contract and lengthen again in unison. It crawls where friction is
directional. A slow, uniform contraction moves the rear forward and the front backward, against the coefficients f and
b, about the place x (from the tail, in body lengths) at which x f = (1 - x) b; lengthening moves them about the place
at which x b = (1 - x) f. In a period with the contraction c the centre of mass of a body of length L moves by

    d = c L (b - f)/(b + f)                                                                                   (GB1)

(Gidoni, Noselli, DeSimone: Crawling on directional surfaces, International Journal of Non-Linear Mechanics 61, 2014,
65-73, "breathing-like" shape changes).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from control.gaits.patterns import Direction, Gait
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter

PARTS = 6
REAR, BODY, FRONT = (3, 5), (1, 4), (0, 2)
"""Part of the period in which each group lets go (extends), and in which it contracts again."""


@documented
@dataclass(frozen=True, kw_only=True)
class TwoAnchor(Gait, name="two_anchor"):
    """Two anchors in turn, as in inchworms and burrowing earthworms; it climbs pipes of any tilt.

    The command has no jumps: each change takes a part of the period, with the speed of a cosine. The amplitude is
    more than the pipe's wall allows, so that anchored segments press it.
    """

    extension: float = parameter(
        -0.5,
        meaning="activation of an extended segment, -0.5 lengthens it by half the amplitude",
        ge=-1,
        le=0,
        allowed="a number in [-1, 0]",
    )
    period: float = parameter(6.0, meaning="duration of the whole sequence", unit="s", gt=0)
    anchors: int = parameter(1, meaning="segments of each anchor; those between them are the body", ge=1)
    direction: Direction = parameter(
        "retrograde", meaning="retrograde: the front is the head's end, and the worm moves that way; direct: the tail's"
    )

    @property
    def lengthens(self) -> bool:
        """Whether the activation falls below 0 at some time."""
        return self.extension < 0.0

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], shape (K, segments), in [extension, 1].

        Raises
        ------
        ValueError
            The worm has no segment between the anchors.
        """
        body = segments - 2 * self.anchors
        if body < 1:
            raise ValueError(
                f"anchors: got {self.anchors}, must leave a segment of the worm's {segments} between the two anchors"
            )
        part = np.mod(times / self.period, 1.0) * PARTS
        order = (REAR, BODY, FRONT) if self.direction == "retrograde" else (FRONT, BODY, REAR)
        groups = [self._group(part, *when) for when in order]
        return np.repeat(np.array(groups).T, [self.anchors, body, self.anchors], axis=1)

    def _group(self, part: FloatArray, release: int, anchor: int) -> FloatArray:
        """Return the activation of a group, 1 until it lets go and from when it has contracted again, shape (K,)."""
        extended = _change(part - release) - _change(part - anchor)
        activation: FloatArray = 1.0 - (1.0 - self.extension) * extended
        return activation


def _change(part: FloatArray) -> FloatArray:
    """Return 0 before 0, 1 after 1, and half a cosine wave between."""
    change: FloatArray = (1.0 - np.cos(np.pi * np.clip(part, 0.0, 1.0))) / 2.0
    return change


@documented
@dataclass(frozen=True, kw_only=True)
class Breathing(Gait, name="breathing"):
    """Contraction and lengthening of all segments in unison, (GB1), each half a cosine wave."""

    period: float = parameter(2.0, meaning="duration of a contraction and the lengthening after it", unit="s", gt=0)
    contracting: float = parameter(0.5, meaning="share of the period in which the body contracts", gt=0, lt=1)

    @property
    def lengthens(self) -> bool:
        """Whether the activation falls below 0 at some time."""
        return False

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], shape (K, segments), in [0, 1]."""
        tau, share = np.mod(times / self.period, 1.0), self.contracting
        half_waves = np.where(tau < share, tau / share, 1.0 + (tau - share) / (1.0 - share))
        return np.tile((1.0 - np.cos(np.pi * half_waves))[:, None] / 2.0, (1, segments))
