"""Derivatives of a simulation by finite differences, called slopes, with an estimate of their roughness.

If a key changes, contacts may stick a time step earlier or later. A simulated value is therefore not a smooth function
of the key: on a small scale it has kinks and jumps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scenes.language.errors import SceneError
from worm3d.values.arrays import FloatArray

Function = Callable[[FloatArray], FloatArray | None]
"""Function from values of the keys, shape (P,), to simulated channels, shape (C, T). It returns None if the run
fails."""

MAX_DERIVATIVE_HALVINGS = 4
"""Largest number of times that a step is halved because the runs at both of its ends fail."""


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the channels with respect to the keys."""

    values: FloatArray
    """Shape (C, T, P)."""
    roughness: FloatArray
    """Half of the difference between the slope to larger and the slope to smaller values, shape (C, T, P). It is 0 if
    only one of the two slopes is available."""


def slopes_at(
    function: Function, x: FloatArray, here: FloatArray, steps: FloatArray, low: FloatArray, high: FloatArray
) -> Slopes:
    """Return the slopes at the point `x`.

    Each slope is the mean of the difference quotients to both sides of `x`. If a side is out of range, or if the run
    there fails, the quotient to the other side is used. A step should be about as large as the error of the value,
    because a much smaller step measures single kinks of the simulation.

    Parameters
    ----------
    function : callable
    x : ndarray, shape (P,)
        Values of the keys.
    here : ndarray, shape (C, T)
        Simulated channels at `x`.
    steps : ndarray, shape (P,)
        Step of each key.
    low, high : ndarray, shape (P,)
        Range of each key.

    Raises
    ------
    SceneError
        The runs at both sides fail for every step size.
    """
    each = [_slope(function, x, here, k, float(step), low, high) for k, step in enumerate(steps)]
    values, roughness = (np.stack(part, axis=-1) for part in zip(*each, strict=True))
    return Slopes(values, roughness)


def _slope(
    function: Function, x: FloatArray, here: FloatArray, k: int, step: float, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the slope along key k and its roughness, each of shape (C, T)."""
    for halved in range(MAX_DERIVATIVE_HALVINGS + 1):
        sides = []
        for way in (-step, step):
            there = x.copy()
            there[k] = np.clip(x[k] + way * 0.5**halved, low[k], high[k])
            if there[k] != x[k] and (found := function(there)) is not None:
                sides.append((found - here) / (there[k] - x[k]))
        if sides:
            mean: FloatArray = np.mean(sides, axis=0)
            return mean, sides[-1] - mean
    raise SceneError("around the best values so far the runs fail to both sides of a key")
