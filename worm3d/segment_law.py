"""The law of one segment: the force that its ends need along a given way, without masses, weight and contact.

It is evaluated by the simulation's own kernels of a segment (springs, dampers, apex hinges, the friction of its
joints), step by step with implicit Euler: what a load frame measures is the segment that crawls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from worm3d.machine.codegen import Kernel
from worm3d.physics.actuators import FirstOrder
from worm3d.physics.hysteresis import PREFIX as FRICTION
from worm3d.physics.kernels import actuator, segment
from worm3d.plant import kernels
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly
from worm3d.worm import Worm

_HEAD = 5
"""Coordinate along x of the joint ahead."""

_OF_SEGMENT, _OF_ACTUATOR = segment.LEDGER_TERMS, actuator.LEDGER_TERMS


@dataclass(frozen=True, eq=False)
class Stretch(ReadOnly):
    """What a segment does along a way, at T instants; energies are those of the step that ends there, 0 at first."""

    length: FloatArray
    """Shape (T,) [m]."""
    force: FloatArray
    """Pull on the ends, positive where it would lengthen the segment, shape (T,) [N]."""
    elastic: FloatArray
    """Change of elastic energy, also of what the joints give, shape (T,) [J]."""
    viscous_loss: FloatArray
    """Loss to damping, shape (T,) [J]."""
    hysteresis_loss: FloatArray
    """Loss to friction in the joints, shape (T,) [J]."""


def stretch(worm: Worm, length: ArrayLike, time: ArrayLike) -> Stretch:
    """Move the ends of a worm's first segment along a line, both chambers alike, and return what that takes.

    The segment has rested at the first length, without stress in its joints; nothing is commanded.

    Parameters
    ----------
    worm : Worm
        Its actuator must be `FirstOrder`, which does nothing then.
    length : array_like, shape (T,)
        Distance of the joints, above 0 and below twice the length of the links [m].
    time : array_like, shape (T,)
        Ascending [s].

    Raises
    ------
    ValueError
        Arrays of other shapes, with less than two instants or with numbers out of range, or another actuator.
    """
    lengths, times = arguments.floats("length", length), arguments.floats("time", time)
    if lengths.ndim != 1 or len(lengths) < 2 or lengths.shape != times.shape:
        raise ValueError(f"length: got shape {lengths.shape}, must be (T,) as time, {times.shape}, with T at least 2")
    longest = 2.0 * float(worm.link_length[0])
    if not ((lengths > 0.0) & (lengths < longest)).all():
        raise ValueError(
            f"length: got {lengths.min():.6g} to {lengths.max():.6g} m, must be above 0 and below {longest:.6g} m, "
            "twice the length of the links"
        )
    if not ((np.diff(times) > 0.0).all() and np.isfinite(times).all()):
        raise ValueError("time: must be finite and ascend")
    if type(worm.actuator) is not FirstOrder:
        raise ValueError(f"actuator: got {type(worm.actuator).__name__}, must be FirstOrder")
    return _Frame(worm).along(lengths, times)


class _Frame:
    """A segment of a worm on the x axis, in arrays of its own."""

    def __init__(self, worm: Worm) -> None:
        self._kernels = kernels(own=type(worm.hysteresis))
        self._layout = actuator.chambers(FirstOrder, type(worm.hysteresis))
        self._rows = self._kernels["segment_gradient"].allocate(1)[0]
        self._out = {name: kernel.allocate(1)[1] for name, kernel in self._kernels.items() if name in _USED}
        known = {"link": worm.link_length, "k": worm.k_spring, "k_apex": worm.k_apex, "l0": worm.l0}
        known |= {"offset": worm.chamber_offset, "tau": worm.kelvin_voigt_time, actuator.PREFIX + actuator.HASTE: 1.0}
        known |= {actuator.PREFIX + FRICTION + name: value for name, value in worm.hysteresis.values().items()}
        known |= {"commanded": worm.l0, "commanded_n": worm.l0}
        self._at = {name: self._layout.of(name, self._rows)[:, 0] for name in self._layout.sizes}
        for name, value in known.items():
            self._at[name][:] = np.ravel(value)[0]
        self._at["t_ref"][0] = self._at["d_ref"][1] = 1.0
        self._states = [self._at[f"{actuator.PREFIX}{FRICTION}{name}_n"] for name in worm.hysteresis.states]

    def along(self, lengths: FloatArray, times: FloatArray) -> Stretch:
        """Return what the segment does along a way, from rest."""
        found = np.zeros((4, len(lengths)))
        length_n, dt = lengths[0], times[1] - times[0]
        for row, (length, time) in enumerate(zip(lengths, times, strict=True)):
            if row > 0:
                dt = time - times[row - 1]
            found[:, row] = self._step(length, length_n, dt)
            length_n = length
        return Stretch(lengths, *found)

    def _step(self, length: float, length_n: float, dt: float) -> tuple[float, float, float, float]:
        """Return force, change of elastic energy, viscous loss and loss to friction of a step."""
        at = self._at
        at["length_n"][:] = at["length_hat"][:] = length_n
        at["angle_n"][:] = at["angle_hat"][:] = 2.0 * np.arcsin(length_n / (2.0 * at["link"][0]))
        at["span"][0] = at["dt"][0] = dt
        at["q"][_HEAD], at["dq"][_HEAD] = length, length - length_n
        out = {name: self._evaluated(name, self._kernels[name]) for name in self._out}
        terms = dict(zip(_OF_SEGMENT, out["segment_ledger"], strict=False))
        elastic, rubbed = terms["elastic"], 0.0
        if self._states:
            end = out["actuator_end"]
            own = dict(zip(_OF_ACTUATOR, end, strict=False))
            elastic, rubbed = elastic + own["elastic"], own["hysteresis_loss"]
            for k, state in enumerate(self._states):
                state[:] = end[actuator.LEDGER_ROWS + actuator.SIDES * (1 + k)]
        return out["segment_gradient"][1 + _HEAD], elastic, terms["viscous_loss"], rubbed

    def _evaluated(self, name: str, kernel: Kernel) -> FloatArray:
        kernel(self._rows[: kernel.rows_in], self._out[name], 1)
        found: FloatArray = self._out[name][:, 0]
        return found


_USED = ("segment_gradient", "segment_ledger", "actuator_end")
"""Kernels that a segment alone needs; the last only where its joints rub."""
