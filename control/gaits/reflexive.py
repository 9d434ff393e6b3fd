"""A gait combined with reflexes (`control.gaits.reflexes`), which together are a controller that uses sensors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from control.gaits.feedback import Commanding, Feedback, Felt, commanding
from control.gaits.gait import Gait
from control.gaits.reflexes import Reflex
from worm3d import Command, Worm
from worm3d.values import arguments
from worm3d.values.spelling import Spelled


@dataclass(frozen=True)
class Reflexive(Spelled):
    """A gait whose contractions reflexes change, one after the other, before they are clipped to the stroke.

    Hinges and forces are those of the gait. If no reflex changes anything, the commands equal the gait's bit for bit.
    The memory of the reflexes is not part of a `worm3d.State`. In a run that continues from a state, the reflexes start
    again from their initial state.

    Raises
    ------
    ValueError
        `gait` is not a gait, or an entry of `reflexes` is not a reflex.
    """

    gait: Gait
    """Any gait, with or without memory and senses."""
    reflexes: tuple[Reflex, ...]
    """Reflexes, in order of their action."""

    def __post_init__(self) -> None:
        arguments.instance("gait", self.gait, Gait, "a control.gaits.Gait such as control.gaits.TravellingWave()")
        arguments.instance("reflexes", self.reflexes, Iterable, "several in a tuple, such as (WallLoad(),)")
        object.__setattr__(self, "reflexes", tuple(self.reflexes))
        for each in self.reflexes:
            arguments.instance("reflexes", each, Reflex, "control.gaits.reflexes such as (WallLoad(),)")

    @property
    def period(self) -> float | None:
        """Period of the gait [s]. None if the gait has no period."""
        period: float | None = getattr(self.gait, "period", getattr(self.gait, "T_wave", None))
        return period

    def require_steps(self, dt: float) -> None:
        """Raise ValueError for time steps [s] that are too long for the gait."""
        self.gait.require_steps(dt)

    @property
    def senses(self) -> tuple[str, ...]:
        """Names of the channels of `control.sensing.QUANTITIES` that the gait and the reflexes use."""
        of_gait: tuple[str, ...] = getattr(self.gait, "senses", ())
        return tuple(dict.fromkeys((*of_gait, *(name for each in self.reflexes for name in each.senses))))

    def bind(self, worm: Worm) -> Feedback:
        """Return the actuation of `worm`, a controller."""
        return Feedback(worm, self.senses, partial(self._begun, worm))

    def _begun(self, worm: Worm) -> Commanding:
        """Return the `Commanding` of one run."""
        command, memories = commanding(self.gait, worm), [each.start(worm) for each in self.reflexes]

        def reflexed(t: float, felt: Felt) -> Command:
            given = command(t, felt)
            contraction = given.contraction
            for memory in memories:
                contraction = memory.step(t, contraction, felt)
            return Command(np.clip(contraction, *worm.stroke), given.hinge, given.force)

        return reflexed
