"""The learned controller: a policy chooses the wave from an observation, without an estimator."""

from __future__ import annotations

from pathlib import Path

from control.estimation.estimate import Estimate
from control.learned.acts import ACTS
from control.learned.policy import SHIPPED_POLICY, Policy
from control.learned.senses import Senses
from control.loop import Choice, WaveController, rest
from control.task import ControlTask

STANDS = "the reference asks for less speed than the worm can crawl at: it rests"


class LearnedPolicy(WaveController):
    """A controller trained by reinforcement learning (`worm3d learn`), which needs numpy only.

    Parameters
    ----------
    task : ControlTask
        Task of the controller. Its map is used if the policy's actions need a map.
    policy : Policy, optional
        By default the supplied policy.

    Raises
    ------
    ValueError
        The file does not contain a policy.
    """

    file: Path = SHIPPED_POLICY
    """File of the policy. A subclass with another file is another controller."""

    def __init__(self, task: ControlTask, policy: Policy | None = None) -> None:
        self.policy = Policy.load(self.file) if policy is None else policy
        self._act = ACTS[self.policy.acts](task.found, task.mechanism, task.worm.length)
        self._senses = Senses(task.worm, task.reference, self._act.size, self.policy.channels)
        super().__init__(task, self._act.feed_forward, self._senses)

    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        seen = self._senses.observed(t)
        action = self.policy(seen)
        self._senses.acted(action, self.generator.waves)
        if float(self.reference.speed(t)) < self._act.feed_forward.slowest:
            return Choice("own", rest(self._target), STANDS)
        return Choice("own", self._act(action, seen), "")
