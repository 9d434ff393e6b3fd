"""Derivatives of a simulation by finite differences, with an estimate of the simulation's roughness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scenes.language.errors import SceneError
from worm3d.values.arrays import FloatArray

Function = Callable[[FloatArray], FloatArray | None]
"""Values of the keys, shape (P,) -> channels, shape (C, T); None where the run fails."""

MAX_DERIVATIVE_HALVINGS = 4
"""Largest number of halvings of a step if the run fails at both ends of the step."""


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the channels with respect to the keys."""

    values: FloatArray
    """Shape (C, T, P)."""
    roughness: FloatArray
    """Half of the difference between the slopes to both sides, shape (C, T, P); 0 if only one side exists."""


def slopes_at(
    function: Function, x: FloatArray, here: FloatArray, steps: FloatArray, low: FloatArray, high: FloatArray
) -> Slopes:
    """Return the slopes at a place from runs at both sides, or at one side if the other is out of range or fails.

    Contacts that stick a time step earlier or later make a simulation rough on a small scale. The step should therefore
    be as large as the error of a value; a tiny step is wrong.

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
    """Return the slope along one key, and the roughness of the slope, shape (C, T) each."""
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
