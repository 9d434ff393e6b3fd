"""Gaits with two anchors, which are groups of segments at both ends of the body that hold the worm in turn.

A contracted segment is wide. In a pipe it presses against the wall all round. On level ground it carries the worm and
lifts the neighbouring segments. An extended segment is thin, and slides. The body between the anchors extends while the
rear anchor holds, and shortens while the front anchor holds. The period is divided into equal parts:

    two_anchor, for pipes                             inchworm, for level ground
    0  front lets go                                  0  rear anchors while the front lets go
    1  body extends, front moves on                   1  body extends, front moves on
    2  front anchors                                  2  front anchors while the rear lets go
    3  rear lets go                                   3  body shortens, rear moves up
    4  body shortens, rear moves up
    5  rear anchors

`two_anchor` begins with all segments contracted. An anchor lets go only while the other one holds, so that the worm can
climb pipes of any tilt. In `inchworm` one anchor contracts while the other lets go, which takes no extra time and keeps
the length of the worm constant. If no anchor slips, both gaits move the worm in each period by the change of the body's
length.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from control.gaits.gait import Direction, ExtendingGait, half_cosine
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter


@documented
@dataclass(frozen=True, kw_only=True)
class TwoAnchor(ExtendingGait, name="two_anchor"):
    """Two anchors that hold in turn, as in inchworms and burrowing earthworms. The gait climbs pipes of any tilt.

    The command has no jumps: each change takes one part of the period and follows half a cosine wave. The amplitude
    should be larger than the wall of the pipe allows, so that anchored segments press against the wall.
    """

    period: float = parameter(6.0, meaning="duration of the whole sequence", unit="s", gt=0)
    anchors: int = parameter(1, meaning="segments of each anchor; those between them are the body", ge=1)
    direction: Direction = parameter(
        "retrograde", meaning="retrograde: the front is the head's end, and the worm moves that way; direct: the tail's"
    )

    PARTS: ClassVar[int] = 6
    REAR: ClassVar[tuple[int, int]] = (3, 5)
    """The rear anchor lets go (extends) in the first of these parts of the period, and contracts in the second."""
    BODY: ClassVar[tuple[int, int]] = (1, 4)
    FRONT: ClassVar[tuple[int, int]] = (0, 2)

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
        part = np.mod(times / self.period, 1.0) * self.PARTS
        order = (self.REAR, self.BODY, self.FRONT)
        groups = [self._group(part, *when) for when in (order if self.direction == "retrograde" else order[::-1])]
        return np.repeat(np.array(groups).T, [self.anchors, body, self.anchors], axis=1)

    def _group(self, part: FloatArray, release: int, anchor: int) -> FloatArray:
        """Return the activation of a group of segments, shape (K,). It is 1 while the group is contracted."""
        extended = half_cosine(part - release) - half_cosine(part - anchor) + float(anchor < release)
        return self.activation_of(extended)


@documented
@dataclass(frozen=True, kw_only=True)
class Inchworm(TwoAnchor, name="inchworm"):
    """Two anchors that change over at the same time, for level ground."""

    PARTS: ClassVar[int] = 4
    REAR: ClassVar[tuple[int, int]] = (2, 0)
    BODY: ClassVar[tuple[int, int]] = (1, 3)
    FRONT: ClassVar[tuple[int, int]] = (0, 2)
