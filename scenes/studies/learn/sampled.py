"""Polygons that approximate paths, for fast evaluation in every control period of an episode."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from control.tracking.paths import Path
from worm3d.values.arrays import FloatArray

CORNER_SPACING = 0.01
"""Distance between the corners [body lengths]. On a circle with a radius of one body length, a chord differs from the
circle by at most 1/80000 of the radius."""
PATH_SEARCH_DISTANCE = 0.5
"""Largest distance along the path from the previous nearest point in the search for the next one [body lengths]."""


class Sampled:
    """A path as a polygon, from one body length before its start to one body length after the arc length `length`.

    Parameters
    ----------
    path : Path
    length : float
        Arc length that the worm may need [m].
    body : float
        Body length of the worm [m].
    """

    closed = False

    def __init__(self, path: Path, length: float, body: float) -> None:
        self._s = np.arange(-body, length + body, CORNER_SPACING * body)
        self._r, self._headings = path.point(self._s), path.heading(self._s)
        self._curvatures, self.length = path.curvature(self._s), length
        self._reach = round(PATH_SEARCH_DISTANCE / CORNER_SPACING)

    def point(self, s: ArrayLike) -> FloatArray:
        """Return the points at the arc lengths s; see `Path`."""
        return np.stack([self._at(s, column) for column in self._r.T], axis=-1)

    def heading(self, s: ArrayLike) -> FloatArray:
        """Return the azimuths at the arc lengths s; see `Path`."""
        return self._at(s, self._headings)

    def curvature(self, s: ArrayLike) -> FloatArray:
        """Return the curvatures at the arc lengths s; see `Path`."""
        return self._at(s, self._curvatures)

    def project(self, xy: ArrayLike, near: float | None = None) -> FloatArray:
        """Return the arc length of the point that is nearest to the position `xy`, shape (2,); see `Path`."""
        place, begin, end = np.asarray(xy, dtype=float), 0, len(self._s)
        if near is not None:
            k = int((near - self._s[0]) / (self._s[1] - self._s[0]))
            begin, end = max(0, min(k, end - 2) - self._reach), min(end, max(k, 0) + self._reach)
        off: Any = self._r[begin:end] - place
        k = begin + int(np.argmin(np.einsum("ij,ij->i", off, off)))
        azimuth = self._headings[k]
        return np.asarray(self._s[k] + (place - self._r[k]) @ np.array([np.cos(azimuth), np.sin(azimuth)]))

    def _at(self, s: ArrayLike, values: FloatArray) -> FloatArray:
        return np.asarray(np.interp(np.asarray(s, dtype=float), self._s, values))
