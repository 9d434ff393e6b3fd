"""What can be seen of a worm at one instant, without error; sensors make measurements of it."""

from __future__ import annotations

from dataclasses import dataclass

from worm3d.values.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Observation:
    """The true state of a worm of N segments, as far as robots can hope to measure it.

    Attributes
    ----------
    time : float
        [s]
    chamber_strain : ndarray, shape (N, 2)
        l_c/l0 - 1 of each chamber [left, right].
    com, com_velocity : ndarray, shape (3,)
        Centre of mass [m], [m/s].
    heading : float
        Azimuth of the tail-to-head chord in (-pi, pi] [rad].
    joints : ndarray, shape (N+1, 3)
        [m]
    contraction : ndarray, shape (N, 2)
        What the actuators have reached.
    normal_load : ndarray, shape (N, 6)
        Of each apex in the order of the conventions [N].
    """

    time: float
    chamber_strain: FloatArray
    com: FloatArray
    com_velocity: FloatArray
    heading: float
    joints: FloatArray
    contraction: FloatArray
    normal_load: FloatArray
