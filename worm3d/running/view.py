"""What is seen of a run while it goes on: an `Observation` by sensors, a `View` by observers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from worm3d.physics.hysteresis import chamber_states
from worm3d.recorded.series import Recorded, heading, series_of
from worm3d.recorded.status import Status
from worm3d.values.arrays import FloatArray
from worm3d.values.documented import with_fields
from worm3d.values.read_only import read_only

if TYPE_CHECKING:
    from worm3d.recorded.state import State
    from worm3d.results.result import Result
    from worm3d.running.plant import Plant
    from worm3d.running.run import Run


@with_fields
@dataclass(frozen=True, eq=False)
class Observation:
    """True state of a worm of N segments, as far as robots can hope to measure it: what sensors are given."""

    time: float
    """Time [s]."""
    chamber_strain: FloatArray
    """Strain l_c/l0 - 1 of each chamber [left, right], shape (N, 2)."""
    com: FloatArray
    """Centre of mass, shape (3,) [m]."""
    com_velocity: FloatArray
    """Velocity of the centre of mass, shape (3,) [m/s]."""
    heading: float
    """Azimuth of the tail-to-head chord in (-pi, pi] [rad]."""
    joints: FloatArray
    """Joints, shape (N+1, 3) [m]."""
    joint_velocity: FloatArray
    """Velocity of the joints, shape (N+1, 3) [m/s]."""
    apexes: FloatArray
    """Apexes in the order of NOTATION.md, shape (N, 6, 3) [m]."""
    apex_velocity: FloatArray
    """Velocity of the apexes, shape (N, 6, 3) [m/s]."""
    contraction: FloatArray
    """Contraction that the actuators have reached, shape (N, 2)."""
    normal_load: FloatArray
    """Normal load of each apex, shape (N, 6) [N]."""
    actuator_states: Mapping[str, FloatArray] = field(default_factory=dict)
    """States of the actuators by name, such as a pressure; those of chambers of shape (N, 2), of hinges (N-1,)."""

    @classmethod
    def of(cls, plant: Plant, time: float) -> Observation:
        """Return what sensors see of a worm at a time, read straight from the solver: it is asked for at every step."""
        from worm3d.solver.arrays import POINTS  # imports CasADi, which sensors do without
        from worm3d.solver.records import mass_centre

        arrays, n, worm = plant.arrays, plant.n, plant.worm
        momentum, com = mass_centre(plant.core)
        joints = arrays["joints"][:3, : n + 1].T.copy()
        apexes, apex_velocity = (
            arrays[name][:3].reshape(3, POINTS, -1)[:, :6, :n].T.copy() for name in ("points", "point_velocity")
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
            normal_load=plant.loads()[:6].T.copy(),
            actuator_states=states,
        )

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


SEEN = (*series_of(Recorded), "apexes", "end_load", "chamber_strain")
"""Names of attributes of `Recorded` that a view has, of one instant."""


class View:
    """A run at one instant, for an observer; read-only, and read out only as far as it is asked for.

    Each recorded series of `worm3d.Result` is an attribute, without its first dimension: `view.joints` has the shape
    (N+1, 3), `view.com` (3,), `view.heading` (). Slip counts since the last row of the result before this instant.
    `step` and `steps` are the finished steps and those of the whole run, `worm` and `world` what is simulated.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._series: Recorded | None = None
        self.step, self.steps, self.worm, self.world = run.done, run.steps, run.plant.worm, run.plant.world

    def __getattr__(self, name: str) -> FloatArray:
        if name not in SEEN:
            raise AttributeError(f"a view of a run has no {name!r}; it has {', '.join(dir(self))}")
        now: FloatArray = getattr(self._recorded, name)[0].copy()
        found: FloatArray = read_only(now)
        return found

    def __dir__(self) -> list[str]:
        return sorted({*SEEN, "actuator_states", "observation", "result", "state", "step", "steps", "world", "worm"})

    def __repr__(self) -> str:
        return f"View of step {self.step} of {self.steps}: {', '.join(dir(self))}"

    @property
    def _recorded(self) -> Recorded:
        run = self._current
        if self._series is None:
            self._series = run.recorded_now()
        return self._series

    @property
    def _current(self) -> Run:
        if self._run.done != self.step:
            raise ValueError(
                f"view: got one of step {self.step} when the run is at step {self._run.done}, must be read before the "
                "observer returns; keep the arrays, not the view"
            )
        return self._run

    @property
    def actuator_states(self) -> Mapping[str, FloatArray]:
        """States of the actuators by name; those of chambers of shape (N, 2), of hinges (N-1,)."""
        return {name: array[0].copy() for name, array in self._recorded.actuator_states.items()}

    def state(self) -> State:
        """Return the state, with memory: a run from it goes on bit for bit."""
        return self._current.state()

    def result(self) -> Result:
        """Return the run so far, up to the last recorded instant."""
        return self._current.result(Status.DONE)

    def observation(self) -> Observation:
        """Return what sensors see."""
        return self._current.observation()
