"""What is believed of the worm's state: one normal distribution, or several while its heading is not known.

Of beliefs with the weights w_i, means m_i and covariances P_i, the whole has

    m = sum w_i m_i,   P = sum w_i (P_i + (m_i - m)(m_i - m)^T)                                                (K1)

with headings averaged on the circle, m_h = arg sum w_i exp(i h_i).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from worm3d.values.arrays import FloatArray

HEADING = 2
"""Index of the heading in the state."""

HOPELESS = 12.0
"""A belief is given up when it is exp(12), a hundred thousand, times less likely than the best."""

NARROW = 0.25
"""Beliefs are put into one when their headings together deviate by less than this [rad]."""


@dataclass(frozen=True, eq=False)
class Belief:
    """A normal distribution of the state.

    Attributes
    ----------
    mean : ndarray, shape (n,)
    covariance : ndarray, shape (n, n)
    log_weight : float
        Logarithm of how likely it is, up to a constant that all beliefs share.
    refused, turned : int
        Samples in a row of the centre of mass, and of the heading, that it held for impossible.
    """

    mean: FloatArray
    covariance: FloatArray
    log_weight: float = 0.0
    refused: int = 0
    turned: int = 0


def weights(beliefs: Sequence[Belief]) -> FloatArray:
    """Return the weights, whose sum is 1."""
    logs = np.array([belief.log_weight for belief in beliefs])
    shares = np.exp(np.maximum(logs - logs.max(), -700.0))
    normalised: FloatArray = shares / shares.sum()
    return normalised


def merged(beliefs: Sequence[Belief]) -> Belief:
    """Return all beliefs as one, (K1); headings count from that of the likeliest, so that they do not jump by turns."""
    if len(beliefs) == 1:
        return beliefs[0]
    shares = weights(beliefs)
    means = np.array([belief.mean for belief in beliefs])
    best = means[np.argmax(shares), HEADING]
    towards = shares @ np.exp(1j * (means[:, HEADING] - best))
    middle = best + (np.angle(towards) if abs(towards) > 1e-9 else -best)  # from all sides: 0, as good as any
    means[:, HEADING] = middle + wrapped(means[:, HEADING] - middle)
    mean = shares @ means
    mean[HEADING] = middle
    off = means - mean
    covariance = np.einsum("i,ijk->jk", shares, np.array([belief.covariance for belief in beliefs]))
    return Belief(mean, covariance + (shares[:, None] * off).T @ off)


def reduced(beliefs: Sequence[Belief]) -> list[Belief]:
    """Return the beliefs that there is still hope for; all as one when they say nearly the same."""
    best = max(belief.log_weight for belief in beliefs)
    left = [
        replace(belief, log_weight=belief.log_weight - best)
        for belief in beliefs
        if belief.log_weight > best - HOPELESS
    ]
    whole = merged(left)
    return [whole] if whole.covariance[HEADING, HEADING] < NARROW**2 else left


def wrapped(angle: FloatArray) -> FloatArray:
    """Return angles in [-pi, pi)."""
    turned: FloatArray = np.mod(angle + np.pi, 2.0 * np.pi) - np.pi
    return turned
