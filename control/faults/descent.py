"""Check for descents so steep that a worm on bristles slides down regardless of the wave.

Friction can hold a worm that lies along a descent of gradient g up to g = mu_forward. This is the smallest coefficient
of friction, by default 0.03, or 1.7 degrees. On a steeper descent the worm slides even at rest, and ever faster.
Therefore the worm is stopped before such a descent. Let G be the estimated gradient of the ground, C the covariance of
G, and n the direction of the path a little ahead of the worm (or behind, if the worm has to go backwards). Then

    descent = -G . n,   deviation = sqrt(n . C n)                                                             (DE1)

G follows from positions that may have been wrong for a while, and mu_forward belongs to the ground of the map. A worm
at rest gains no information about either. The stop therefore ends after some seconds: the estimated slope is forgotten,
and the worm tries to continue. If it has to stop again without progress, the next stop is twice as long. If the worm
rested on a slope without sliding, this slope is safe, and only a steeper slope stops the worm again.
"""

from __future__ import annotations

from math import atan, cos, degrees, inf, pi, sin, sqrt

import numpy as np

from control.estimation.estimate import SIGNIFICANT_EXCESS, Estimate
from control.faults.rules import Fault
from control.tracking.references import Reference
from worm3d import Worm
from worm3d.values.arrays import FloatArray

DESCENT_LOOKAHEAD = 0.3
"""The gradient is checked in the direction of the path at this distance ahead [body lengths]. The worm covers this
distance in about three waves."""
USABLE_FRICTION_SHARE = 0.8
"""A worm crawls down gradients of up to this share of the friction. The share is below 1 because the feet that the wave
moves do not hold the worm."""
MAX_GRADIENT_DEVIATION = 0.5
"""The worm is stopped only if the standard deviation of the gradient is below this share of the friction. With a larger
deviation the worm goes on, since a worm at rest learns nothing about the ground."""
HOLDS = 0.01
"""Displacement of a resting worm above which the worm is sliding [body lengths]."""
WAITS, LONGEST_WAIT = 4.0, 64.0
"""Duration of the first stop, and the longest duration of a stop [s]."""


class Descent:
    """Check for steep descents ahead. Friction holds the worm on gradients up to `steepest`.

    `steepest` is infinite if there is no limit.
    """

    def __init__(self, worm: Worm, reference: Reference, steepest: float = inf) -> None:
        self._length, self.reference, self.steepest = worm.length, reference, steepest
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._near: float | None = None
        self._wait, self._stopped, self._tried = WAITS, -inf, False
        self._place: FloatArray | None = None
        self._descent = self._held = 0.0

    def tries(self, t: float, place: FloatArray) -> bool:
        """Return whether a worm that was stopped should try to continue at time t [s].

        `place` is the position of the worm, shape (2,) [m].
        """
        if self._place is None or np.hypot(*(place - self._place)) > DESCENT_LOOKAHEAD * self._length:
            self._wait, self._stopped, self._place = WAITS, t, place
        elif self._tried:
            self._wait, self._stopped, self._place = min(2.0 * self._wait, LONGEST_WAIT), t, place
        self._tried = t >= self._stopped + self._wait
        if self._tried and np.hypot(*(place - self._place)) < HOLDS * self._length:
            self._held = max(self._held, self._descent / USABLE_FRICTION_SHARE)
        return self._tried

    def fault(self, t: float, estimate: Estimate | None) -> Fault | None:
        """Return the fault if the way ahead is too steep at time t [s], otherwise None."""
        if estimate is None or self.steepest == inf or not estimate.is_placed(self._length):
            return None
        azimuth = self._azimuth(estimate, back=float(self.reference.speed(t)) < 0.0)
        along = np.array([cos(azimuth), sin(azimuth)])
        descent = -float(estimate.slope @ along)
        deviation = sqrt(max(float(along @ estimate.slope_covariance @ along), 0.0))
        holds = max(self.steepest, self._held)
        known = deviation < MAX_GRADIENT_DEVIATION * holds
        if not (known and descent > USABLE_FRICTION_SHARE * holds + SIGNIFICANT_EXCESS * deviation):
            return None
        self._descent = descent
        down, slides = degrees(atan(descent)), degrees(atan(holds))
        what = f"the way leads down by {down:.2g} degrees; this worm slides from {slides:.2g} degrees on"
        return Fault(t, "too steep down", what, "the worm stops: lead it down a gentler slope, or along the slope")

    def _azimuth(self, estimate: Estimate, back: bool) -> float:
        """Return the direction of the way ahead [rad]; if `back` is true, the direction of the way back."""
        path, turned = self.reference.path, pi if back else 0.0
        if path is None:
            return float(estimate.heading) + turned
        self._near = float(path.project(estimate.position, self._near))
        ahead = -DESCENT_LOOKAHEAD if back else DESCENT_LOOKAHEAD
        return float(path.heading(self._near + ahead * self._length)) + turned
