"""Commands from a record over time, such as the pressures of the valves of a robot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from control.gaits.gait import BoundGait
from worm3d import Commands, Worm
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.spelling import Spelled

QUANTITIES = ("contraction", "pressure", "cable")
"""Quantities that a record may contain."""


@dataclass(frozen=True, eq=False)
class RecordedCommands(Spelled):
    """Commands to the chambers from a record, as the actuation of a worm. The hinges stay straight.

    Between two instants the recorded quantity is interpolated linearly. A pressure or the force of a cable is then
    converted to a contraction by the table of the segment law. Before the first and after the last instant the command
    is constant.

    Raises
    ------
    ValueError
        An array has a wrong shape, a value is not finite, the times do not ascend, or the quantity is unknown.
    """

    time: FloatArray
    """Instants, shape (K,) [s]."""
    value: FloatArray
    """Values of the chambers [left, right], shape (K, N, 2). Both chambers of all segments: shape (K,)."""
    quantity: str = "contraction"
    """Recorded quantity: "contraction", "pressure" [Pa] or "cable" [N]."""

    def __post_init__(self) -> None:
        arguments.choice("quantity", self.quantity, QUANTITIES)
        time, given = arguments.array("time", self.time, ("K",), least=2), arguments.floats("value", self.value)
        if (late := np.diff(time) <= 0.0).any():
            k = int(np.argmax(late))
            raise ValueError(f"time: got {time[k + 1]:g} s after {time[k]:g} s, must ascend")
        value = arguments.array("value", given if given.ndim == 3 else given[:, None, None], (len(time), "N", "C"))
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "value", value)

    def bind(self, worm: Worm) -> BoundGait:
        """Return the actuation of `worm`: time [s] -> `worm3d.Command`.

        Raises
        ------
        ValueError
            The record has other segments or chambers, the segment law does not know the recorded inputs, or a
            contraction is beyond the stroke.
        """
        segments, chambers = self.value.shape[1:]
        if segments not in (1, worm.segments) or chambers not in (1, 2):
            raise ValueError(
                f"value: got {segments} segments and {chambers} chambers, must be the {worm.segments} segments of the "
                "worm and 2 chambers, or 1 for all"
            )
        given, (least, most) = self._contraction(self.value, worm), worm.stroke
        if given.min() < least or given.max() > most:
            raise ValueError(
                f"value: got contractions from {given.min():.4g} to {given.max():.4g}, must be from {least:.4g} to "
                f"{most:.4g}, the worm's stroke"
            )
        return BoundGait(partial(self._commands, worm=worm), lambda dt: None)

    def _commands(self, times: FloatArray, worm: Worm) -> Commands:
        later = np.clip(np.searchsorted(self.time, times), 1, len(self.time) - 1)
        begin, end = self.time[later - 1], self.time[later]
        share = np.clip((times - begin) / (end - begin), 0.0, 1.0)[:, None, None]
        now = self.value[later - 1] * (1.0 - share) + self.value[later] * share
        contraction = np.broadcast_to(self._contraction(now, worm), (len(times), worm.segments, 2))
        return Commands(contraction, np.zeros((len(times), worm.segments - 1)), np.zeros_like(contraction))

    def _contraction(self, value: FloatArray, worm: Any) -> FloatArray:
        return value if self.quantity == "contraction" else worm.segment.contraction_of(value, self.quantity)
