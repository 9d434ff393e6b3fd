"""A gait for pipes: two anchors that press the wall in turn, and a body between them that extends and shortens.

A contracted segment is wide and presses the wall all round; an extended one is thin and slides. One period has six
parts of equal length:

    0  front lets go   1  body extends, front moves on   2  front anchors
    3  rear lets go    4  body shortens, rear moves up   5  rear anchors

At least one anchor holds at any time, and the worm begins with all segments contracted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np

from control.gaits.patterns import Direction, Gait
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray

PARTS = 6
REAR, BODY, FRONT = (3, 5), (1, 4), (0, 2)
"""Part of the period in which each group lets go (extends), and in which it contracts again."""


@dataclass(frozen=True, kw_only=True)
class TwoAnchor(Gait, name="two_anchor"):
    """Two anchors in turn, as in inchworms and burrowing earthworms; it climbs pipes of any tilt.

    The command has no jumps: each change takes a part of the period, with the speed of a cosine.

    Attributes
    ----------
    amplitude : float
        Contraction of an anchored segment: more than the pipe's wall allows, so that it presses.
    extension : float
        Activation of an extended segment, at most 0: -0.5 lengthens it by half the amplitude.
    period : float
        Of the whole sequence [s].
    anchors : int
        Segments of each anchor; those between them are the body.
    direction : str
        "retrograde": the front is the head's end, and the worm moves that way; "direct": the tail's end.
    """

    extension: float = -0.5
    period: float = 6.0
    anchors: int = 1
    direction: Direction = "retrograde"

    def __post_init__(self) -> None:
        super().__post_init__()
        arguments.number("extension", self.extension, ge=-1.0, le=0.0, allowed="a number in [-1, 0]")
        arguments.number("period", self.period, "s", gt=0.0)
        arguments.whole("anchors", self.anchors)
        arguments.choice("direction", self.direction, get_args(Direction))

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
