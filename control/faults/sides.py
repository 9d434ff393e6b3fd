"""Detection of swapped strain sensors of left and right, for example because of swapped plugs.

Let d = s_left - s_right be the measured difference of the strains of a segment, and d_e the difference that (CG1) of
`control.estimation.chamber_gains` predicts. Both are smoothed over a time tau. The strains count as swapped if, over
the last waves,

    sum (d - d_e)^2 - sum (d + d_e)^2 > `SWAP_THRESHOLD` e,   e = 4 (v 2 tau/dt sum d_e^2)^1/2                   (SD1)

where e is the standard error of the left side for n samples at intervals of dt. The variance v is the smaller of the
two sums, divided by n. The segment with the largest sums is left out, since it may have a faulty chamber. The left side
of (SD1) was at most 0.6 e for 14 healthy worms on lines, circles and curves, and reached 2.3 e to 4.7 e within three
waves for 8 worms that turned with swapped strains. If the left and the right chambers do the same, as in a straight
worm with equal chambers, a swap cannot be detected, but a swap also does hardly any harm.
"""

from __future__ import annotations

from collections import deque
from math import pi

import numpy as np

from control.estimation.chamber_gains import ChamberGains
from control.faults.rules import Fault
from worm3d.values.arrays import FloatArray

DIFFERENCE_SMOOTHING_TIME = 0.1
"""Time tau over which the differences are smoothed [s]. It equals the lag of the default chambers."""
SWAP_THRESHOLD = 1.5
"""Number of standard errors e in (SD1) above which strains count as swapped."""


class Sides:
    """Check for swapped strains in one worm of N segments. `swapped` is whether a swap has been detected."""

    def __init__(self, segments: int) -> None:
        self._segments = segments
        self.swapped = False
        self._apart = np.zeros((3, self._segments))
        self._waves: deque[tuple[FloatArray, int, float]] = deque(maxlen=2)
        self._time = self._phase = np.nan
        self._sums, self._count, self._seconds = self._none()

    def take(self, t: float, phase: float, strain: FloatArray | None, gains: ChamberGains) -> list[Fault]:
        """Process the strains of time t [s], and return the newly detected faults.

        `strain` has the shape (N, 2). `gains` has already processed the same strains. `phase` is the phase of the wave
        [rad].
        """
        if strain is None or self.swapped:
            return []
        passed, self._time = t - self._time, t
        if not passed > 0.0:
            self._phase = phase
            return []
        expected = strain - gains.miss
        seen, told = strain[:, 0] - strain[:, 1], expected[:, 0] - expected[:, 1]
        apart = np.array([seen - told, seen + told, told])
        apart[np.isnan(apart)] = 0.0
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
        what = "the strains of left and right are swapped: each side shortens as the other side is commanded"
        return [Fault(t, "swapped sides", what, "look at the plugs of the strain sensors; commands are not corrected")]

    def _none(self) -> tuple[FloatArray, int, float]:
        """Return the sums, the count and the time at the beginning of a wave, which are all 0."""
        return np.zeros((3, self._segments)), 0, 0.0

    def _surely(self) -> bool:
        """Return whether (SD1) holds."""
        sums, counts, seconds = (sum(column) for column in zip(*self._waves, strict=True))
        others = np.delete(np.asarray(sums), int(np.argmax(np.asarray(sums)[:2].sum(axis=0))), axis=1)
        own, other, told = others.sum(axis=1)
        alike = max(2.0 * DIFFERENCE_SMOOTHING_TIME * counts / seconds, 1.0)
        error = 4.0 * np.sqrt(min(own, other) / (counts * max(others.shape[1], 1)) * alike * told)
        return bool(own - other > SWAP_THRESHOLD * error)
