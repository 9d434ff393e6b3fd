"""Turn rate of a worm from gyroscopes in its segments, averaged over each wave.

Let d_1 (forward), d_2 (left) and d_3 (up) be the axes of a segment, and w = sum_k w_k d_k its angular rate. Since
d_1' = w_3 d_2 - w_2 d_3, the azimuth a of the segment changes with the rate

    a' = (d_1x d_1y' - d_1y d_1x')/(d_1x^2 + d_1y^2),   w_3 at zero pitch,   w_3/cos(p) at a pitch p             (TR1)

The mean azimuth of the segments differs from the azimuth of the chord by a function of the body's shape, which repeats
in each wave. Therefore the mean of w_3 over all segments and over a wave (phases psi to psi + 2 pi) is the mean turn
rate of the wave. It approximates the turn rate at the middle instant, and contains the constant errors of the
gyroscopes.
"""

from __future__ import annotations

import numpy as np

from worm3d.values.arrays import FloatArray


class MeanRate:
    """Computes the mean turn rate of each wave."""

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None
        self._begin: tuple[float, float] | None = None
        self._turned = 0.0

    def take(self, t: float, rates: FloatArray, phase: float) -> tuple[float, float] | None:
        """Process the angular rates of an instant t [s] at a commanded phase [rad].

        `rates` has the shape (N, 3) [rad/s], with NaN where unknown. If a wave ends with this sample, return the wave's
        middle instant [s] and its mean turn rate to the left [rad/s].
        """
        up = rates[:, 2]
        known = up[np.isfinite(up)]
        if not known.size:
            return None
        rate = float(known.mean())
        if self._begin is None or self._last is None:
            self._begin, self._last = (t, phase), (t, rate)
            return None
        self._turned += (t - self._last[0]) * (rate + self._last[1]) / 2.0
        self._last = t, rate
        began, from_phase = self._begin
        if phase < from_phase + 2.0 * np.pi or not t > began:
            return None
        found = (began + t) / 2.0, self._turned / (t - began)
        self._begin, self._turned = (t, phase), 0.0
        return found
