"""Step-by-step waves of mesh worm robots: most segments are wide, and waves of extension travel along the body.

A contracted segment is wide, and carries and anchors the worm. An extended segment is thin and off the ground. At one
end of a wave, segments extend and push the front forward. At the other end, segments contract and pull up the rear. If
the ramps take as long as a step from one segment to the next, one segment lengthens exactly while another one shortens.
The anchors on both sides of the wave then do not have to slide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from control.gaits.gait import Direction, ExtendingGait, direction_of_waves, half_cosine
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter


@documented
@dataclass(frozen=True, kw_only=True)
class ExtensionWave(ExtendingGait, name="extension_wave"):
    """Waves of extension along an otherwise contracted body, as in mesh worm robots.

    The n x m patterns of these robots have m waves with n segments each. They are obtained with `moving` = n m/N and
    `waves` = m. With `held` = (n - 2)/n the ramps take one step.
    """

    period: float = parameter(6.0, meaning="time between two extensions of a segment", unit="s", gt=0)
    waves: float = parameter(1.0, meaning="number of waves on the body", gt=0)
    moving: float = parameter(0.5, meaning="share of the period for which a segment is not contracted", gt=0, le=1)
    held: float = parameter(1 / 3, meaning="share of this time while a segment is wholly extended", ge=0, lt=1)
    direction: Direction = direction_of_waves()

    def activations(self, times: FloatArray, segments: int) -> FloatArray:
        """Return the activation of each segment at K times [s], shape (K, segments), in [extension, 1]."""
        order = np.arange(segments) if self.direction == "direct" else np.arange(segments)[::-1]
        # Rounding errors do not matter here, since the ramps are flat where they begin and end.
        phase = np.mod(times[:, None] / self.period - self.waves * order / segments, 1.0) / self.moving
        ramp = 0.5 * (1.0 - self.held)
        extended = half_cosine(phase / ramp) - half_cosine((phase - 1.0 + ramp) / ramp)
        return self.activation_of(extended)
