"""What an estimator says of a worm."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from control.estimation.reduced import ReducedState
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Estimate:
    """State of the reduced model at an instant; motion is averaged over a wave.

    Attributes
    ----------
    time : float
        [s]
    state : ReducedState
        Numbers.
    covariance : ndarray, shape (9, 9)
        Of the state's errors, in the order of its fields.
    nis : float or None
        Normalised innovation squared, of 2 degrees of freedom, of the last sample of the centre of mass; None before
        the first.
    slope : ndarray, shape (2,)
        Gradient of the ground where the worm is: what it climbs a metre in x and in y.
    slope_covariance : ndarray, shape (2, 2)
    refused : int
        Samples so far that were held for impossible.
    """

    time: float
    state: ReducedState
    covariance: FloatArray
    nis: float | None
    slope: FloatArray = field(default_factory=lambda: np.zeros(2))
    slope_covariance: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    refused: int = 0

    @property
    def position(self) -> FloatArray:
        """Centre of mass without what a wave rocks it by, shape (2,) [m]."""
        return np.array([self.state.x, self.state.y], dtype=float)

    @property
    def heading(self) -> float:
        """Azimuth, unwrapped; its whole turns are arbitrary [rad]."""
        return float(self.state.heading)

    @property
    def speed(self) -> float:
        """Along the heading, less what slips [m/s]."""
        return float((1.0 - self.state.slip) * self.state.speed)

    @property
    def turn_rate(self) -> float:
        """To the left, whatever makes it [rad/s]."""
        return float(self.state.turn_rate + self.state.yaw_bias)

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations of the state, shape (9,)."""
        deviations: FloatArray = np.sqrt(np.diagonal(self.covariance))
        return deviations
