"""External loads, which act on joints of a worm from outside. A new load is a subclass of `Load`.

A load describes its response in a time step in CasADi symbols (`LoadStep`). The response contains a potential of the
position x of the load's joint at the end of the step. The force on the joint is minus the gradient of this potential,
so that the step remains the minimum of a potential. The response also contains the states at the end of the step and
the terms of the energy ledger.

The potential of a load may be defined piecewise. Its *regime* says which piece holds. Newton's method uses the piece of
one regime until an iterate lies in another regime.
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
"""Regimes of a load with two limits: no regime selected (x decides), at the lower limit, between them, at the upper."""

HEAD = -1
"""Number that denotes the joint at the head."""

LOADS: dict[str, type[Load]] = {}
"""Class of each kind of load by name."""


class LoadStep(NamedTuple):
    """Response of a load in a step."""

    potential: Symbol
    """Potential [J]. The force on the joint is minus its gradient with respect to "x"."""
    terms: Symbols = {}  # noqa: RUF012  # never changed
    """Terms of the energy ledger by name [J]. The names are `worm3d.physics.kernels.load.LEDGER_TERMS`, and the
    numerical loss is the remainder of force times displacement."""
    states: Symbols = {}  # noqa: RUF012  # never changed
    """States at the end of the step, by name."""
    regime: Symbol = LOAD_STICKING
    """Regime for the next iteration: the regime of "x", or the next regime on the way to it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Load(Part, registry=LOADS):
    """Base class of all external loads. The base class itself exerts no force.

    A subclass, for example `class Balloon(Load, name="balloon")`, defines `respond`. Its fields are parameters. The
    argument `load` of `worm3d.Worm` is one load or several loads.
    """

    known: ClassVar[tuple[str, ...]] = (
        *("x", "past", "velocity", "tangent", "normal", "regime", "regime_n"),
        *("gravity", "stiffness", "damping", "dt", "span", "ratio", "lands"),
    )

    acts_at_rest: ClassVar[bool] = True
    """Whether the load acts while the worm settles before a run."""

    @property
    def at(self) -> int:
        """Index of the joint on which the load acts; `HEAD` denotes the joint at the head."""
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
            By name, with the number of components in brackets where it is not 1. The parameters, and "<state>_n" of
            each state. "x" (3), position of the joint at the end of the step [m]. "past" (6) and "velocity" (6),
            positions and velocities of the joint at the start of this step and of the previous step. "tangent" (3) of
            the segment at the joint and "normal" (3) of the world, at the start of this step; without a world, the
            normal is 0. "regime", regime of the law in this step (`LOAD_FREE`: the regime of x), and "regime_n", regime
            in the last step. "gravity" (3) [m/s^2]. "stiffness" [N/m] and "damping" [N s/m] for a load that sticks: the
            stiffness of normal contact, and a damping with the damping ratio of tangential contact. "dt", "span",
            "ratio" and "lands" as in `worm3d.physics.kernels.inertia`.
        """
        raise NotImplementedError

    def values(self, worm: Body) -> Mapping[str, float]:
        """Return the parameters by name."""
        return {name: value for name, value in self.parameters().items() if isinstance(value, int | float)}

    def begin(self, worm: Body, place: FloatArray, tangent: FloatArray) -> Mapping[str, float]:
        """Return the states by name before the first step. `place` is the joint's position [m]."""
        return dict.fromkeys(self.states, 0.0)


LOADS["none"] = Load
