"""Climbing with two anchors, at a pace that a controller sets, and with reflexes that limit the load on the walls.

Each segment has one apex that points outward to the left and one to the right. On open ground the worm leans to one
side or to none, so that at most one of the two bears a load. In a pipe that is as narrow as a contracted segment is
wide, both bear a load. A segment counts as enclosed if the load on each of these apexes exceeds a share of the
segment's weight (`control.gaits.reflexes.TOUCH`).

First, all segments contract, so that both anchors hold. Then the gait begins, and its phase follows psi' = pace /
period. At pace 0 the command is constant, so that an anchor keeps its hold.

Reflexes (`control.gaits.reflexes`) change the commands of the gait. By default there are two: segments that press hard
against the wall give way, and segments that should be wide but do not touch the wall contract further. With them the
worm climbs pipes of other radii, too. At pace 0 segments give way but do not recover. If two anchors gave way and
recovered in turn, the worm would continue to walk.
"""

from __future__ import annotations

import numpy as np

from control.gaits.anchoring import TwoAnchor
from control.gaits.feedback import Felt
from control.gaits.reflexes import GRAVITY, TOUCH, Reach, Reflex, ReflexMemory, WallLoad
from worm3d import Command, Worm
from worm3d.values.arrays import FloatArray

CLIMB = TwoAnchor(period=2.0, amplitude=0.2, extension=-0.5)
"""Gait of a climbing worm. It is the gait of the scene `pipe_vertical`, with two thirds of its period."""
REFLEXES: tuple[Reflex, ...] = (WallLoad(), Reach())
"""Default reflexes. Both use the channel "contact_load"."""
OUTWARD = [2, 5]
"""Columns of the outward apexes, left and right, in the contact loads of a segment."""
WEDGING = 0.6
"""Duration of the contraction of all segments before the gait begins, and of the transition between two gaits [s]. It
is six time constants of the default actuators."""


class Climb:
    """Climbing of one worm with two anchors.

    Parameters
    ----------
    worm : Worm
    gait : TwoAnchor
    reflexes : tuple of Reflex

    Attributes
    ----------
    phase : float
        Number of periods of the gait so far. It is 0 until all segments have contracted.
    """

    def __init__(self, worm: Worm, gait: TwoAnchor = CLIMB, reflexes: tuple[Reflex, ...] = REFLEXES) -> None:
        self._bound, self._stroke, self.period = gait.bind(worm), worm.stroke, gait.period
        self._worm, self._asked = worm, reflexes
        self._reflexes = [reflex.start(worm) for reflex in reflexes]
        self._giving_way: ReflexMemory | None = None
        self.phase, self._waited = 0.0, 0.0
        self._given: Command | None = None

    def step(self, t: float, dt: float, pace: float, felt: Felt) -> Command:
        """Return the command at time t [s], `dt` [s] after the previous call. A pace of 1 is the gait's own speed."""
        if pace == 0.0 and self._given is not None:
            return self._held(t, self._given, felt)
        if self._giving_way is not None:  # the reflexes must not take the time of standing for one step
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
    """Return the number of enclosed segments. `load` contains the loads of the apexes, shape (N, 6) [N]."""
    touch = TOUCH * worm.mass * GRAVITY / worm.segments
    return int((load[:, OUTWARD] > touch).all(axis=1).sum())
