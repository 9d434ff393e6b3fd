"""What every simulator is asked to do: the default worm of the project crawls over flat ground for ten seconds."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from control.gaits import TravellingWave
from worm3d import Worm
from worm3d.values.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class Task:
    """A worm, its gait and its ground; the defaults are the default worm.

    Attributes
    ----------
    worm : Worm
        Sizes, mass, stiffness, damping and actuator lag.
    gait : TravellingWave
        Commanded contraction.
    forward, backward, lateral : float
        Kinetic friction against motion towards the head, towards the tail and sideways.
    static_ratio : float
        Static over kinetic friction.
    gravity : float
        [m/s^2].
    """

    worm: Worm = field(default_factory=Worm)
    gait: TravellingWave = field(default_factory=TravellingWave)
    forward: float = 0.03
    backward: float = 0.20
    lateral: float = 0.20
    static_ratio: float = 1.2
    gravity: float = 9.81

    @classmethod
    def of(cls, segments: int) -> Task:
        """Return the task with the default worm of N segments."""
        return cls(worm=Worm(segments=segments))

    def contractions(self, times: ArrayLike) -> FloatArray:
        """Return the commanded contraction of each segment at `times`, shape (T,) [s], shape (T, N)."""
        moments = np.asarray(times, dtype=float)
        return self.gait.amplitude * np.array([self.gait.activation(t, self.worm.segments) for t in moments])

    @property
    def pitch(self) -> FloatArray:
        """Stiffness of the joints in pitch, shape (N-1,) [J]."""
        return np.asarray(self.worm.k_torsion)

    @property
    def yaw(self) -> FloatArray:
        """Stiffness of the joints in yaw, in series with the chambers' (k b^2/l0), shape (N-1,) [J].

        The rivals have no bend of the chambers as a coordinate of its own.
        """
        k = np.asarray(self.worm.k_spring)
        chambers = (k[1:] + k[:-1]) / 2.0 * self.worm.chamber_offset**2 / self.worm.l0
        stiffness: FloatArray = 1.0 / (1.0 / np.asarray(self.worm.k_yaw) + 1.0 / chambers)
        return stiffness

    @property
    def twist(self) -> FloatArray:
        """Stiffness of the joints in twist, shape (N-1,) [J]."""
        return np.asarray(self.worm.k_twist)


def steps_of(duration: float, dt: float) -> int:
    """Return the number of equal steps of at most dt in `duration`."""
    return max(1, int(np.ceil(duration / dt - 1e-9)))
