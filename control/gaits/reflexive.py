"""Any gait with reflexes, `control.gaits.reflexes`: a controller that feels, made of a pattern and of parts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from control.gaits.feedback import Feedback, Felt, commanding
from control.gaits.gait import Gait
from control.gaits.reflexes import Reflex
from worm3d import Command, Worm
from worm3d.values import arguments
from worm3d.values.spelling import Spelled


@dataclass(frozen=True)
class Reflexive(Spelled):
    """A gait whose contractions reflexes change, one after the other, before they are clipped to the stroke.

    Its hinges and forces are the gait's. Where no reflex changes anything, so are its commands, bit for bit. The
    reflexes' memory is no part of a `worm3d.State`: in a run that goes on from one they begin anew.

    Raises
    ------
    ValueError
        There is no gait, or something among the reflexes that is none.
    """

    gait: Gait
    """Any gait, with memory and senses of its own or without."""
    reflexes: tuple[Reflex, ...]
    """Reflexes in the order in which they act."""

    def __post_init__(self) -> None:
        arguments.instance("gait", self.gait, Gait, "a control.gaits.Gait such as control.gaits.TravellingWave()")
        arguments.instance("reflexes", self.reflexes, Iterable, "several in a tuple, such as (WallLoad(),)")
        object.__setattr__(self, "reflexes", tuple(self.reflexes))
        for each in self.reflexes:
            arguments.instance("reflexes", each, Reflex, "control.gaits.reflexes such as (WallLoad(),)")

    @property
    def period(self) -> float | None:
        """Period of the gait [s]; None without one."""
        period: float | None = getattr(self.gait, "period", getattr(self.gait, "T_wave", None))
        return period

    def require_steps(self, dt: float) -> None:
        """Raise ValueError for time steps [s] that are too long for the gait."""
        self.gait.require_steps(dt)

    @property
    def senses(self) -> tuple[str, ...]:
        """Names of the channels of `control.sensing.QUANTITIES` that gait and reflexes sense."""
        of_gait: tuple[str, ...] = getattr(self.gait, "senses", ())
        return tuple(dict.fromkeys((*of_gait, *(name for each in self.reflexes for name in each.senses))))

    def bind(self, worm: Worm) -> Feedback:
        """Return the actuation of `worm`, a controller."""
        return Feedback(worm, self.senses, partial(_Reflexed, self, worm))


class _Reflexed:
    """Memory of one run."""

    def __init__(self, asked: Reflexive, worm: Worm) -> None:
        self._command, self._stroke = commanding(asked.gait, worm), worm.stroke
        self._memories = [each.start(worm) for each in asked.reflexes]

    def command(self, t: float, felt: Felt) -> Command:
        given = self._command(t, felt)
        contraction = given.contraction
        for memory in self._memories:
            contraction = memory.step(t, contraction, felt)
        return Command(np.clip(contraction, *self._stroke), given.hinge, given.force)
