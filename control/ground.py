"""The slope of the ground, from how the centre of mass climbs along its path.

A worm stands on its thickest segments. With the half-heights h_c of its chambers, which (E2) gives for measured strains,
its axis lies about

    H = sum h_c w_c / sum w_c,   w_c = exp(h_c / delta)                                                       (K5)

above the ground, with delta a fifth of the rest half-height. (On the default worm that leaves 0.8 mm rms of 3.3 mm by which
the centre of mass goes up and down when amplitudes change; the thickest chamber alone leaves 1.1 mm.) What is left of the
height z of the centre of mass is that of the ground, whose gradient s is found by a Kalman filter for the way d gone
between samples,

    g -> g + s . d,   s -> s + random change, of which the variance grows with |d|;   sample: z - H = g       (K6)

Only the slope along the way shows. That across it is not known before the worm has turned: the covariance says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worm3d import Worm

FloatArray = NDArray[np.float64]

SHARPNESS = 0.2
"""delta over the mean rest half-height."""

UNKNOWN = 10.0
"""Deviation of the height before the first sample [m]."""


@dataclass(frozen=True, kw_only=True)
class GroundTrust:
    """How far samples of the height are trusted, and how the ground may change.

    Attributes
    ----------
    height : float
        Standard deviation of a sample of the height, less (K5) [m].
    slope : float
        That of the slope before the first sample.
    change : float
        By which the slope changes along the way [1/sqrt(m)].

    Raises
    ------
    ValueError
        A value that is not finite or not above 0.
    """

    height: float = 0.0052
    slope: float = 0.03
    change: float = 0.02

    def __post_init__(self) -> None:
        for name in ("height", "slope", "change"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: got {value!r}, must be finite and above 0")


@dataclass(frozen=True, eq=False)
class Ground:
    """What is believed of the ground under the worm.

    Attributes
    ----------
    place : ndarray, shape (2,), or None
        Where the last sample was taken [m]; None before the first.
    mean : ndarray, shape (3,)
        Height [m] there and slope in x and y.
    covariance : ndarray, shape (3, 3)
    """

    place: FloatArray | None
    mean: FloatArray
    covariance: FloatArray

    @classmethod
    def unknown(cls, trust: GroundTrust) -> Ground:
        """Return what is believed before the first sample."""
        return cls(None, np.zeros(3), np.diag([UNKNOWN, trust.slope, trust.slope]) ** 2)

    @property
    def slope(self) -> FloatArray:
        """What it climbs a metre in x and in y, shape (2,)."""
        return self.mean[1:]

    def sampled(self, place: FloatArray, height: float, trust: GroundTrust) -> Ground:
        """Return what is believed after a sample of the height less (K5) at a place (2,), (K6)."""
        way = np.zeros(2) if self.place is None else place - self.place
        along = np.eye(3)
        along[0, 1:] = way
        mean, P = along @ self.mean, along @ self.covariance @ along.T
        P[[1, 2], [1, 2]] += trust.change**2 * float(np.hypot(*way))
        gain = P[:, 0] / (P[0, 0] + trust.height**2)
        kept = np.eye(3)
        kept[:, 0] -= gain
        spread = kept @ P @ kept.T + trust.height**2 * np.outer(gain, gain)
        return Ground(place, mean + gain * (height - mean[0]), spread)


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
        """Return (K5) of strains of shape (N, 2) [m]."""
        squared = self._link**2 - (self._length * (1.0 + strain)) ** 2 / 4.0
        half_height = np.sqrt(np.maximum(squared, 0.0))
        share = np.exp((half_height - half_height.max()) / self._delta)
        return float((half_height * share).sum() / share.sum())
