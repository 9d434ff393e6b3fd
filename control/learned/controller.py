"""The learned controller: a policy decides the wave from what `Senses` sees, without an estimator."""

from __future__ import annotations

from collections.abc import Mapping
from math import tau
from pathlib import Path
from typing import Self

from control.estimation.estimate import Estimate
from control.gaits.steering import GaitParameters, Mechanism
from control.identification.identified import Identified
from control.learned.acts import ACTS
from control.learned.policy import SHIPPED, Policy
from control.learned.senses import Senses
from control.loop import Choice, WaveController, rest
from control.sensing.sensors import Channel, Measurement
from control.tracking.references import Reference
from worm3d import Worm

STANDS = "the reference asks for less speed than the worm can crawl at: it rests"


class LearnedPolicy(WaveController):
    """A controller that was trained by reinforcement (`worm3d learn`); it needs numpy only.

    Parameters
    ----------
    worm, reference, control_period
        See `control.loop.WaveController`.
    identified : Identified
        Its schedule and, as far as the policy's actions need it, its map.
    mechanism : str
        What steers.
    policy : Policy, optional
        The one that comes with the program if left out.

    Raises
    ------
    ValueError
        A period that is not above 0, a mechanism that was not identified, or a file that holds no policy.
    """

    file: Path = SHIPPED
    """Where the policy is read from; a subclass with another one is a controller of its own."""

    def __init__(
        self,
        worm: Worm,
        identified: Identified,
        reference: Reference,
        mechanism: Mechanism = "hinge",
        control_period: float = 0.2,
        policy: Policy | None = None,
    ) -> None:
        if mechanism not in identified.maps:
            known = ", ".join(map(repr, identified.maps))
            raise ValueError(f"mechanism: got {mechanism!r}, must be one of those identified: {known}")
        self.policy, self.mechanism = Policy.load(self.file) if policy is None else policy, mechanism
        found = identified.maps[mechanism]
        self._act = ACTS[self.policy.acts](found, mechanism, worm.length)
        self._sight = _Sight(Senses(worm, reference, self._act.size, self.policy.channels))
        super().__init__(worm, reference, identified.schedule, self._act.feed_forward, control_period, self._sight)

    @classmethod
    def of(
        cls,
        worm: Worm,
        reference: Reference,
        identified: Identified,
        mechanism: Mechanism = "hinge",
        control_period: float = 0.2,
        sensors: Mapping[str, Channel] | None = None,
    ) -> Self:
        """Return the controller of a worm that was identified; see `WaveController.of`."""
        return cls(worm, identified, reference, mechanism, control_period)

    def _choose(self, t: float, estimate: Estimate | None) -> Choice:
        senses = self._sight.senses
        seen = senses.observed(t)
        action = self.policy(seen)
        senses.acted(action, self.generator.waves)
        if float(self.reference.speed(t)) < self._act.feed_forward.slowest:
            return Choice("own", rest(self._target), STANDS)
        return Choice("own", self._act(action, seen), "")


class _Sight:
    """Senses in the place of an estimator, which hand on no estimate."""

    def __init__(self, senses: Senses) -> None:
        self.senses = senses

    def reset(self) -> None:
        self.senses.reset()

    def take(self, t: float, measurement: Measurement, parameters: GaitParameters, phase: float) -> None:
        self.senses.take(t, measurement, phase / tau, parameters.frequency)

    def estimate(self, _: float) -> None:
        return None
