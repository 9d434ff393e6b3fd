"""Detection of swapped strains of left and right, as with swapped plugs, from the differences of the sides.

With the difference d = s_left - s_right of the strains of a segment, measured and expected (d_e) by (CG1) of
`control.estimation.chamber_gains`, both smoothed over a time tau, the strains count as swapped if over the last waves

    sum (d - d_e)^2 - sum (d + d_e)^2 > sure standard errors,   standard error = 4 (v 2 tau/dt sum d_e^2)^1/2   (SD1)

for n samples dt apart; the smaller sum gives the variance v = sum/n. The sums leave out the segment with the largest
sum, which may have a chamber that does not obey. The left side of (SD1) was at most 0.6 standard errors for 14 healthy
worms on lines, circles and curves, and 2.3 to 4.7 within three waves for 8 worms that turn with swapped strains. If
both sides do the same, as in a straight worm of equal chambers, a swap does not show, and does hardly any harm.
"""

from __future__ import annotations

from collections import deque
from math import pi

import numpy as np

from control.estimation.chamber_gains import ChamberGains
from control.faults.rules import Fault
from worm3d.values.arrays import FloatArray

DIFFERENCE_SMOOTHING_TIME = 0.1
"""Time tau over which differences are averaged [s], the lag of the default chambers."""
SWAP_THRESHOLD = 1.5
"""Number of standard errors in (SD1) above which strains count as swapped."""


class Sides:
    """The sides of one worm of N segments; `swapped` is whether the strains of left and right are swapped."""

    def __init__(self, segments: int) -> None:
        self._segments = segments
        self.swapped = False
        self._apart = np.zeros((3, self._segments))
        self._waves: deque[tuple[FloatArray, int, float]] = deque(maxlen=2)
        self._time = self._phase = np.nan
        self._sums, self._count, self._seconds = self._none()

    def take(self, t: float, phase: float, strain: FloatArray | None, gains: ChamberGains) -> list[Fault]:
        """Take the strains of time t [s], shape (N, 2), which the gains have taken; return newly found faults.

        `phase` is the phase of the wave [rad].
        """
        if strain is None or self.swapped:
            return []
        passed, self._time = t - self._time, t
        if not passed > 0.0:
            self._phase = phase
            return []
        expected = strain - gains.miss
        seen, told = strain[:, 0] - strain[:, 1], expected[:, 0] - expected[:, 1]
        apart = np.nan_to_num(np.stack([seen - told, seen + told, told]))
        self._apart += (1.0 - np.exp(-passed / DIFFERENCE_SMOOTHING_TIME)) * (apart - self._apart)
        self._sums += self._apart**2
        self._count, self._seconds = self._count + 1, self._seconds + passed
        if abs(phase - self._phase) < 2.0 * pi:
            return []
        self._waves.append((self._sums, self._count, self._seconds))
        self._phase = phase
        self._sums, self._count, self._seconds = self._none()
        self.swapped = len(self._waves) == self._waves.maxlen and self._surely()
        if not self.swapped:
            return []
        what = "the strains of left and right are swapped: each side shortens as the other one is told to"
        return [Fault(t, "swapped sides", what, "look at the plugs of the strain sensors; commands are not corrected")]

    def _none(self) -> tuple[FloatArray, int, float]:
        """Return sums, count and time at the beginning of a wave."""
        return np.zeros((3, self._segments)), 0, 0.0

    def _surely(self) -> bool:
        """Return whether (SD1) holds."""
        sums, counts, seconds = (sum(column) for column in zip(*self._waves, strict=True))
        others = np.delete(np.asarray(sums), int(np.argmax(np.asarray(sums)[:2].sum(axis=0))), axis=1)
        own, other, told = others.sum(axis=1)
        alike = max(2.0 * DIFFERENCE_SMOOTHING_TIME * counts / seconds, 1.0)
        error = 4.0 * np.sqrt(min(own, other) / (counts * max(others.shape[1], 1)) * alike * told)
        return bool(own - other > SWAP_THRESHOLD * error)
