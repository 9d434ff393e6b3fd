"""The slope of the ground, from how the centre of mass climbs along its path.

A worm stands on its thickest segments. With the half-heights h_c of its chambers, which (E2) gives for measured
strains, its axis lies about

    H = sum h_c w_c / sum w_c,   w_c = exp(h_c / delta)                                                       (K5)

above the ground, with delta a tenth of the rest half-height: on the default worm that is right to 0.2 mm in the mean,
at rest as in a wave, and leaves 1.0 mm rms of the 3.3 mm by which the centre of mass goes up and down. What is left
of the height z of the centre of mass is that of the ground, whose gradient s is found by a Kalman filter for the way
d gone between samples,

    g -> g + s . d,   s -> s + random change, of which the variance grows with |d|;   sample: z - H = g       (K6)

Samples are gathered over a stride, and their mean is taken for one: between single samples errors of the place are as
long as the way itself, and point anywhere. Its noise is what sensors are told to have, or more where the samples of a
stride scatter more than that by chance (noise that nobody told, strains that spoil H, wrong samples). Only the slope
along the way shows; that across it is not known before the worm has turned, and the covariance says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from worm3d import Worm
from worm3d.values.arrays import FloatArray

SHARPNESS = 0.1
"""delta over the mean rest half-height."""

UNKNOWN = 10.0
"""Deviation of the height before the first sample [m]."""

STRIDE = 0.05
"""Way over which samples are gathered [m]."""
MOST = 200
"""So many samples are gathered at most: a worm at rest has no stride."""
BY_CHANCE = 4.0
"""Standard errors by which samples scatter more than expected before that is taken for noise that nobody told."""


@dataclass(frozen=True, kw_only=True)
class GroundTrust:
    """How far samples of the height are trusted, and how the ground may change.

    Attributes
    ----------
    height : float
        Standard deviation of the noise of a sample of the height [m], at least.
    standing : float
        Standard deviation of (K5), which the mean of a stride keeps [m].
    slope : float
        That of the slope before the first sample.
    change : float
        By which the slope changes along the way [1/sqrt(m)].

    Raises
    ------
    ValueError
        A value that is not finite or not above 0.
    """

    height: float = 0.005
    standing: float = 0.001
    slope: float = 0.02
    change: float = 0.01

    def __post_init__(self) -> None:
        for name in ("height", "standing", "slope", "change"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: got {value!r}, must be finite and above 0")


@dataclass(frozen=True, eq=False)
class Ground:
    """What is believed of the ground under the worm.

    Attributes
    ----------
    place : ndarray, shape (2,), or None
        Where the last stride was taken [m]; None before the first.
    mean : ndarray, shape (3,)
        Height [m] there and slope in x and y.
    covariance : ndarray, shape (3, 3)
    gathered : ndarray, shape (n, 3)
        Places and heights of the samples since [m].
    """

    place: FloatArray | None
    mean: FloatArray
    covariance: FloatArray
    gathered: FloatArray

    @classmethod
    def unknown(cls, trust: GroundTrust) -> Ground:
        """Return what is believed before the first sample."""
        return cls(None, np.zeros(3), np.diag([UNKNOWN, trust.slope, trust.slope]) ** 2, np.zeros((0, 3)))

    @property
    def slope(self) -> FloatArray:
        """What it climbs a metre in x and in y, shape (2,)."""
        return self.mean[1:]

    def sampled(self, place: FloatArray, height: float, trust: GroundTrust) -> Ground:
        """Return what is believed after a sample of the height less (K5) at a place (2,), (K6)."""
        gathered = np.vstack([self.gathered, [*place, height]])
        if np.hypot(*(place - gathered[0, :2])) < STRIDE:
            return replace(self, gathered=gathered[-MOST:])
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
    """Return the variance of the noise of heights that were gathered over a stride [m^2]."""
    told = trust.height**2
    expected = told + trust.standing**2
    found = float(heights.var(ddof=1)) if len(heights) > 1 else expected
    return found if found > expected * (1.0 + BY_CHANCE * np.sqrt(2.0 / max(len(heights) - 1, 1))) else told


class Standing:
    """How high a worm's axis lies above the ground, by its strains.

    Parameters
    ----------
    worm : Worm
    """

    def __init__(self, worm: Worm) -> None:
        self._length, self._link = worm.l0, worm.link_length[:, None]
        self._delta = SHARPNESS * float(np.mean(worm.half_height))

    def height(self, strain: FloatArray) -> float:
        """Return (K5) of strains of shape (N, 2) [m], NaN where they are not known."""
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
