"""Compiled steps of the chain, (EI1) to (EI3) of `control.gaits.neural.network`; the import takes a second."""

from __future__ import annotations

import math

import numpy as np

from worm3d.machine.compiled import njit
from worm3d.values.arrays import FloatArray

ONSET = 0.5
"""Rate E above which a segment is active."""


@njit
def slope(
    rates: FloatArray, constants: FloatArray, drive: FloatArray, share: float, felt: FloatArray, out: FloatArray
) -> None:
    """Write the time derivative of the rates, (EI1) to (EI3), shape (2, N, 2), into `out`."""
    n = rates.shape[1]
    for i in range(n):
        for s in range(2):
            e, own = rates[0, i, s], (1.0 - share) * rates[0, i, s] + share * felt[i, s]
            z = constants[2, i, s] * e + constants[3, i, s] * rates[0, i, 1 - s] + drive[i, s]
            if i > 0:
                z += constants[4, i, s] * ((1.0 - share) * rates[0, i - 1, s] + share * felt[i - 1, s])
            if i < n - 1:
                z += constants[5, i, s] * ((1.0 - share) * rates[0, i + 1, s] + share * felt[i + 1, s])
            z -= constants[6, i, s] * rates[1, i, s] + constants[7, i, s]
            out[0, i, s] = (1.0 / (1.0 + math.exp(-z / constants[8, i, s])) - e) / constants[0, i, s]
            out[1, i, s] = (own - rates[1, i, s]) / constants[1, i, s]


@njit
def advance(
    rates: FloatArray, constants: FloatArray, drive: FloatArray, share: float, felt: FloatArray, dt: float, steps: int
) -> None:
    """Advance the rates in place by steps of dt [s], with constant input and constant felt contraction."""
    at, k, total = np.empty_like(rates), np.empty_like(rates), np.empty_like(rates)
    for _ in range(steps):
        at[:], total[:] = rates, 0.0
        for stage in range(4):
            slope(at, constants, drive, share, felt, k)
            weight = 1.0 if stage in (0, 3) else 2.0
            ahead = dt if stage == 2 else 0.5 * dt
            for p, i, s in np.ndindex(rates.shape):
                total[p, i, s] += weight * k[p, i, s]
                at[p, i, s] = rates[p, i, s] + ahead * k[p, i, s]
        for p, i, s in np.ndindex(rates.shape):
            rates[p, i, s] += dt / 6.0 * total[p, i, s]


def onsets(
    rates: FloatArray, constants: FloatArray, drive: FloatArray, dt: float, steps: int
) -> tuple[FloatArray, FloatArray]:
    """Return the times of each rise of E above `ONSET` in `steps` steps of a network that feels nothing.

    Returns
    -------
    times : ndarray, shape (N, 2, M)
        Times [s], ascending, interpolated linearly between steps; NaN after the last time.
    on : ndarray, shape (N, 2)
        Share of the time with E above `ONSET`.
    """
    n = rates.shape[1]
    times, on = np.full((n, 2, 64), np.nan), np.zeros((n, 2))
    _find_onsets(rates, constants, drive, dt, steps, times, on)
    return times, on


@njit
def _find_onsets(
    rates: FloatArray,
    constants: FloatArray,
    drive: FloatArray,
    dt: float,
    steps: int,
    times: FloatArray,
    on: FloatArray,
) -> None:
    n, most = rates.shape[1], times.shape[2]
    felt, before, counts = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 2), np.int64)
    for step in range(steps):
        advance(rates, constants, drive, 0.0, felt, dt, 1)
        for i in range(n):
            for s in range(2):
                e, was = rates[0, i, s], before[i, s]
                on[i, s] += (e > ONSET) / steps
                if was <= ONSET < e and counts[i, s] < most:
                    times[i, s, counts[i, s]] = (step + (ONSET - was) / (e - was)) * dt
                    counts[i, s] += 1
                before[i, s] = e
