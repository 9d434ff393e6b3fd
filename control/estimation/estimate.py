"""Beliefs about the state of a worm, the estimate computed from them, and a test of its covariance.

While the heading is unknown there are several beliefs, each a normal distribution. With weights w_i, means m_i and
covariances P_i, the mixture has the mean and covariance

    m = sum w_i m_i,   P = sum w_i (P_i + (m_i - m)(m_i - m)^T)                                               (KF1)

where headings are averaged on the circle, m_h = arg sum w_i exp(i h_i).

If model and noise are correct, the normalised innovation squared (NIS) of a sample of d numbers has a chi-squared
distribution with d degrees of freedom, independently of earlier samples. The mean over n samples,

    nis = sum nis_k / n   lies in   [chi2^-1(0.025; n d), chi2^-1(0.975; n d)] / n                            (KF7)

with a probability of 95 %. If the mean is above the interval, the estimator trusts the model or the sensors too much.
If the mean is below the interval, the estimator trusts them too little. (Bar-Shalom, Li, Kirubarajan: Estimation with
Applications to Tracking and Navigation, 5.4.2.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from control.estimation.reduced import INDEX, ReducedState
from worm3d.values.arrays import FloatArray

HEADING = INDEX["heading"]
HOPELESS = 12.0
"""Difference of log-likelihood to the most likely belief above which a belief is dropped. It corresponds to a
likelihood ratio of about 160 000."""
NARROW = 0.12
"""Standard deviation of the heading, over all beliefs, below which the beliefs are merged [rad]. If a single belief had
a less certain heading, it would interpret unknown forward motion as sideways motion."""
MAX_POSITION_DEVIATION = 3.0
"""Standard deviation of the position above which the worm's position on the path counts as unknown [body lengths]."""
NIS = ("nis_mean", "nis_low", "nis_high")
"""Names of the mean and the limits of (KF7) in the summary of a run."""
SIGNIFICANT_EXCESS = 2.5
"""An estimated value significantly exceeds a limit if the excess is above this number of standard deviations."""


@dataclass(frozen=True, eq=False)
class Belief:
    """A normal distribution of the state, which consists of n numbers."""

    mean: FloatArray
    """Mean, shape (n,)."""
    covariance: FloatArray
    """Covariance, shape (n, n)."""
    log_weight: float = 0.0
    """Logarithm of the weight, up to a constant that is the same for all beliefs."""
    refused: int = 0
    """Number of consecutive samples of the centre of mass that were refused as impossible."""
    trend: FloatArray = field(default_factory=lambda: np.zeros(2))
    """Mean of the latest innovations of the centre of mass, shape (2,) [m]."""
    turned: int = 0
    """Number of consecutive samples of the heading that were refused as impossible."""


def weights(beliefs: Sequence[Belief]) -> FloatArray:
    """Return the weights, whose sum is 1."""
    logs = np.array([belief.log_weight for belief in beliefs])
    shares = np.exp(np.maximum(logs - logs.max(), -700.0))
    return np.asarray(shares / shares.sum())


def merged(beliefs: Sequence[Belief]) -> Belief:
    """Return the mixture of beliefs, (KF1). Its heading is within half a turn of the most likely belief's heading."""
    if len(beliefs) == 1:
        return beliefs[0]
    shares = weights(beliefs)
    means = np.array([belief.mean for belief in beliefs])
    best = means[np.argmax(shares), HEADING]
    towards = shares @ np.exp(1j * (means[:, HEADING] - best))
    middle = best + (np.angle(towards) if abs(towards) > 1e-9 else -best)  # headings all round: 0 is as good as any
    means[:, HEADING] = middle + wrapped(means[:, HEADING] - middle)
    mean = shares @ means
    mean[HEADING] = middle
    off = means - mean
    covariance = np.einsum("i,ijk->jk", shares, np.array([belief.covariance for belief in beliefs]))
    return Belief(mean, covariance + (shares[:, None] * off).T @ off)


def pruned(beliefs: Sequence[Belief]) -> list[Belief]:
    """Return the beliefs that are likely enough. If they nearly agree, they are merged into one."""
    best = max(belief.log_weight for belief in beliefs)
    likely = [belief for belief in beliefs if belief.log_weight > best - HOPELESS]
    left = [replace(belief, log_weight=belief.log_weight - best) for belief in likely]
    whole = merged(left)
    return [whole] if whole.covariance[HEADING, HEADING] < NARROW**2 else left


def wrapped(angle: FloatArray) -> FloatArray:
    """Return angles in [-pi, pi)."""
    return np.mod(angle + np.pi, 2.0 * np.pi) - np.pi


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated state of the reduced model at an instant. Motion is averaged over a wave."""

    time: float
    """Instant [s]."""
    state: ReducedState
    """Mean of the state, as numbers."""
    covariance: FloatArray
    """Covariance of the state, in the order of its fields, shape (S, S)."""
    nis: float | None
    """NIS of the last sample of the centre of mass, with 2 degrees of freedom. None before the first sample."""
    slope: FloatArray = field(default_factory=lambda: np.zeros(2))
    """Estimated gradient of the ground under the worm, shape (2,): climb per metre in x and in y."""
    slope_covariance: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    """Covariance of the slope, shape (2, 2)."""
    refused: int = 0
    """Number of samples so far that were refused as impossible."""
    pushed: int = 0
    """Number of samples so far that showed a motion that the wave does not explain."""
    jumped: int = 0
    """Number of samples of the heading so far that were accepted although they seemed impossible."""

    @property
    def position(self) -> FloatArray:
        """Centre of mass without the rocking in each wave, shape (2,) [m]."""
        return np.array([self.state.x, self.state.y], dtype=float)

    def is_placed(self, length: float) -> bool:
        """Return whether the position is known well enough to locate a worm of a given length [m] on its path."""
        return bool(np.isfinite(self.position).all() and self.deviations[:2].max() < MAX_POSITION_DEVIATION * length)

    @property
    def heading(self) -> float:
        """Azimuth of the worm, continuous over whole turns [rad]. The initial whole turn is arbitrary."""
        return float(self.state.heading)

    @property
    def speed(self) -> float:
        """Speed along the heading, with the slip subtracted [m/s]."""
        return float((1.0 - self.state.slip) * self.state.speed)

    @property
    def turn_rate(self) -> float:
        """Turn rate to the left from all causes [rad/s]."""
        return float(self.state.turn_rate + self.state.yaw_bias)

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations of the state, shape (S,)."""
        return np.sqrt(np.diagonal(self.covariance))


@dataclass(frozen=True)
class Consistency:
    """Mean of the NIS, and the interval expected for this mean, (KF7)."""

    mean: float
    low: float
    high: float

    @property
    def holds(self) -> bool:
        """Whether the mean lies within the interval."""
        return self.low <= self.mean <= self.high


def consistency(nis: Sequence[float], degrees: int = 2) -> Consistency:
    """Return the result of (KF7) for the NIS of one or more samples, see `Estimator.innovations`.

    `degrees` is the number of degrees of freedom of a sample.
    """
    if not len(nis):
        raise ValueError("consistency: got no innovations, must be at least one; did samples of the sensors arrive?")
    tail = (1.0 - 0.95) / 2.0
    low, high = scipy.stats.chi2.ppf([tail, 1.0 - tail], len(nis) * degrees) / len(nis)
    return Consistency(float(np.mean(nis)), float(low), float(high))
