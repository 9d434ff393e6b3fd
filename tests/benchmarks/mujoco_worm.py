"""MuJoCo on the task: an extensible chain with feet that move out as their segment shortens (`mujoco_model`).

Real-time factors at 1 % error for 6 and 20 segments (MuJoCo 4.0.0, AMD EPYC, one core). The
integrator `discrete`, which takes stiffness, damping and constraints implicitly, allows the largest steps; with
elliptic cones the distance converges smoothly; Newton needs a fourth of the time of CG.

| settings | N = 6 | N = 20 |
|---|---|---|
| discrete, Newton, elliptic, sparse, 6 segments a tree | 211 | 26 |
| implicitfast | 62 | 0.6, in one tree; several are unstable |
| Euler | 65 | several trees are unstable |
| CG | 51 | 5.7 |
| pyramidal | 72 | 17 |
| dense | 181 | 6.1 |
| one tree | 209 | 17 |
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from mujoco_model import mjcf
from rivals import Rival, Task

from worm3d.values.arrays import FloatArray

STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
UNSTABLE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


class MuJoCoWorm(Rival):
    """The worm in MuJoCo.

    Parameters
    ----------
    per_tree : int, optional
        Greatest number of segments in a kinematic tree; the fastest for the number of segments if left out.
    """

    name = f"MuJoCo {mujoco.__version__}"
    cannot = (
        "friction that differs forward and backward: it has the backward coefficient both ways, so that on bristles "
        "the worm crawls only by the load on its anchors",
        "static above kinetic friction",
        "exact sticking and rigid contact: both are springs, so that loaded anchors creep and sink in",
        "links of the rhombus: the feet move on its secant, tied by a constraint that is a spring, too",
        "a spring that stiffens as its rest length is commanded shorter",
    )

    def __init__(self, per_tree: int = 0) -> None:
        self.given = per_tree

    def settings(self, segments: int) -> str:
        """Return the configuration it runs in, in words."""
        return f"discrete, Newton, elliptic, sparse, {self.per_tree(segments)} segments a tree"

    def per_tree(self, segments: int) -> int:
        """Return the greatest number of segments in a tree."""
        return self.given or (6 if segments <= 20 else 3)

    def prepare(self, task: Task, duration: float, steps: int) -> Callable[[], float]:
        """Return a simulation, ready to go: called once, it returns the distance along x [m]."""
        dt = duration / steps
        model = mujoco.MjModel.from_xml_string(mjcf(task, dt, self.per_tree(task.worm.segments)))
        data = mujoco.MjData(model)
        times = (np.arange(steps) + 0.5) * dt
        controls = -task.worm.l0 * task.contractions(times)
        start = _centre_of_mass(model, data)
        initial = np.empty(mujoco.mj_stateSize(model, STATE))
        mujoco.mj_getState(model, data, initial, STATE)

        def go() -> float:
            with _without_log():
                _roll(model, data, initial, controls)
            failed = any(data.warning[warning].number for warning in UNSTABLE)
            return float("nan") if failed else _centre_of_mass(model, data) - start

        return go


def _roll(model: mujoco.MjModel, data: mujoco.MjData, initial: FloatArray, controls: FloatArray) -> None:
    """Step through all controls, shape (T, N), in C."""
    with Rollout(nthread=0) as rollout:
        rollout.rollout(
            [model], [data], initial[None], np.ascontiguousarray(controls)[None], skip_checks=True, nstep=len(controls)
        )


@contextmanager
def _without_log() -> Iterator[None]:
    """Keep MuJoCo from writing MUJOCO_LOG.TXT to the working directory when a run is unstable."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _centre_of_mass(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Return x of the centre of mass [m]."""
    mujoco.mj_kinematics(model, data)
    return float(model.body_mass @ data.xipos[:, 0] / model.body_mass.sum())
