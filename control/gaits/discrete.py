"""Discrete gaits: segments are relaxed, contracted, or bent to a side, and the pattern moves along the body in steps.

The notation {n2, n3, n1 / nP} is from Zhan, Fang, Xu, Wang: Planar locomotion of earthworm-like metameric robots,
International Journal of Robotics Research, 2019. The segments have the states

    0 relaxed: long    1 contracted: short on both sides    2 bent to the left: the left side short    3 to the right

A worm of N segments has n1 segments in state 1, n2 in state 2, n3 in state 3, and n0 + nP in state 0. In each step the
whole pattern moves on by nP segments, and re-enters at the body's other end. The following interpretation relies only
on abstracts and second-hand descriptions of the paper:

* nP <= n1 + n2 + n3, so that a step moves the short segments by no more than their own number, and n0 >= 1, so that
  another segment is long besides the nP segments that become short. For N = 5 this leaves 25 gaits: 4 rectilinear
  (n2 = n3 = 0), 3 sidewinding (n2 = n3 > 0), 18 circular (n2 != n3), as the paper counts them.                   (DG1)
* The pattern reads, from tail to head, n2 times 2, n3 times 3, n0 + nP times 0, n1 times 1: {1, 0, 1 / 1} begins as
  20001 in five segments, {0, 0, 2 / 1} as 00011. The pattern moves towards the tail (retrograde), so that a segment
  contracts on both sides, then releases one side, then the other. The option `first` puts the bends to the right first,
  which gives every gait a mirror image.                                                                          (DG2)
* The pattern returns after N/gcd(N, nP) steps, a period.                                                         (DG3)

The names of the families follow the kinematics of anchors that never slip. On the default worm (amplitude 0.3, hinge
0.1 rad, N = 6, nP = 1) rectilinear gaits crawl straight. Circular gaits turn the worm by 35 to 125 degrees a period to
the side of the bends if two or more segments bend; with a single bent segment by 17 at most, and {1, 0, 0 / 1} hardly
at all. Sidewinding gaits still turn the worm by up to 9 degrees a period, since the feet slip; {2, 2, 0 / 1} with
`bend` 0.3 goes aside by 30 degrees and turns by less than 1 degree a period, for hinges from 0 to 0.15 rad.

Each step changes the activation of the sides along half a cosine, from the activations in one state to the activations
in the next: `relaxed` for a long side, 1 for a short side, `bend` for the short side of a bent segment. A bent segment
also turns the joint behind the segment, by `hinge` to the side of the bend, so that a worm can bend by unequal sides,
by hinges, or by both.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from control.gaits.gait import Body, Direction, Gait, direction_of_waves, half_cosine, longer
from worm3d import Commands
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter

RELAXED, CONTRACTED, BENT_LEFT, BENT_RIGHT = range(4)
"""States of a segment."""

TURN = np.array([0.0, 0.0, 1.0, -1.0])
"""Direction of the bend of a segment in each state: 1 to the left, -1 to the right."""


@documented
@dataclass(frozen=True, kw_only=True)
class Discrete(Gait, name="discrete"):
    """Gait {n2, n3, n1 / nP} of segments that are relaxed, contracted, or bent to a side, (DG1) to (DG3)."""

    period: float = parameter(6.0, meaning="duration after which the pattern is back", unit="s", gt=0)
    left_bends: int = parameter(0, meaning="number of segments bent to the left", ge=0, aka=("n2",))
    right_bends: int = parameter(0, meaning="number of segments bent to the right", ge=0, aka=("n3",))
    contracted: int = parameter(2, meaning="number of contracted segments", ge=0, aka=("n1",))
    shift: int = parameter(1, meaning="number of segments that the pattern moves in a step", ge=1, aka=("nP", "step"))
    first: Literal["left", "right"] = parameter("left", meaning="bends that come first, from the tail, in the pattern")
    moving: float = parameter(1.0, meaning="share of a step while segments change their state", gt=0, le=1)
    bend: float = parameter(1.0, meaning="activation of the shorter side of a bent segment", ge=0, le=1)
    relaxed: float = longer(0.0, "a relaxed side")
    direction: Direction = direction_of_waves()

    @property
    def lengthens(self) -> bool:
        """Whether the activation falls below 0 at some time."""
        return self.relaxed < 0.0

    def pattern(self, segments: int) -> NDArray[np.int64]:
        """Return the state of each segment at time 0, whole numbers, shape (segments,).

        Raises
        ------
        ValueError
            The worm has too few segments for the gait, or a step is longer than the pattern, (DG1).
        """
        short = self.left_bends + self.right_bends + self.contracted
        if not self.shift <= short < segments - self.shift:
            raise ValueError(
                f"shift: got {self.shift}, must be at most the number of contracted and bent segments ({short}) and "
                f"below that of relaxed ones ({max(0, segments - short)} of the worm's {segments}); these are set by "
                "left_bends, right_bends and contracted"
            )
        bends = [BENT_LEFT] * self.left_bends, [BENT_RIGHT] * self.right_bends
        leading = bends if self.first == "left" else bends[::-1]
        return np.array([*leading[0], *leading[1], *[RELAXED] * (segments - short), *[CONTRACTED] * self.contracted])

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of the sides of each segment at K times [s], shape (K, segments, 2).

        Raises
        ------
        ValueError
            See `pattern`.
        """
        low, bent = self.relaxed, self.bend
        return self._blended(np.array([[low, low], [1.0, 1.0], [bent, low], [low, bent]]), times, segments)

    def commands(self, times: FloatArray, worm: Body) -> Commands:
        """Return the commands to `worm` at K times [s]."""
        hinge = self.hinge * self._blended(TURN, times, worm.segments)
        return super().commands(times, worm)._replace(hinge=hinge[:, 1:])

    def _blended(self, of_state: FloatArray, times: FloatArray, segments: int) -> FloatArray:
        """Return a property of each segment at K times [s], shape (K, segments, ...).

        `of_state` contains the property for each of the four states, shape (4, ...).
        """
        pattern, steps = self.pattern(segments), segments // gcd(segments, self.shift)
        # Rounding errors must not move a time to another step.
        passed = times / self.period * steps + 1e-9
        step = np.floor(passed)
        way = self.shift if self.direction == "retrograde" else -self.shift
        moved = (way * step).astype(int)[:, None]
        now, then = (of_state[pattern[(np.arange(segments) + at) % segments]] for at in (moved, moved + way))
        done = half_cosine((passed - step) / self.moving).reshape(-1, *[1] * (now.ndim - 1))
        return np.asarray(now + done * (then - now))
