"""What can be seen of a worm at one instant, without error; sensors make measurements of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

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
    joints, joint_velocity : ndarray, shape (N+1, 3)
        [m], [m/s]
    apexes, apex_velocity : ndarray, shape (N, 6, 3)
        In the order of NOTATION.md [m], [m/s].
    contraction : ndarray, shape (N, 2)
        What the actuators have reached.
    normal_load : ndarray, shape (N, 6)
        Of each apex in the order of NOTATION.md [N].
    actuator_states : mapping of str to ndarray
        States of the actuators by name, such as a pressure; those of chambers of shape (N, 2), of hinges (N-1,).
    """

    time: float
    chamber_strain: FloatArray
    com: FloatArray
    com_velocity: FloatArray
    heading: float
    joints: FloatArray
    joint_velocity: FloatArray
    apexes: FloatArray
    apex_velocity: FloatArray
    contraction: FloatArray
    normal_load: FloatArray
    actuator_states: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def angular_velocity(self) -> FloatArray:
        """Angular velocity w of each segment in its own axes t forward, d left and u up, shape (N, 3) [rad/s].

        From t' = w x t and u' = w x u follow w.t = -u'.d, w.d = -t'.u, w.u = t'.d; the axes are those of the edge
        between the joints, of the outward apexes from right to left, and of the apexes from below to above.
        """
        edge, edge_rate = np.diff(self.joints, axis=0), np.diff(self.joint_velocity, axis=0)
        rise, rise_rate = (p[:, 1] - p[:, 0] + p[:, 4] - p[:, 3] for p in (self.apexes, self.apex_velocity))
        across = self.apexes[:, 2] - self.apexes[:, 5]
        length, width, height = (np.sqrt((each**2).sum(axis=1)) for each in (edge, across, rise))
        d, u = across / width[:, None], rise / height[:, None]
        forward, left, up = (rise_rate * d).sum(axis=1), (edge_rate * u).sum(axis=1), (edge_rate * d).sum(axis=1)
        return np.column_stack([-forward / height, -left / length, up / length])
