"""What the worm was told, and when: gait parameters and phases of the last seconds."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator

import numpy as np

from worm3d.values.arrays import FloatArray


class Driven:
    """Inputs of the reduced model, each in force up to an instant, and the phases at these instants.

    Parameters
    ----------
    span : float
        Time for which they are kept [s].
    """

    def __init__(self, span: float) -> None:
        self._span = span
        self.reset()

    def reset(self) -> None:
        """Forget them."""
        self._times: list[float] = []
        self._phases: list[float] = []
        self._inputs: list[FloatArray] = []

    def add(self, t: float, given: FloatArray, phase: float) -> None:
        """Add the input in force up to t [s], and the phase [rad] then."""
        last = self._inputs[-1] if self._inputs else given
        self._times.append(t)
        self._phases.append(phase)
        self._inputs.append(last if np.array_equal(last, given) else given)
        if self._times[0] < t - 2.0 * self._span:  # so that old ones go in one piece, not one by one
            old = bisect_left(self._times, t - self._span)
            del self._times[:old], self._phases[:old], self._inputs[:old]

    def __len__(self) -> int:
        return len(self._times)

    def phase(self, t: float) -> float:
        """Return the phase at t [s]."""
        k = min(max(bisect_left(self._times, t), 1), len(self._times) - 1)
        if len(self._times) == 1 or self._times[k] == self._times[k - 1]:
            return self._phases[-1]
        share = (t - self._times[k - 1]) / (self._times[k] - self._times[k - 1])
        return self._phases[k - 1] + share * (self._phases[k] - self._phases[k - 1])

    def between(self, begin: float, end: float) -> Iterator[tuple[FloatArray, float]]:
        """Give the inputs in force between two instants [s], and for how long each was; equal ones in one piece."""
        now, k = begin, bisect_left(self._times, begin + 1e-12)
        while now < end - 1e-12:
            k = min(k, len(self._times) - 1)
            given = self._inputs[k]
            while k < len(self._times) - 1 and self._inputs[k + 1] is given:
                k += 1
            until = end if k == len(self._times) - 1 else min(end, self._times[k])
            yield given, until - now
            now, k = until, k + 1
