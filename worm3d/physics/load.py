"""External loads, which act on joints of a worm from outside. A new load is one class.

A load describes a time step in CasADi symbols. The first part is a potential of the position x of the load's joint at
the end of the step: the force is minus the gradient, so that the step remains the minimum of one potential. The other
parts are the states at the end of the step and the terms of the energy ledger.

A law with kinks has a *regime*, which selects a side of each kink. Newton's method keeps the regime until an iterate
lies in another regime.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from worm3d.physics.part import Part, Symbol, Symbols
from worm3d.values.arrays import FloatArray

if TYPE_CHECKING:
    from worm3d.physics.body import Body

LOAD_FREE, LOAD_LOW, LOAD_STICKING, LOAD_HIGH = map(float, range(-1, 3))
"""Regimes of a law with two limits: decided by the law, at the lower limit, between the limits, at the upper limit."""

HEAD = -1
"""Number for the head's joint."""

LOADS: dict[str, type[Load]] = {}
"""Class of each kind of load by name."""


class LoadStep(NamedTuple):
    """Response of a load in a step."""

    potential: Symbol
    """Potential whose gradient in "x" is minus the force on the joint [J]."""
    terms: Symbols = {}  # noqa: RUF012  # never changed
    """Terms of the energy ledger by name [J], from `worm3d.physics.kernels.load.LEDGER_TERMS`; the numerical loss is
    the rest of force times displacement."""
    states: Symbols = {}  # noqa: RUF012  # never changed
    """States at the end of the step, by name."""
    regime: Symbol = LOAD_STICKING
    """Next regime, for a law with kinks: the regime of "x", or the next regime on the way there."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Load(Part, registry=LOADS):
    """Base of all external loads; the base itself is no load.

    A subclass, `class Balloon(Load, name="balloon")`, defines `respond`; the fields are parameters.
    `worm3d.Worm(load=...)` takes one load or several.
    """

    known: ClassVar[tuple[str, ...]] = (
        *("x", "past", "velocity", "tangent", "normal", "regime", "regime_n"),
        *("gravity", "stiffness", "damping", "dt", "span", "ratio", "lands"),
    )

    acts_at_rest: ClassVar[bool] = True
    """Whether the load acts while the worm comes to rest before a run."""

    @property
    def at(self) -> int:
        """Joint on which the load acts; `HEAD` is the head's joint."""
        return 0

    @property
    def mass_carried(self) -> float:
        """Mass that moves with the joint [kg]."""
        return 0.0

    @classmethod
    def respond(cls, s: Symbols) -> LoadStep:
        """Return the response of the load in a time step.

        Parameters
        ----------
        s : mapping of str to SX
            By name: the parameters and "<state>_n" of each state. Position "x" (3) of the joint at the end of the step;
            "past" and "velocity" (6), at the start of this step and of the step before; "tangent" (3) of the segment at
            the joint and "normal" (3) of the world, 0 without a world, both at the start. "regime" of the law in this
            step (`LOAD_FREE`: the regime of x), and "regime_n", the regime of the last step. "gravity" (3) [m/s^2];
            "stiffness" [N/m] and "damping" [N s/m] for a load that sticks: the stiffness of normal contact, with the
            damping ratio of tangential contact. "dt", "span", "ratio" and "lands" as in
            `worm3d.physics.kernels.inertia`.
        """
        raise NotImplementedError

    def values(self, worm: Body) -> Mapping[str, float]:
        """Return the parameters by name."""
        return {name: value for name, value in self.parameters().items() if isinstance(value, int | float)}

    def begin(self, worm: Body, place: FloatArray, tangent: FloatArray) -> Mapping[str, float]:
        """Return the states by name before the first step, given the joint's position [m] and its segment's tangent."""
        return dict.fromkeys(self.states, 0.0)


LOADS["none"] = Load
