"""Slope of the ground, from the climb of the centre of mass along its path.

A worm stands on the thickest segments. With the half-heights h_c of the chambers, which (E2) gives for measured
strains, the axis lies about

    H = sum h_c w_c / sum w_c,   w_c = exp(h_c / delta)                                                       (KF5)

above the ground, with delta a tenth of the rest half-height. On the default worm H is right to 0.2 mm in the mean, at
rest as in a wave, and leaves 1.0 mm rms of the 3.3 mm of vertical motion of the centre of mass. The height z of the
centre of mass minus H is the height g of the ground. A Kalman filter estimates the gradient s of the ground from the
displacement d between samples,

    g -> g + s . d,   s -> s + random change whose variance grows with |d|;   sample: z - H = g               (KF6)

The mean of the samples of a stride counts as one sample: between single samples, errors of the position are as long as
the displacement and point in any direction. The noise of the mean follows from the stated noise of the sensors. The
noise is larger if the samples of a stride scatter more than this noise allows by chance (unknown noise, strains that
spoil H, wrong samples). Only the slope along the direction of motion is observable; the slope across this direction is
unknown before the worm has turned, and has a large variance until then.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from worm3d import Worm
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import Checked

ANYWHERE = 10.0
"""Standard deviation of a coordinate before the first sample [m]."""
MAX_GROUND_SAMPLES = 200
"""Largest number of gathered samples; a worm at rest has no stride."""
BY_CHANCE = 4.0
"""Number of standard errors beyond which the scatter of samples counts as unknown noise."""


@documented
@dataclass(frozen=True, kw_only=True)
class GroundTrust(Checked):
    """Noise of samples of the height, and changes of the ground; the defaults suit worms of 1 m."""

    height: float = parameter(0.005, "least standard deviation of a sample of the height", "m", gt=0)
    standing: float = parameter(0.001, "standard deviation of (KF5) in the mean of a stride", "m", gt=0)
    slope: float = parameter(0.02, "standard deviation of the slope before the first sample", gt=0)
    change: float = parameter(0.01, "change of the slope along the way", "1/sqrt(m)", gt=0)
    stride: float = parameter(0.05, "way over which samples are gathered", "m", gt=0)

    def sized(self, length: float) -> GroundTrust:
        """Return the values for a worm of a length [m] on ground scaled with the length."""
        change = self.change / np.sqrt(length)
        return replace(self, standing=length * self.standing, change=change, stride=length * self.stride)


@dataclass(frozen=True, eq=False)
class Ground:
    """Belief about the ground under the worm."""

    place: FloatArray | None
    """Position of the last stride [m], shape (2,); None before the first stride."""
    mean: FloatArray
    """Height at this position [m], and slope in x and y, shape (3,)."""
    covariance: FloatArray
    """Covariance of the mean, shape (3, 3)."""
    gathered: FloatArray
    """Positions and heights of the samples since the last stride [m], shape (n, 3)."""

    @classmethod
    def unknown(cls, trust: GroundTrust) -> Ground:
        """Return the belief before the first sample."""
        return cls(None, np.zeros(3), np.diag([ANYWHERE, trust.slope, trust.slope]) ** 2, np.zeros((0, 3)))

    @property
    def slope(self) -> FloatArray:
        """Climb per metre in x and in y, shape (2,)."""
        return self.mean[1:]

    def sampled(self, place: FloatArray, height: float, trust: GroundTrust) -> Ground:
        """Return the belief after a sample z - H of the height [m] at a place (2,) [m], (KF6)."""
        gathered = np.vstack([self.gathered, [*place, height]])
        if np.hypot(*(place - gathered[0, :2])) < trust.stride:
            return replace(self, gathered=gathered[-MAX_GROUND_SAMPLES:])
        middle, noise = gathered.mean(axis=0), _noise(gathered[:, 2], trust)
        return self._fused(middle[:2], float(middle[2]), trust.standing**2 + noise / len(gathered), trust)

    def _fused(self, place: FloatArray, height: float, variance: float, trust: GroundTrust) -> Ground:
        way = np.zeros(2) if self.place is None else place - self.place
        along = np.eye(3)
        along[0, 1:] = way
        mean, P = along @ self.mean, along @ self.covariance @ along.T
        P[[1, 2], [1, 2]] += trust.change**2 * float(np.hypot(*way))
        gain = P[:, 0] / (P[0, 0] + variance)
        kept = np.eye(3)
        kept[:, 0] -= gain
        spread = kept @ P @ kept.T + variance * np.outer(gain, gain)
        return Ground(place, mean + gain * (height - mean[0]), spread, np.zeros((0, 3)))


def _noise(heights: FloatArray, trust: GroundTrust) -> float:
    told = trust.height**2
    expected = told + trust.standing**2
    found = float(heights.var(ddof=1)) if len(heights) > 1 else expected
    return found if found > expected * (1.0 + BY_CHANCE * np.sqrt(2.0 / max(len(heights) - 1, 1))) else told


class Standing:
    """Height of a worm's axis above the ground, computed from the strains."""

    def __init__(self, worm: Worm) -> None:
        self._length, self._link = worm.l0, worm.link_length[:, None]
        self._delta = 0.1 * float(np.mean(worm.half_height))

    def height(self, strain: FloatArray) -> float:
        """Return (KF5) for strains of shape (N, 2), NaN where unknown [m]."""
        squared = self._link**2 - (self._length * (1.0 + strain)) ** 2 / 4.0
        half_height = np.sqrt(np.maximum(squared, 0.0))
        height = self._mean(half_height)
        if height == height:
            return height
        known = half_height[np.isfinite(half_height)]
        return self._mean(known) if len(known) else height

    def _mean(self, half_height: FloatArray) -> float:
        share = np.exp((half_height - half_height.max()) / self._delta)
        return float((half_height * share).sum() / share.sum())
