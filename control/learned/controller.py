"""The learned controller: a policy decides the wave from the observation of `Senses`, without an estimator."""

from __future__ import annotations

from math import tau
from pathlib import Path

from control.estimation.estimate import Estimate
from control.gaits.steering import GaitParameters
from control.learned.acts import ACTS
from control.learned.policy import SHIPPED_POLICY, Policy
from control.learned.senses import Senses
from control.loop import Choice, WaveController, rest
from control.sensing.sensors import Measurement
from control.task import ControlTask

STANDS = "the reference asks for less speed than the worm can crawl at: it rests"


class LearnedPolicy(WaveController):
    """A controller trained by reinforcement learning (`worm3d learn`), which needs numpy only.

    Parameters
    ----------
    task : ControlTask
        Task; the controller uses the task's map if the policy's actions need the map.
    policy : Policy, optional
        By default the policy that comes with the program.

    Raises
    ------
    ValueError
        A file that holds no policy.
    """

    file: Path = SHIPPED_POLICY
    """File of the policy; a subclass with another file is a separate controller."""

    def __init__(self, task: ControlTask, policy: Policy | None = None) -> None:
        self.policy = Policy.load(self.file) if policy is None else policy
        self._act = ACTS[self.policy.acts](task.found, task.mechanism, task.worm.length)
        self._sight = _Sight(Senses(task.worm, task.reference, self._act.size, self.policy.channels))
        super().__init__(task, self._act.feed_forward, self._sight)

    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        senses = self._sight.senses
        seen = senses.observed(t)
        action = self.policy(seen)
        senses.acted(action, self.generator.waves)
        if float(self.reference.speed(t)) < self._act.feed_forward.slowest:
            return Choice("own", rest(self._target), STANDS)
        return Choice("own", self._act(action, seen), "")


class _Sight:
    """Senses in place of an estimator, which return no estimate."""

    def __init__(self, senses: Senses) -> None:
        self.senses = senses

    def reset(self) -> None:
        self.senses.reset()

    def take(self, t: float, measurement: Measurement, parameters: GaitParameters, phase: float) -> None:
        self.senses.take(t, measurement, phase / tau, parameters.frequency)

    def estimate(self, _: float) -> None:
        return None
