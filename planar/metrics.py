"""Friction (P10), work (P11), (P13) and cost of transport (P12), (P14), as used by both planar models.

    W^(n) = F . (q^{n+1} - q^n)                (P11) with F_contract, (P13) with F_friction
    CoT^(n) = W^(n) / dx_COM^(n)               (P12), (P14)

Source: the paper, section IV. This cost of transport has the unit J/m. The corrected worm has a dimensionless cost
of transport, W / (m g d), with the mass m, gravity g and the distance d.
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
    """Return the cost of transport of each step, (P12) and (P14), shape (S,) [J/m].

    Parameters
    ----------
    work : ndarray, shape (S,)
        Work of each step [J].
    com_x : ndarray, shape (S + 1,)
        Centre of mass along x [m].
    threshold : float
        The cost of steps with |dx| <= threshold [m] is 0, since the quotient would be dominated by rounding errors.
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
    """Return the friction forces (P10) of contacts, positive towards the head [N].

    Parameters
    ----------
    load, velocity : ndarray
        Normal load [N] and velocity, positive towards the head [m/s], of each contact.
    mu : tuple
        Coefficients of friction for motion towards the head and towards the tail.
    threshold : float
        There is no friction up to this speed [m/s].
    """
    forward, backward = mu
    return np.select([velocity > threshold, velocity < -threshold], [-forward * load, backward * load], 0.0)
