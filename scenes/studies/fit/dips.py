"""Other valleys of a rough sum of squares: each contact that sticks a step later may make a shallow valley."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from worm3d.values.arrays import FloatArray

DISTANCES = (0.003, 0.006, 0.012, 0.025, 0.05, 0.1)
"""Distances at which the sum is evaluated, as fractions of the scale of the key that moves most."""


def dips(squares: Callable[[FloatArray], float], u: FloatArray, axes: FloatArray) -> list[FloatArray]:
    """Return places around a minimum from which the sum descends to another minimum, the lowest place first.

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
    """Yield the sum of squares at the lowest place behind a crest, and the place."""
    way = axis / np.abs(axis).max()
    places = [u + distance * way for distance in DISTANCES]
    heights = [here, *map(squares, places)]
    down = [k for k in range(1, len(heights)) if heights[k] < heights[k - 1]]
    if down:
        k = min(down, key=lambda k: heights[k])
        yield heights[k], places[k - 1]
