"""Friction (P10), and work and cost of transport, (P11) to (P14), shared by the planar models.

    W^(n) = F . (q^{n+1} - q^n)                (P11) with F_contract, (P13) with F_friction
    CoT^(n) = W^(n) / dx_COM^(n)               (P12), (P14)

Source: the paper, section IV. The versions with correct units are dimensionless: W / (m g d).
"""

from __future__ import annotations

import numpy as np

from worm3d.values.arrays import FloatArray


def p11_work(force: FloatArray, displacement: FloatArray) -> FloatArray:
    """Return the work of a force over each step, (P11) and (P13), shape (S,) [J].

    Parameters
    ----------
    force, displacement : ndarray, shape (S, K, 2)
        Force on each node [N] and the displacement of that node over the step [m].
    """
    return np.asarray(np.einsum("skd,skd->s", force, displacement))


def p12_cost_of_transport(work: FloatArray, com_x: FloatArray, threshold: float = 0.0) -> FloatArray:
    """Return the cost of transport of each step, (P12) and (P14) [J/m]; zero where the step is too short.

    Parameters
    ----------
    work : ndarray, shape (S,)
        Work of each step [J].
    com_x : ndarray, shape (S + 1,)
        Centre of mass along x [m].
    threshold : float
        Steps with |dx| <= threshold [m] count as zero (the quotient would be noise).
    """
    dx = np.diff(com_x)
    far = np.abs(dx) > threshold
    cost = np.zeros_like(work)
    cost[far] = work[far] / dx[far]
    return cost


def p10_friction(
    load: FloatArray,
    velocity: FloatArray,
    mu: tuple[float | FloatArray, float | FloatArray],
    threshold: float,
) -> FloatArray:
    """Return the friction (P10) of contacts with the given loads and velocities towards the head [N]."""
    forward, backward = mu
    return np.select([velocity > threshold, velocity < -threshold], [-forward * load, backward * load], 0.0)
