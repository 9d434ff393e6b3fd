"""A controller that also bends the worm along its path, beside the wave of the supervisor.

A stiff body has its centre of mass on a curved path, and both ends outside. `Bending` bends both ends of the body like
the path below (bending the middle as well rolls the worm over the inner feet), and needs no more time than the
supervisor.

The supervisor decides the wave itself; `control/README.md` describes the possible gain from planning chambers and
hinges within the wave.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from control.chambers.wave import BodyWave
from control.estimation.estimate import Estimate
from control.estimation.estimator import Estimator
from control.loop import Choice
from control.supervisor import Supervisor
from control.task import ControlTask
from control.tracking.paths import Path
from worm3d import Worm
from worm3d.values.arrays import FloatArray

STEEPNESS = 1.5
"""Share of the path's bend in a joint at either end of the body, before clipping to 1; 0 in the middle."""


def along_path(worm: Worm, path: Path, progress: float) -> FloatArray:
    """Return the hinges that bend a worm like the path below, less in the middle [rad], shape (N - 1,).

    The centre of mass is at the arc length `progress` [m] of the path.
    """
    n = worm.segments
    middles = progress + (np.arange(n) + 0.5 - n / 2.0) * worm.l0
    shares = np.minimum(1.0, STEEPNESS * np.abs(2.0 * np.arange(1, n) / n - 1.0))
    return np.asarray(shares * np.diff(path.heading(middles)))


class Bending(Supervisor):
    """A supervisor that also bends the worm along its path; without a path, the plain supervisor.

    The parameters are the same as for `control.supervisor.Supervisor`.
    """

    generator: BodyWave

    def __init__(self, task: ControlTask, *rest: Any, **named: Any) -> None:
        super().__init__(task, *rest, **named)
        self.generator = BodyWave(self.generator, self.feed_forward.found, task.worm)

    def reset(self) -> None:
        """Reset to the initial state."""
        super().reset()
        self._near: float | None = None

    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        choice = super()._choose(t, estimate)
        path, beyond = self.reference.path, np.zeros(3 * self.worm.segments - 1)
        if path is not None and estimate is not None and choice.source != "stop":
            beyond = self._beyond(t, path, estimate, choice)
        self.generator.beyond = beyond
        if isinstance(self.estimator, Estimator):
            self.estimator.crabs(self.generator.crab)
        return choice

    def _beyond(self, t: float, path: Path, estimate: Estimate, choice: Choice) -> FloatArray:
        """Return the commands of chambers and hinges beside the wave from time t [s] on, shape (3 N - 1,)."""
        if np.isfinite(estimate.position).all():
            self._near = float(path.project(estimate.position, self._near))
        posture = along_path(self.worm, path, self._near or 0.0)
        return np.concatenate([np.zeros(2 * self.worm.segments), posture])
