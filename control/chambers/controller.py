"""A controller that bends the worm along its path, in addition to the wave of the supervisor.

If a straight body has its centre of mass on a curved path, both of its ends are outside the curve. `Bending` therefore
bends both ends of the body like the path beneath them. The middle is bent less, since bending it makes the worm roll
over the inner feet. `Bending` needs no more time than the supervisor.

The wave itself is chosen by the supervisor. `.docs/evidence/controllers.md` describes what could be gained by
planning chambers and hinges within the wave.
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
"""Bend of a joint as a share of the path's bend. This is the share at the ends of the body, before it is limited to 1.
It decreases linearly to 0 in the middle."""


def along_path(worm: Worm, path: Path, progress: float) -> FloatArray:
    """Return the hinge angles that bend a worm like the path beneath it, less in the middle, shape (N - 1,) [rad].

    The centre of mass is at the arc length `progress` of the path [m].
    """
    n = worm.segments
    middles = progress + (np.arange(n) + 0.5 - n / 2.0) * worm.l0
    shares = np.minimum(1.0, STEEPNESS * np.abs(2.0 * np.arange(1, n) / n - 1.0))
    return np.asarray(shares * np.diff(path.heading(middles)))


class Bending(Supervisor):
    """A supervisor that also bends the worm along its path. Without a path, it is the plain supervisor.

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
        """Return the additional commands to chambers and hinges from time t [s] on, shape (3 N - 1,)."""
        if np.isfinite(estimate.position).all():
            self._near = float(path.project(estimate.position, self._near))
        posture = along_path(self.worm, path, self._near or 0.0)
        return np.concatenate([np.zeros(2 * self.worm.segments), posture])
