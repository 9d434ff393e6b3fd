"""Place and velocity of a worm as means over whole waves, from samples of its centre of mass.

A wave rocks the body, and samples are noisy. With the samples r(w) over the commanded phase w in waves, interpolated
linearly, and the phase w_1 of the last sample,

    place = int_{w_1 - 1}^{w_1} r dw,    place_0 = int_{w_1 - 3/2}^{w_1 - 1/2} r dw,                          (LC1)
    velocity = (place - place_0) / (t(w_1) - t(w_1 - 1/2)).                                                   (LC2)

White noise of standard deviation sigma in n samples a wave causes an error of sigma / sqrt(n) in the place, and the
same error in the displacement from place_0 to place. The place lags by half a wave.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from worm3d.values.arrays import FloatArray


class Motion(NamedTuple):
    """Motion of a worm, averaged over a wave."""

    place: FloatArray
    """Mean place, shape (2,) [m]; of all samples in the first waves."""
    velocity: FloatArray | None
    """Mean velocity, shape (2,) [m/s]; None in the first waves."""
    wave: float
    """Time that the last wave took [s]; 0 in the first waves."""


class Course:
    """The last samples of a centre of mass, and (LC1), (LC2) of these samples."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float, float, float]] = deque()

    def add(self, waves: float, t: float, place: FloatArray) -> None:
        """Take a sample of phase [waves], time [s] and place (2,) [m]; ignore a sample that is not after the last."""
        if self._samples and waves <= self._samples[-1][0]:
            return
        self._samples.append((waves, t, float(place[0]), float(place[1])))
        while len(self._samples) > 2 and self._samples[1][0] <= waves - 1.5:
            self._samples.popleft()

    def motion(self) -> Motion | None:
        """Return the motion; None before the first sample."""
        if not self._samples:
            return None
        waves, *columns = np.array(self._samples).T
        time, places = columns[0], np.array(columns[1:]).T
        if waves[-1] - waves[0] < 1.5:
            return Motion(places.mean(axis=0), None, 0.0)
        ends = waves[-1] - np.array([1.5, 1.0, 0.5, 0.0])
        a, b, c, d = _integral(waves, places, ends)
        place, before = d - b, c - a
        begin, middle, end = np.interp(ends[1:], waves, time)
        return Motion(place, (place - before) / (end - middle), float(end - begin))


def _integral(w: FloatArray, y: FloatArray, ends: FloatArray) -> FloatArray:
    """Return the integrals over w, up to each of the ends, of the linear interpolation of samples y (n, 2)."""
    whole = np.vstack([np.zeros(2), np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(w)[:, None], axis=0)])
    k = np.clip(np.searchsorted(w, ends, side="right") - 1, 0, len(w) - 2)
    part, width = (ends - w[k])[:, None], (w[k + 1] - w[k])[:, None]
    return np.asarray(whole[k] + part * y[k] + 0.5 * part**2 * (y[k + 1] - y[k]) / width)
