"""Whether the energies that an actuator declares are the work that its force does.

The ledger of a run closes whatever an actuator declares: what is too much counts as numerical loss, and one run alone
does not tell this from the error of its steps. The check takes the actuator alone through a motion of its chamber, in
steps and in half of them, and extrapolates what is missed until each time,

    D = sum of (work - stored - lost + dPsi/dl (l - l_n)),                                              (B1)

to steps of no length, 2 D_half - D. That is 0 where force and energies belong together.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from worm3d.physics.actuators import KNOWN, Actuator
from worm3d.physics.kernels import losses
from worm3d.physics.kernels.layout import once
from worm3d.physics.worm import Worm
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import parameters_of

MOTION_TIME, MOTION_STEPS = 1.0, 100
"""Time of the motion [s], a usual period of a gait, and number of its steps, which are then halved."""
MOTION_STROKE = 0.3
"""Share of the greatest contraction by which the chamber is shortened, and up to which contractions are commanded."""
LARGEST_MISS = 0.005
"""Largest missing energy, as a fraction of the largest energy that is declared or given, that is not warned of.

The actuators that come with worm3d miss 1.6e-4 at most; a declared work that is 5 % too much misses 0.05. Half and
double tell these apart as well.
"""

ENERGIES = ("missed", "work", "stored", "lost", "on_chamber")


class UnbalancedEnergyWarning(RuntimeWarning):
    """The energies that an actuator declares are not the work that its force does."""


class Balance(NamedTuple):
    """What the actuator of a chamber misses in a motion."""

    missed: float
    """Largest energy that is missing at some time, extrapolated to steps of no length [J]."""
    energy: float
    """Largest energy that is declared or given until some time [J]."""
    change: float
    """Largest change of the missing energy by half the step [J]."""

    @property
    def holds(self) -> bool:
        """Whether nothing is missing, or as much as the steps of the motion may be to blame for."""
        return self.missed <= max(LARGEST_MISS * self.energy, self.change)


_FOUND: dict[tuple[Any, ...], Balance] = {}
"""Balances of the actuators of earlier worms."""


def warn_of_imbalance(worm: Worm) -> None:
    """Warn where the energies that the actuator of a worm declares are not the work of its force."""
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


def balance(part: Actuator, worm: Worm) -> Balance:
    """Return what the actuator of a worm's chambers misses, (B1), in the chamber in which it is most."""
    coarse, fine = (_energies(part, worm, count) for count in (MOTION_STEPS, 2 * MOTION_STEPS))
    change = fine[::2, 0] - coarse[:, 0]
    missed = np.abs(fine[::2, 0] + change).max(axis=0)
    energy = np.abs(fine[:, 1:]).max(axis=(0, 1))
    worst = int(np.argmax(missed / np.maximum(energy, np.finfo(float).tiny)))
    return Balance(float(missed[worst]), float(energy[worst]), float(np.abs(change[:, worst]).max()))


def _energies(part: Actuator, worm: Worm, steps: int) -> FloatArray:
    """Return `ENERGIES` until the start and the end of each step, shape (steps + 1, 5, N) [J]."""
    kind, n, dt = part.compiled(), worm.segments, MOTION_TIME / steps
    at_rest, of_step = _functions(kind)
    lengths, commands = _motion(worm, np.linspace(0.0, MOTION_TIME, steps + 1))
    fixed = dict(part.values(worm, hinge=False))
    fixed |= {"l0": worm.l0, "link": worm.link_length, "k": worm.k_spring, "dt": dt, "span": dt}
    known = dict.fromkeys(KNOWN, 0.0) | fixed
    known |= {"command": commands[0], "command_n": commands[0], "given_n": commands[0]}
    states, given = at_rest(known | {"length": lengths[0], "length_n": lengths[0]}, n), commands[0]
    total = np.zeros((steps + 1, len(ENERGIES), n))
    for k in range(steps):
        known |= {"command": commands[k + 1], "command_n": commands[k], "given_n": given}
        known |= {"length": lengths[k + 1], "length_n": lengths[k]}
        known |= {f"{name}_{past}": states[name] for name in kind.states for past in ("n", "hat")}
        states = of_step(known, n)
        given, total[k + 1] = states["given"], total[k] + [states[name] for name in ENERGIES]
    return total


def _motion(worm: Worm, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return lengths [m] and commanded contractions of the chambers at K times, shape (K, N) each.

    Both go to and fro smoothly, at different paces; each chamber is at another phase.
    """
    most = MOTION_STROKE * worm.stroke[1]
    phase = 2.0 * np.pi * (time[:, None] / MOTION_TIME + 0.4 * np.arange(worm.segments))
    return worm.l0 * (1.0 - most * np.sin(phase / 2.0) ** 2), most * np.sin(0.8 * phase + 0.5) ** 2


Numeric = Callable[[dict[str, Any], int], dict[str, FloatArray]]
"""Numbers by name, one or N of each, and N, to numbers by name, each of shape (N,)."""


@once
def _functions(kind: type[Actuator]) -> tuple[Numeric, Numeric]:
    """Return what the states of an actuator are at rest, and what it does in a step."""
    past = [f"{state}_{at}" for state in kind.states for at in ("n", "hat")]
    s = {name: ca.SX.sym(name) for name in (*KNOWN, *parameters_of(kind), *past)}
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
    """Return a function of numbers that evaluates expressions of the inputs."""
    values = ca.Function("values", list(inputs.values()), [ca.vertcat(*map(ca.SX, outputs.values()))])

    side_by_side = cache(values.map)

    def evaluate(known: dict[str, Any], count: int) -> dict[str, FloatArray]:
        given = [np.broadcast_to(known[name], count)[None] for name in inputs]
        rows = np.array(side_by_side(count)(*given)) if outputs else np.zeros((0, count))
        return dict(zip(outputs, rows, strict=True))

    return evaluate
