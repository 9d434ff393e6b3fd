"""Controllers whose worm also bends along its path, beside the wave that layer 1, the supervisor, decides.

A stiff body has its centre of mass on a curved path, and its ends outside. `Bending` bends it as the path bends under
it, at both ends (the middle bent as well rolls it over its inner feet); that needs no more time than layer 1. In
`ChamberMPC` this posture is the one towards which a plan of chambers and hinges is pulled, `control.chambers.mpc`.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np

from control.chambers.model import ChamberModel
from control.chambers.mpc import BodyMPC, BodyPlan, wanted_of
from control.chambers.wave import BodyWave
from control.estimation.estimate import Estimate
from control.estimation.estimator import Estimator
from control.loop import Choice
from control.sensing.sensors import Measurement
from control.supervisor import Supervisor
from control.tracking.paths import Path
from control.tracking.references import Reference
from worm3d import Command, Worm
from worm3d.values.arrays import FloatArray

STEEPNESS = 1.5
"""Share of the path's bend that a joint takes at either end of the body, before it is cut to 1; 0 in the middle."""
SHORTER = 0.86
"""Length of a crawling body over that at rest: amplitude 0.3 shortens it by 0.3 sin on half of its length."""
_LOG = logging.getLogger(__name__)


def along_path(worm: Worm, path: Path, progress: float) -> FloatArray:
    """Return the hinges that bend a worm as its path bends under it, less in the middle [rad], shape (N - 1,).

    Its centre of mass is at the arc length `progress` [m] of the path.
    """
    n = worm.segments
    middles = progress + (np.arange(n) + 0.5 - n / 2.0) * worm.l0
    shares = np.minimum(1.0, STEEPNESS * np.abs(2.0 * np.arange(1, n) / n - 1.0))
    return np.asarray(shares * np.diff(path.heading(middles)))


class Bending(Supervisor):
    """The supervisor of a worm that also bends along its path; without a path it is the supervisor.

    Parameters are those of `control.supervisor.Supervisor`.
    """

    generator: BodyWave

    def __init__(self, worm: Worm, reference: Reference, *rest: Any, **named: Any) -> None:
        super().__init__(worm, reference, *rest, **named)
        self.generator = BodyWave(self.generator, self.planner.feed_forward.found, worm)

    def reset(self) -> None:
        """Begin anew."""
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
        """Return what chambers and hinges do beside the wave from time t [s] on, shape (3 N - 1,)."""
        if np.isfinite(estimate.position).all():
            self._near = float(path.project(estimate.position, self._near))
        posture = along_path(self.worm, path, self._near or 0.0)
        return np.concatenate([np.zeros(2 * self.worm.segments), posture])


class ChamberMPC(Bending):
    """`Bending` whose chambers and hinges are planned within the wave, by a model of how feet stand and slip.

    Whatever goes wrong with such a plan leaves the posture. `body_plans` are those of the run.
    """

    def __init__(self, worm: Worm, reference: Reference, *rest: Any, **named: Any) -> None:
        self.body = BodyMPC(worm, ChamberModel.of(worm))
        super().__init__(worm, reference, *rest, **named)

    def reset(self) -> None:
        """Begin anew."""
        super().reset()
        self.body.forget()
        self.body_plans: list[BodyPlan] = []
        self._strain = np.zeros((self.worm.segments, 2))
        self._hinge = np.zeros(self.worm.segments - 1)

    def step(self, t: float, measurement: Measurement) -> Command:
        """Return the command from time t [s] on."""
        elapsed = 0.0 if self._time is None else t - self._time
        if isinstance(measurement, Measurement) and measurement.strain is not None:
            known = np.isfinite(measurement.strain)
            self._strain = np.where(known, measurement.strain, self._strain)
        command = super().step(t, measurement)
        share = 1.0 - np.exp(-elapsed / self.worm.actuator_lag) if self.worm.actuator_lag > 0.0 else 1.0
        self._hinge = self._hinge + share * (command.hinge - self._hinge)
        return command

    def _beyond(self, t: float, path: Path, estimate: Estimate, choice: Choice) -> FloatArray:
        posture = super()._beyond(t, path, estimate, choice)
        if choice.source != "mpc":
            return posture
        try:
            plan = self._planned(t, path, estimate)
        except Exception as error:
            _LOG.warning("no plan of the body at %.3f s", t, exc_info=error)
            return posture
        self.body_plans.append(plan)
        return plan.at(t) if plan.ok else posture

    def _planned(self, t: float, path: Path, estimate: Estimate) -> BodyPlan:
        body, worm, speed = self.body, self.worm, estimate.speed
        lengths, heading = worm.l0 * (1.0 + self._strain), estimate.heading
        motion = speed * np.cos(heading), speed * np.sin(heading), estimate.turn_rate
        state = np.array([*estimate.position, heading, *motion, *lengths.T.ravel(), *self._hinge, 0.0, 0.0])
        progress, ends = self._near or 0.0, body.step * np.arange(1.0, body.steps + 1.0)
        wanted = wanted_of(path, np.asarray(progress + speed * ends), SHORTER * worm.length / 2.0)
        later = body.block * (np.arange(body.blocks) + 0.5)
        postures = np.array([along_path(worm, path, progress + speed * s) for s in later])
        return body.plan(t, state, self.generator.ahead(np.asarray(ends - body.step / 2.0)), wanted, postures)
