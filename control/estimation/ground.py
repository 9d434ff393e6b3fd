"""Estimation of the slope of the ground from the climb of the centre of mass along its path.

A worm stands on its thickest segments. Let h_c be the half-heights of the chambers, which (E2) gives for measured
strains, and delta a tenth of the half-height at rest. The height of the axis above the ground is about

    H = sum h_c w_c / sum w_c,   w_c = exp(h_c / delta)                                                       (KF5)

On the default worm, the mean error of H is 0.2 mm, both at rest and in a wave. Of the 3.3 mm rms of vertical motion of
the centre of mass, 1.0 mm remains unexplained. The height z of the centre of mass minus H is the height g of the
ground. A Kalman filter estimates the gradient s of the ground from the displacement d between samples:

    g -> g + s . d,   s -> s + random change whose variance grows with |d|;   sample: z - H = g               (KF6)

All samples within a stride are averaged and count as one sample. Otherwise the errors of the position would be as large
as the displacement between samples, and point in any direction. The noise of the average follows from the stated noise
of the sensors. If the samples of a stride scatter significantly more, their scatter is used instead. Possible reasons
are unknown noise, strains that make H wrong, and wrong samples. Only the slope in the direction of motion is
observable. The slope across this direction has a large variance until the worm has turned.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from worm3d import Worm
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import Checked

ANYWHERE = 10.0
"""Initial standard deviation of the coordinates and the height, before the first sample [m]."""
MAX_GROUND_SAMPLES = 200
"""Maximum number of samples in the average. The limit is needed because a worm at rest never completes a stride."""
BY_CHANCE = 4.0
"""The scatter of the samples replaces the stated noise if the excess is above this number of standard errors."""


@documented
@dataclass(frozen=True, kw_only=True)
class GroundTrust(Checked):
    """Noise of samples of the height, and expected changes of the ground. The defaults suit worms of 1 m."""

    height: float = parameter(0.005, "least standard deviation of a sample of the height", "m", gt=0)
    standing: float = parameter(0.001, "standard deviation of (KF5) in the mean of a stride", "m", gt=0)
    slope: float = parameter(0.02, "standard deviation of the slope before the first sample", gt=0)
    change: float = parameter(0.01, "change of the slope along the way", "1/sqrt(m)", gt=0)
    stride: float = parameter(0.05, "way over which samples are gathered", "m", gt=0)

    def sized(self, length: float) -> GroundTrust:
        """Return the values for a worm of a given length [m], on ground that is scaled with the length."""
        change = self.change / np.sqrt(length)
        return replace(self, standing=length * self.standing, change=change, stride=length * self.stride)


@dataclass(frozen=True, eq=False)
class Ground:
    """Belief about the ground under the worm."""

    place: FloatArray | None
    """Mean position in the last stride [m], shape (2,). None before the first stride."""
    mean: FloatArray
    """Height at this position [m], followed by the slopes in x and y, shape (3,)."""
    covariance: FloatArray
    """Covariance of `mean`, shape (3, 3)."""
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
        """Return the belief after a sample of the height of the ground, z - H [m], at a place (2,) [m], (KF6)."""
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
        """Return the height (KF5) [m]. The strains have the shape (N, 2), with NaN where unknown."""
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
