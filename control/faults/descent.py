"""Ways down that are too steep: a worm on bristles slides down them, whatever its wave.

A worm that lies along a descent of gradient g is held by friction up to g = mu_forward, its least coefficient, by
default 0.03, or 1.7 degrees; beyond it slides, at rest too, and ever faster. So it is stopped before. With the gradient
G of the ground that the estimator finds, its covariance C, and the direction n in which the path leads a little ahead
(or back, where the worm is to go backwards),

    descent = -G . n,   deviation = sqrt(n . C n)                                                             (DE1)

G is found from places that may have been wrong for a while, mu_forward belongs to the ground of the map, and a worm at
rest learns no more of both. So the stop ends after some seconds: the slope is forgotten, the worm tries the way again,
and where it has to stop again before it has got any further, it waits twice as long. A slope on which the worm has
rested without sliding holds it: only a steeper one stops it again.
"""

from __future__ import annotations

from math import atan, cos, degrees, inf, pi, sin, sqrt

import numpy as np

from control.estimation.estimate import SURE, Estimate
from control.faults.rules import Fault
from control.tracking.references import Reference
from worm3d import Worm
from worm3d.values.arrays import FloatArray

AHEAD = 0.3
"""How far ahead the path must not be too steep [body lengths]: what a worm goes in three waves."""
MARGIN = 0.8
"""Share of the friction up to which a worm crawls downhill: its wave moves feet, which do not hold meanwhile."""
KNOWN = 0.5
"""Standard deviation of the gradient, as a share of the friction, from which on it is known well enough to stop for: a
worm that stops learns no more of the ground."""
HOLDS = 0.01
"""Way that a worm which slides makes at least while it rests [body lengths]."""
WAITS, LONGEST_WAIT = 4.0, 64.0
"""Time after the first stop until the way is tried again, and the longest such time [s]."""


class Descent:
    """What a worm is told of ways down; `steepest` is the gradient that holds it, infinite where none matters."""

    def __init__(self, worm: Worm, reference: Reference, steepest: float = inf) -> None:
        self._length, self.reference, self.steepest = worm.length, reference, steepest
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._near: float | None = None
        self._wait, self._stopped, self._tried = WAITS, -inf, False
        self._place: FloatArray | None = None
        self._descent = self._held = 0.0

    def tries(self, t: float, place: FloatArray) -> bool:
        """Return whether a worm with a fault at a place (2,) [m] is to try its way again at time t [s]."""
        if self._place is None or np.hypot(*(place - self._place)) > AHEAD * self._length:
            self._wait, self._stopped, self._place = WAITS, t, place
        elif self._tried:
            self._wait, self._stopped, self._place = min(2.0 * self._wait, LONGEST_WAIT), t, place
        self._tried = t >= self._stopped + self._wait
        if self._tried and np.hypot(*(place - self._place)) < HOLDS * self._length:
            self._held = max(self._held, self._descent / MARGIN)
        return self._tried

    def fault(self, t: float, estimate: Estimate | None) -> Fault | None:
        """Return what is wrong with the way ahead at time t [s]; None if nothing is known to be."""
        if estimate is None or self.steepest == inf or not estimate.is_placed(self._length):
            return None
        azimuth = self._azimuth(estimate, back=float(self.reference.speed(t)) < 0.0)
        along = np.array([cos(azimuth), sin(azimuth)])
        descent = -float(estimate.slope @ along)
        deviation = sqrt(max(float(along @ estimate.slope_covariance @ along), 0.0))
        holds = max(self.steepest, self._held)
        if not (deviation < KNOWN * holds and descent > MARGIN * holds + SURE * deviation):
            return None
        self._descent = descent
        down, slides = degrees(atan(descent)), degrees(atan(holds))
        what = f"the way leads down by {down:.2g} degrees; this worm slides from {slides:.2g} on"
        return Fault(t, "too steep down", what, "it stops: lead it down more gently, or along the slope")

    def _azimuth(self, estimate: Estimate, back: bool) -> float:
        """Return the direction of the way ahead, or of the way back [rad]."""
        path, turned = self.reference.path, pi if back else 0.0
        if path is None:
            return float(estimate.heading) + turned
        self._near = float(path.project(estimate.position, self._near))
        return float(path.heading(self._near + (-AHEAD if back else AHEAD) * self._length)) + turned
