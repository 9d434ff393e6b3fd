"""Search for other local minima of a sum of squares.

If a change of a key makes a contact stick one time step later, the sum of squares changes its slope or jumps. Around
each such event the sum may have a shallow local minimum, called a dip here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from worm3d.values.arrays import FloatArray

DISTANCES = (0.003, 0.006, 0.012, 0.025, 0.05, 0.1)
"""The sum is evaluated at these distances from the minimum, as fractions of a key's scale. The distance is the change
of the key that changes most."""


def dips(squares: Callable[[FloatArray], float], u: FloatArray, axes: FloatArray) -> list[FloatArray]:
    """Return points around a minimum where a search for another minimum may start, sorted by the sum of squares.

    Parameters
    ----------
    squares : callable
        Sum of squares at scaled values, shape (P,); infinite where the sum does not exist.
    u : ndarray, shape (P,)
        A minimum.
    axes : ndarray, shape (K, P)
        Directions of the search.
    """
    here = squares(u)
    found = [dip for axis in axes for side in (-1.0, 1.0) for dip in _along(squares, u, here, side * axis)]
    return [place for _, place in sorted(found, key=lambda dip: dip[0])]


def _along(
    squares: Callable[[FloatArray], float], u: FloatArray, here: float, axis: FloatArray
) -> Iterator[tuple[float, FloatArray]]:
    """Search along an axis, and yield the sum of squares and the point of the lowest dip, if there is a dip.

    A point belongs to a dip if the sum is smaller there than at the previous point, which is nearer to the minimum.
    """
    way = axis / np.abs(axis).max()
    places = [u + distance * way for distance in DISTANCES]
    heights = [here, *map(squares, places)]
    down = [k for k in range(1, len(heights)) if heights[k] < heights[k - 1]]
    if down:
        k = min(down, key=lambda k: heights[k])
        yield heights[k], places[k - 1]
