"""Work and cost of transport, (P11) to (P14), shared by the planar models.

    W^(n) = F . (q^{n+1} - q^n)                (P11) with F_contract, (P13) with F_friction
    CoT^(n) = W^(n) / dx_COM^(n)               (P12), (P14)

Source: the paper, section IV. Their siblings with the right units are dimensionless: W / (m g d).
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
    work: FloatArray = np.einsum("skd,skd->s", force, displacement)
    return work


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


def dimensionless_cost_of_transport(work: float, mass: float, gravity: float, distance: float) -> float:
    """Return W / (m g d), or NaN if the worm made no way forward (d <= 0)."""
    if distance <= 0.0:
        return float("nan")
    return work / (mass * gravity * distance)


def path_length(com: FloatArray, time: FloatArray, period: float) -> float:
    """Return the length of the path of the centre of mass, averaged over a period about each instant [m].

    A wave rocks the centre of mass; a mean over a period takes that out. From the first place to the mean over the
    first period, and from that over the last one to the last place, it is straight: nothing of the way is lost.

    Parameters
    ----------
    com : ndarray, shape (T, D)
        Centre of mass [m].
    time : ndarray, shape (T,)
        Ascending times [s].
    period : float
        Period of the gait [s].
    """
    if len(time) < 2:
        return 0.0
    half = 0.5 * min(period, float(time[-1] - time[0]))
    inner = time[(time > time[0] + half) & (time < time[-1] - half)]
    middle = np.concatenate([time[:1] + half, inner, time[-1:] - half])
    means = [(_swept(x, time, middle + half) - _swept(x, time, middle - half)) / (2.0 * half) for x in com.T]
    path = np.vstack([com[:1], np.column_stack(means), com[-1:]])
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _swept(values: FloatArray, time: FloatArray, t: FloatArray) -> FloatArray:
    """Return the integral from time[0] to t of the straight lines through values, shape (T,), at times, shape (T,)."""
    up_to = np.append(0.0, np.cumsum(0.5 * np.diff(time) * (values[1:] + values[:-1])))
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 2)
    here = np.interp(t, time, values)
    area: FloatArray = up_to[k] + 0.5 * (t - time[k]) * (values[k] + here)
    return area
