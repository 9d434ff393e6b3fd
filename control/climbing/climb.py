"""Climbing at run time: two anchors whose pace a controller may change, with reflexes that limit the load on the wall.

The outward apexes of a segment stand out to the left and to the right. On open ground at most one of the two apexes
bears a load, on the side on which the worm leans; in a pipe as narrow as a contracted segment is wide, both apexes bear
a load. A segment is enclosed if both apexes bear more than a share of the segment's weight
(`control.gaits.reflexes.TOUCH`).

All segments contract first, so that both anchors hold; then the gait begins. The phase accumulates, psi' = pace /
period; at pace 0 the command stays constant, and an anchor that holds goes on holding. Reflexes
(`control.gaits.reflexes`) change the commands of the gait: by default one reflex lets segments that press the wall hard
give way, and one lets segments that should be wide but touch nothing contract further, so that the worm climbs pipes of
other radii, too. At pace 0 segments give way and do not recover: two anchors that give way and recover in turn would
walk on.
"""

from __future__ import annotations

import numpy as np

from control.gaits.anchoring import TwoAnchor
from control.gaits.feedback import Felt
from control.gaits.reflexes import GRAVITY, TOUCH, Reach, Reflex, ReflexMemory, WallLoad
from worm3d import Command, Worm
from worm3d.values.arrays import FloatArray

CLIMB = TwoAnchor(period=2.0, amplitude=0.2, extension=-0.5)
"""Gait of a worm that climbs: the gait of the scene `pipe_vertical` in two thirds of the time."""
REFLEXES: tuple[Reflex, ...] = (WallLoad(), Reach())
"""Reflexes by default, which share the channel "contact_load"."""
OUTWARD = [2, 5]
"""Columns of the outward apexes, left and right, in the loads of a segment."""
WEDGING = 0.6
"""Time for the contraction of all segments before the gait begins, and for the transition from one gait to the other
[s]; six time constants of the default actuators."""


class Climb:
    """Two anchors in one run of a worm.

    Parameters
    ----------
    worm : Worm
    gait : TwoAnchor
    reflexes : tuple of Reflex

    Attributes
    ----------
    phase : float
        Number of periods of the gait so far; 0 until the worm is wedged.
    """

    def __init__(self, worm: Worm, gait: TwoAnchor = CLIMB, reflexes: tuple[Reflex, ...] = REFLEXES) -> None:
        self._bound, self._stroke, self.period = gait.bind(worm), worm.stroke, gait.period
        self._worm, self._asked = worm, reflexes
        self._reflexes = [reflex.start(worm) for reflex in reflexes]
        self._giving_way: ReflexMemory | None = None
        self.phase, self._waited = 0.0, 0.0
        self._given: Command | None = None

    def step(self, t: float, dt: float, pace: float, felt: Felt) -> Command:
        """Return the command at time t [s], `dt` after the last, at a pace of 1 for the gait's own period."""
        if pace == 0.0 and self._given is not None:
            return self._held(t, self._given, felt)
        if self._giving_way is not None:  # the time of standing is no step of the reflexes
            self._reflexes, self._giving_way = [reflex.start(self._worm) for reflex in self._asked], None
        wedging = min(dt, WEDGING - self._waited)
        self._waited += wedging
        self.phase += pace * (dt - wedging) / self.period
        given = self._bound(self.phase * self.period)
        contraction = given.contraction
        for reflex in self._reflexes:
            contraction = reflex.step(t, contraction, felt)
        self._given = Command(np.clip(contraction, *self._stroke), given.hinge, given.force)
        return self._given

    def _held(self, t: float, given: Command, felt: Felt) -> Command:
        if self._giving_way is None:
            self._giving_way = WallLoad(recovery=0.0).start(self._worm)
        contraction = self._giving_way.step(t, given.contraction, felt)
        return Command(np.clip(contraction, *self._stroke), given.hinge, given.force)


def enclosed(worm: Worm, load: FloatArray) -> int:
    """Return the number of enclosed segments, from the loads of the apexes, shape (N, 6) [N]."""
    touch = TOUCH * worm.mass * GRAVITY / worm.segments
    return int((load[:, OUTWARD] > touch).all(axis=1).sum())
