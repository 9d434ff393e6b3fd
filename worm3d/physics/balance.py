"""Check whether the energies that an actuator declares equal the work done by the actuator's force.

The ledger of a run balances whatever energies an actuator declares, because the ledger books any difference as
numerical loss. A single run cannot distinguish such a difference from the error of the time steps. Therefore this check
moves the chamber of an isolated actuator twice, with full steps and with half steps. The energy missing up to a time is

    D = sum of (work - stored - lost + dPsi/dl (l - l_n))                                               (A6)

over the steps until then. D is extrapolated to steps of zero length as 2 D_half - D. The result is 0 if the force and
the energies are consistent.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from worm3d.physics.actuators import RESPONSE_INPUTS, Actuator
from worm3d.physics.kernels import losses
from worm3d.physics.kernels.layout import once
from worm3d.physics.worm import Worm
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import parameters_of

MOTION_STROKE = 0.3
"""Largest shortening of the chamber and largest commanded contraction, as a fraction of the greatest contraction."""
LARGEST_MISS = 0.005
"""Largest missing energy without a warning, as a fraction of the largest energy that is declared or transferred.

The actuators of worm3d miss at most 1.6e-4. A declared work that is 5 % too large misses 0.05. Half or twice this limit
would separate the two cases as well.
"""

BALANCE_TERMS = ("missed", "work", "stored", "lost", "on_chamber")


class UnbalancedEnergyWarning(RuntimeWarning):
    """The energies that an actuator declares do not equal the work done by the actuator's force."""


class Balance(NamedTuple):
    """Missing energy of the actuator of a chamber during the motion of the check."""

    missed: float
    """Largest missing energy over time, extrapolated to steps of zero length [J]."""
    energy: float
    """Largest energy over time that the actuator declares or transfers to the chamber [J]."""
    change: float
    """Largest change of the missing energy when the steps are halved [J]."""

    @property
    def holds(self) -> bool:
        """Whether no more energy is missing than the tolerance or the error of the steps explains."""
        return self.missed <= max(LARGEST_MISS * self.energy, self.change)


_FOUND: dict[tuple[Any, ...], Balance] = {}
"""Results for the actuators of earlier worms, by class and parameters."""


def warn_of_imbalance(worm: Worm) -> None:
    """Warn if the energies that the actuator of a worm declares do not equal the work of the actuator's force."""
    part = worm.actuator
    values = part.values(worm, hinge=False).values()
    key = (part.compiled(), worm.segments, *(np.asarray(value).tobytes() for value in values))
    found = _FOUND.get(key) or _FOUND.setdefault(key, balance(part, worm))
    if found.holds:
        return
    warnings.warn(
        f"{type(part).__name__}.respond: {found.missed:.2g} J of the {found.energy:.2g} J that it declares are missing "
        f"({found.missed / found.energy:.0%}), however short the steps: work - stored - lost must be the work of its "
        "force on the chamber, -dPsi/dl times the change of the length; runs book what is missing as numerical loss",
        UnbalancedEnergyWarning,
        stacklevel=3,
    )


def balance(part: Actuator, worm: Worm, steps: int = 100) -> Balance:
    """Return the missing energy (A6) for the chamber of the worm that misses most.

    The motion takes 1 s, a typical period of a gait, in `steps` full steps.
    """
    coarse, fine = (_energies(part, worm, count) for count in (steps, 2 * steps))
    change = fine[::2, 0] - coarse[:, 0]
    missed = np.abs(fine[::2, 0] + change).max(axis=0)
    energy = np.abs(fine[:, 1:]).max(axis=(0, 1))
    worst = int(np.argmax(missed / np.maximum(energy, np.finfo(float).tiny)))
    return Balance(float(missed[worst]), float(energy[worst]), float(np.abs(change[:, worst]).max()))


def _energies(part: Actuator, worm: Worm, steps: int) -> FloatArray:
    """Return the cumulative sums of `BALANCE_TERMS` at the start and after each step, shape (steps + 1, 5, N) [J]."""
    kind, n, dt = part.compiled(), worm.segments, 1.0 / steps
    at_rest, of_step = _functions(kind)
    lengths, commands = _motion(worm, np.linspace(0.0, 1.0, steps + 1))
    fixed = dict(part.values(worm, hinge=False))
    fixed |= {"l0": worm.l0, "link": worm.link_length, "k": worm.k_spring, "dt": dt, "span": dt}
    known = dict.fromkeys(RESPONSE_INPUTS, 0.0) | fixed
    known |= {"command": commands[0], "command_n": commands[0], "given_n": commands[0]}
    states, given = at_rest(known | {"length": lengths[0], "length_n": lengths[0]}, n), commands[0]
    total = np.zeros((steps + 1, len(BALANCE_TERMS), n))
    for k in range(steps):
        known |= {"command": commands[k + 1], "command_n": commands[k], "given_n": given}
        known |= {"length": lengths[k + 1], "length_n": lengths[k]}
        known |= {f"{name}_{past}": states[name] for name in kind.states for past in ("n", "hat")}
        states = of_step(known, n)
        given, total[k + 1] = states["given"], total[k] + [states[name] for name in BALANCE_TERMS]
    return total


def _motion(worm: Worm, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lengths [m] and the commanded contractions of the chambers at K times, each of shape (K, N).

    Lengths and contractions oscillate smoothly at different frequencies, with a different phase in each chamber.
    """
    most = MOTION_STROKE * worm.stroke[1]
    phase = 2.0 * np.pi * (time[:, None] + 0.4 * np.arange(worm.segments))
    return worm.l0 * (1.0 - most * np.sin(phase / 2.0) ** 2), most * np.sin(0.8 * phase + 0.5) ** 2


Numeric = Callable[[dict[str, Any], int], dict[str, FloatArray]]
"""Function of a dictionary of inputs and the number N of chambers. An input is a number or N numbers; each result has
the shape (N,)."""


@once
def _functions(kind: type[Actuator]) -> tuple[Numeric, Numeric]:
    """Return two functions: the states of an actuator at rest, and the energies and states of a step."""
    past = [f"{state}_{at}" for state in kind.states for at in ("n", "hat")]
    s = {name: ca.SX.sym(name) for name in (*RESPONSE_INPUTS, *parameters_of(kind), *past)}
    response, length = kind.respond(s), s["length"]

    def potential(at: ca.SX) -> ca.SX:
        return ca.substitute(ca.SX(response.potential), length, at)

    on_chamber = -losses.slope(potential, length) * (length - s["length_n"])
    declared = response.work - response.stored - response.lost
    made = {"work": response.work, "stored": response.stored, "lost": response.lost, "given": response.given}
    of_step = {**made, "on_chamber": on_chamber, "missed": declared - on_chamber, **response.states}
    present = {name: symbol for name, symbol in s.items() if name not in past}
    return _numeric(present, dict(kind.at_rest(present))), _numeric(s, of_step)


def _numeric(inputs: dict[str, ca.SX], outputs: dict[str, Any]) -> Numeric:
    """Return a function that evaluates expressions numerically; `inputs` are the symbols in these expressions."""
    values = ca.Function("values", list(inputs.values()), [ca.vertcat(*map(ca.SX, outputs.values()))])

    def evaluate(known: dict[str, Any], count: int) -> dict[str, FloatArray]:
        given = [np.broadcast_to(known[name], count)[None] for name in inputs]
        rows = np.array(values(*given)) if outputs else np.zeros((0, count))
        return dict(zip(outputs, rows, strict=True))

    return evaluate
