"""External loads, which act on joints of a worm from outside. A new one is one class.

What a load does in a time step it says in CasADi symbols: a potential of the place x of its joint at the end of the
step, whose gradient is minus its force, so that the step stays the minimum of one potential; its states at the end; and
its terms of the energy ledger.

A law with kinks has a *regime*, which says on which side of them it is taken. Newton's method keeps the regime until it
leads to a place in another one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from worm3d.physics.part import Part, Symbol, Symbols
from worm3d.values.arrays import FloatArray

if TYPE_CHECKING:
    from worm3d.physics.body import Body

LOAD_FREE, LOAD_LOW, LOAD_STICKING, LOAD_HIGH = -1.0, 0.0, 1.0, 2.0
"""Regimes of a law with two limits: the law itself decides, at the lower one, between them, at the upper one."""

HEAD = -1
"""Number that stands for the head's joint."""

LOADS: dict[str, type[Load]] = {}
"""Class of each kind of load by its name."""


class LoadStep(NamedTuple):
    """What a load does in a step."""

    potential: Symbol
    """Potential whose gradient in "x" is minus the force on the joint [J]."""
    terms: Symbols = {}  # noqa: RUF012  # never changed
    """Terms of the energy ledger by name [J], of `worm3d.physics.kernels.load.LEDGER_TERMS`; the numerical loss is the
    rest of force times way."""
    states: Symbols = {}  # noqa: RUF012  # never changed
    """States at the end of the step, by name."""
    regime: Symbol = LOAD_STICKING
    """Regime that follows, for a law with kinks: the one that "x" lies in, or the next on the way there."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Load(Part, registry=LOADS):
    """Base of all external loads, itself none.

    A subclass, `class Balloon(Load, name="balloon")`, defines `respond`; its fields are parameters.
    `worm3d.Worm(load=...)` uses one or several.
    """

    known: ClassVar[tuple[str, ...]] = (
        *("x", "past", "velocity", "tangent", "normal", "regime", "regime_n"),
        *("gravity", "stiffness", "damping", "dt", "span", "ratio", "lands"),
    )

    acts_at_rest: ClassVar[bool] = True
    """Whether it acts while the worm comes to rest before a run."""

    @property
    def at(self) -> int:
        """Joint that it acts on; `HEAD` is the head's."""
        return 0

    @property
    def mass_carried(self) -> float:
        """Mass that moves with its joint [kg]."""
        return 0.0

    @classmethod
    def respond(cls, s: Symbols) -> LoadStep:
        """Return what the load does in a time step.

        Parameters
        ----------
        s : mapping of str to SX
            By name: the parameters and "<state>_n" of each state. Place "x" (3) of the joint at the end of the step;
            "past" and "velocity" (6), at its start and that of the step before; "tangent" (3) of the segment there and
            "normal" (3) of the world, 0 without one, at its start. "regime", in which the law is taken
            (`LOAD_FREE`: the regime in which x lies), and "regime_n", that of the last step. "gravity" (3) [m/s^2];
            "stiffness" [N/m] and "damping" [N s/m] for a load that sticks: the stiffness of normal contact, with
            the damping ratio of tangential contact.
            "dt", "span", "ratio" and "lands" as in `worm3d.physics.kernels.inertia`.
        """
        raise NotImplementedError

    def values(self, worm: Body) -> Mapping[str, float]:
        """Return the parameters by name."""
        return {name: value for name, value in self.parameters().items() if isinstance(value, int | float)}

    def begin(self, worm: Body, place: FloatArray, tangent: FloatArray) -> Mapping[str, float]:
        """Return the states, by name, before the first step; the joint's place [m] and the tangent of its segment."""
        return dict.fromkeys(self.states, 0.0)


LOADS["none"] = Load
