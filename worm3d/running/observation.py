"""The true state of a worm. Sensors compute measurements from this state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from worm3d.physics.hysteresis import chamber_states
from worm3d.recorded.series import heading
from worm3d.values.arrays import FloatArray
from worm3d.values.documented import with_fields

if TYPE_CHECKING:
    from worm3d.running.plant import Plant


@with_fields
@dataclass(frozen=True, eq=False)
class Observation:
    """The true state of a worm of N segments. Sensors compute measurements from this state.

    It has only quantities that a real robot might measure.
    """

    time: float
    """Time [s]."""
    chamber_strain: FloatArray
    """Strain l_c/l0 - 1 of each chamber, where l_c is its length, columns left and right, shape (N, 2)."""
    com: FloatArray
    """Centre of mass, shape (3,) [m]."""
    com_velocity: FloatArray
    """Velocity of the centre of mass, shape (3,) [m/s]."""
    heading: float
    """Azimuth of the line from tail to head, in (-pi, pi] [rad]."""
    joints: FloatArray
    """Positions of the joints, shape (N+1, 3) [m]."""
    joint_velocity: FloatArray
    """Velocity of the joints, shape (N+1, 3) [m/s]."""
    apexes: FloatArray
    """Positions of the apexes in the order of NOTATION.md, shape (N, 6, 3) [m]."""
    apex_velocity: FloatArray
    """Velocity of the apexes, shape (N, 6, 3) [m/s]."""
    contraction: FloatArray
    """Contraction that the actuators have reached, columns left and right, shape (N, 2)."""
    normal_load: FloatArray
    """Normal load of each apex, shape (N, 6) [N]."""
    actuator_states: Mapping[str, FloatArray] = field(default_factory=dict)
    """States of the actuators by name, for example a pressure, shape (N, 2) for chambers or (N-1,) for hinges."""

    @classmethod
    def of(cls, plant: Plant, time: float) -> Observation:
        """Return the observation of a worm at a time.

        The values are read directly from the arrays of the solver, because a controller needs them in every step.
        """
        from worm3d.physics.kernels.segment import POINTS_PER_SEGMENT  # imports CasADi, which sensors do not need
        from worm3d.solver.records import mass_centre

        arrays, n, worm = plant.arrays, plant.n, plant.worm
        momentum, com = mass_centre(plant.core)
        joints = arrays["joints"][:3, : n + 1].T.copy()
        apexes, apex_velocity = (
            arrays[name][:3].reshape(3, POINTS_PER_SEGMENT, -1)[:, :6, :n].T.copy()
            for name in ("points", "point_velocity")
        )
        states = {
            name: arrays["actuator"][2 * k : 2 * k + 2, :n].T.copy()
            for k, name in enumerate(chamber_states(type(worm.actuator), type(worm.hysteresis)))
        }
        for k, name in enumerate(type(worm.hinge_actuator).states):
            states[f"hinge_{name}"] = arrays["hinge_states"][k, : n - 1].copy()
        return cls(
            time=time,
            chamber_strain=arrays["lengths"][:2, :n].T / worm.l0 - 1.0,
            com=com,
            com_velocity=momentum[:3] / worm.mass,
            heading=float(heading(joints[None])[0]),
            joints=joints,
            joint_velocity=arrays["joint_velocity"][:3, : n + 1].T.copy(),
            apexes=apexes,
            apex_velocity=apex_velocity,
            contraction=arrays["given"][0, : 2 * n].reshape(n, 2).copy(),
            normal_load=plant.normal_loads()[:6].T.copy(),
            actuator_states=states,
        )

    @property
    def angular_velocity(self) -> FloatArray:
        """Angular velocity w of each segment along the axes t, d and u of the segment, shape (N, 3) [rad/s].

        The axis t (forward) lies along the line between the joints, d (left) points from the right to the left outward
        apex, and u (up) points from the lower to the upper apexes. From t' = w x t and u' = w x u follow w.t = -u'.d,
        w.d = -t'.u and w.u = t'.d.
        """
        edge, edge_rate = np.diff(self.joints, axis=0), np.diff(self.joint_velocity, axis=0)
        rise, rise_rate = (p[:, 1] - p[:, 0] + p[:, 4] - p[:, 3] for p in (self.apexes, self.apex_velocity))
        across = self.apexes[:, 2] - self.apexes[:, 5]
        length, width, height = (np.sqrt((each**2).sum(axis=1)) for each in (edge, across, rise))
        d, u = across / width[:, None], rise / height[:, None]
        forward, left, up = (rise_rate * d).sum(axis=1), (edge_rate * u).sum(axis=1), (edge_rate * d).sum(axis=1)
        return np.column_stack([-forward / height, -left / length, up / length])
