"""Position and velocity of a worm, averaged over whole waves, from samples of its centre of mass.

The averages remove the rocking of the body in each wave, and reduce the noise of the samples. Let r(w) be the samples
as a function of the commanded phase w in waves, interpolated linearly, and w_1 the phase of the last sample. Then

    place = int_{w_1 - 1}^{w_1} r dw,    place_0 = int_{w_1 - 3/2}^{w_1 - 1/2} r dw,                          (LC1)
    velocity = (place - place_0) / (t(w_1) - t(w_1 - 1/2)).                                                   (LC2)

If a wave has n samples with white noise of standard deviation sigma, the error of the place is sigma / sqrt(n). The
displacement from place_0 to place has the same error. The place lags behind the worm by half a wave.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from worm3d.values.arrays import FloatArray


class Motion(NamedTuple):
    """Motion of a worm, averaged over a wave."""

    place: FloatArray
    """Mean position over the last wave, shape (2,) [m]. In the first 1.5 waves, mean of all samples."""
    velocity: FloatArray | None
    """Mean velocity, shape (2,) [m/s]. None in the first 1.5 waves."""
    wave: float
    """Duration of the last wave [s]. 0 in the first 1.5 waves."""


class Course:
    """The latest samples of the centre of mass, and the motion (LC1), (LC2) computed from them."""

    def __init__(self) -> None:
        self._samples: deque[tuple[float, float, float, float]] = deque()

    def add(self, waves: float, t: float, place: FloatArray) -> None:
        """Add a sample with its phase [waves], time [s] and place (2,) [m].

        Samples that do not increase the phase are ignored.
        """
        if self._samples and waves <= self._samples[-1][0]:
            return
        self._samples.append((waves, t, float(place[0]), float(place[1])))
        while len(self._samples) > 2 and self._samples[1][0] <= waves - 1.5:
            self._samples.popleft()

    def motion(self) -> Motion | None:
        """Return the motion, or None before the first sample."""
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
    """Return the integrals of the samples over w, from the first sample to each of the ends.

    The samples y, shape (n, 2), are interpolated linearly.
    """
    whole = np.vstack([np.zeros(2), np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(w)[:, None], axis=0)])
    k = np.clip(np.searchsorted(w, ends, side="right") - 1, 0, len(w) - 2)
    part, width = (ends - w[k])[:, None], (w[k + 1] - w[k])[:, None]
    return np.asarray(whole[k] + part * y[k] + 0.5 * part**2 * (y[k + 1] - y[k]) / width)
