"""Compiled steps of a stable heteroclinic cycle; `control.gaits.shc.cycle` has the equation, (SH1)."""

from __future__ import annotations

import numpy as np

from worm3d.machine.compiled import njit
from worm3d.values.arrays import FloatArray


@njit
def advance(
    states: FloatArray,
    alpha: FloatArray,
    rho: FloatArray,
    noise: float,
    push: FloatArray,
    dt: float,
    draws: FloatArray,
    path: FloatArray,
) -> None:
    """Take K steps and write the states after each; the states, shape (n,), are overwritten by the last.

    With the rate g = alpha - rho a and the input u held over a step (the rate at the middle of the step), the equation
    is linear and solved exactly, so that no step is too long at a saddle, and states far below the rounding of the
    largest state grow correctly:

        a <- |a e^(g dt) + u (e^(g dt) - 1)/g + noise sqrt((e^(2 g dt) - 1)/(2 g)) xi|

    Parameters
    ----------
    alpha, push : ndarray, shape (n,)
    rho : ndarray, shape (n, n)
    noise, dt : float
    draws : ndarray, shape (K, n)
        Standard normal numbers xi.
    path : ndarray, shape (K, n)
        Filled.
    """
    n = len(states)
    middle = np.empty(n)
    for k in range(len(draws)):
        for i in range(n):
            rate = alpha[i]
            for j in range(n):
                rate -= rho[i, j] * states[j]
            middle[i] = (states[i] + 0.5 * dt * push[i]) * np.exp(0.5 * dt * rate)
        for i in range(n):
            rate = alpha[i]
            for j in range(n):
                rate -= rho[i, j] * middle[j]
            x = rate * dt
            held = dt if abs(x) < 1e-8 else np.expm1(x) / rate
            variance = dt if abs(x) < 1e-8 else 0.5 * np.expm1(2.0 * x) / rate
            states[i] = abs(states[i] * np.exp(x) + push[i] * held + noise * np.sqrt(variance) * draws[k, i])
            path[k, i] = states[i]
