"""Descents that are too steep: a worm on bristles slides down regardless of the wave.

Friction holds a worm that lies along a descent of gradient g up to g = mu_forward, the least coefficient, by default
0.03, or 1.7 degrees. On a steeper descent the worm slides, also at rest, and ever faster. The worm is therefore stopped
before such a descent. With the estimated gradient G of the ground, the covariance C of G, and the direction n of the
path a little ahead (or behind, if the worm has to go backwards),

    descent = -G . n,   deviation = sqrt(n . C n)                                                             (DE1)

G follows from positions that may have been wrong for a while, mu_forward belongs to the ground of the map, and a worm
at rest gains no information about either. The stop therefore ends after some seconds: the slope is forgotten, and the
worm tries the way again. If the worm has to stop again without progress, the next wait is twice as long. A slope that
has held the resting worm without sliding is safe: only a steeper slope stops the worm again.
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
"""Distance ahead in which the path must not be too steep [body lengths]: the distance of three waves."""
USABLE_FRICTION_SHARE = 0.8
"""Share of the friction up to which a worm crawls downhill: feet that the wave moves do not hold the worm."""
MAX_GRADIENT_DEVIATION = 0.5
"""Greatest standard deviation of the gradient, as a share of the friction, for a stop: a worm that stops learns no more
about the ground."""
HOLDS = 0.01
"""Least displacement of a resting worm that counts as sliding [body lengths]."""
WAITS, LONGEST_WAIT = 4.0, 64.0
"""Time from the first stop to the next try, and the longest such time [s]."""


class Descent:
    """Check for descents ahead; `steepest` is the greatest gradient that holds the worm, infinite without a limit."""

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
        """Return whether a worm with a fault at a position (2,) [m] should try the way again at time t [s]."""
        if self._place is None or np.hypot(*(place - self._place)) > DESCENT_LOOKAHEAD * self._length:
            self._wait, self._stopped, self._place = WAITS, t, place
        elif self._tried:
            self._wait, self._stopped, self._place = min(2.0 * self._wait, LONGEST_WAIT), t, place
        self._tried = t >= self._stopped + self._wait
        if self._tried and np.hypot(*(place - self._place)) < HOLDS * self._length:
            self._held = max(self._held, self._descent / USABLE_FRICTION_SHARE)
        return self._tried

    def fault(self, t: float, estimate: Estimate | None) -> Fault | None:
        """Return the fault of the way ahead at time t [s]; None without a known fault."""
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
        what = f"the way leads down by {down:.2g} degrees; this worm slides from {slides:.2g} on"
        return Fault(t, "too steep down", what, "it stops: lead it down more gently, or along the slope")

    def _azimuth(self, estimate: Estimate, back: bool) -> float:
        """Return the direction of the way ahead, or of the way back [rad]."""
        path, turned = self.reference.path, pi if back else 0.0
        if path is None:
            return float(estimate.heading) + turned
        self._near = float(path.project(estimate.position, self._near))
        ahead = -DESCENT_LOOKAHEAD if back else DESCENT_LOOKAHEAD
        return float(path.heading(self._near + ahead * self._length)) + turned
