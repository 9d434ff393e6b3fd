"""Friction in the joints of a chamber's linkage: rate-independent hysteresis, exact in each time step.

The hinges of a chamber's rhombus have friction, which can hold a force along the chamber. The maximum of this force
depends on the length l of the chamber. It is the slope of an increasing function y of the length, the *coordinate* of
the friction:

    |force of the friction| <= dy/dl                                                                    (H1)

A constant moment M in the hinges gives y = M angle(l). For friction proportional to the pull of the chamber's springs,
y is the energy of the springs with the sign of l - l_0, where l_0 is the rest length without an input. The segment law
gives angle and energy. The unit of y is J: sliding by dy dissipates the energy dy.

Joints yield elastically before they slide, and some joints slide earlier than others. The model is a set of elements in
parallel that share the load. Each element is a spring and a slider in series (Jenkins or Maxwell-slip elements).
Element k has the share w_k of the load and slides once its spring is stretched by r_k, measured in y. Let e_k be the
stretch of the spring as a fraction of r_k, -1 <= e_k <= 1. A step that starts from e_kn adds the potential

    Psi(l) = sum over k of w_k Huber_k(d_k),   d_k = r_k e_kn + y(l) - y(l_n)                           (H2)
    Huber_k(d) = d^2/(2 r_k) while |d| <= r_k, |d| - r_k/2 beyond

to the potential that the step minimises. The states at the end of the step are

    e_k = d_k/r_k, limited to the range -1 to 1                                                         (H3)

The force is -dPsi/dl = -(sum of w_k e_k) dy/dl, and obeys (H1) if the shares add up to 1. This is exact if the length
changes monotonically within the step: nothing depends on the rate or on the time step. The elements' springs store
w_k r_k e_k^2/2, and the sliders dissipate

    w_k max(0, |d_k| - r_k) >= 0                                                                        (H4)

which is Psi minus the change of the springs' energy. Closed loops follow Masing's rules in y: after a reversal, the
force follows the curve of the first loading at twice the scale. (W. D. Iwan, A distributed-element model for hysteresis
and its steady-state dynamic response, J. Appl. Mech. 33, 893, 1966. The step is the standard step of incremental
plasticity.)

The joints of a chamber without links are those of a rhombus with the length l_0 and the outward distance w_0 that the
chamber has without an input and without a load. A constant moment in these joints acts on

    angle(l) = 2 asin(l/(2 a)),   a^2 = w_0^2 + l_0^2/4                                                  (H5)

While a worm settles before a run, the joints have no friction. A run starts with unstressed elements, e_k = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from worm3d.physics.part import Numbers, Part, Symbol, Symbols
from worm3d.values.parameters import documented, parameter

HYSTERESIS_PREFIX = "hysteresis_"
"""Prefix of the names of the joint friction's states and parameters, which are stored with those of the actuator."""

HYSTERESES: dict[str, type[Hysteresis]] = {}
"""Class of each kind of joint friction by name."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Hysteresis(Part, registry=HYSTERESES):
    """Base class of all friction in the joints of a segment's linkage. The base class itself has no friction.

    A subclass, for example `class Rubbing(Hysteresis, name="rubbing")`, sets `elements` and defines `coordinate` and
    `sliders`. Its fields are parameters; a field declared with each="segment" may be an array. The argument
    `hysteresis` of `worm3d.Worm` selects the friction. `Result.actuator_states` contains the state e_k of each element
    of each chamber as "hysteresis_1", "hysteresis_2", ..., arrays of shape (T, N, 2).
    """

    known: ClassVar[tuple[str, ...]] = (
        *("length", "l0", "link", "k", "k_apex"),
        *("angle", "energy", "passive_length"),
    )
    told: ClassVar[tuple[str, ...]] = ("elements", "needs_links")
    elements: ClassVar[int] = 0
    """Number of parallel elements in each chamber."""

    def __init_subclass__(cls, name: str = "") -> None:
        super().__init_subclass__(name)
        cls.states = {str(k + 1): "1" for k in range(cls.elements)}

    @classmethod
    def coordinate(cls, s: Symbols) -> Symbol:
        """Return y of (H1) [J] as a scalar CasADi expression. y must increase with the length.

        Parameters
        ----------
        s : mapping of str to SX
            Scalars by name: the parameters, the "length" of the chamber [m], the rest length "l0" of its segment [m],
            the length "link" of the links [m] (only if the segment law has links), and the stiffness of the segment's
            springs "k" [N] and of its apex hinges "k_apex" [N m/rad]. A chamber has half of each stiffness. "angle",
            "energy" and "passive_length" follow from "length" by `worm3d.SegmentLaw.joints`.
        """
        raise NotImplementedError

    @classmethod
    def sliders(cls, s: Symbols) -> Sequence[tuple[Symbol, Symbol]]:
        """Return the share w and the give r [J] of each element, (H2), as functions of the parameters in `s`."""
        raise NotImplementedError


HYSTERESES["none"] = Hysteresis


def chamber_states(actuator: type[Part], own: type[Hysteresis]) -> dict[str, str]:
    """Return the unit of each state of a chamber by name: the actuator's states, then the joint friction's states."""
    return {**actuator.states, **{HYSTERESIS_PREFIX + name: unit for name, unit in own.states.items()}}


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Jenkins(Hysteresis, name="jenkins"):
    """Friction in the joints of chambers: a constant moment, and a part proportional to the pull of the springs.

    Let h be the half-height of a chamber, and P the force with which the springs and apex hinges pull the chamber back
    to its rest length without an input. The friction along the chamber is at most moment/h + load_ratio |P|. Four
    elements have equal shares. Their gives r_k are a geometric progression from give/spread to give spread. A chamber
    without links has the h of the rhombus in (H5).
    """

    elements: ClassVar[int] = 4

    moment: Numbers = parameter(
        0.005,
        "friction of each of a segment's two apex hinges, both chambers together, whatever their load",
        "N m",
        ge=0,
        each="segment",
    )
    load_ratio: Numbers = parameter(
        0.2,
        "further friction over the pull of the chamber's springs and hinges towards its nominal rest length; at 1 the "
        "chamber would not return by itself",
        ge=0,
        lt=1,
        each="segment",
    )
    give: Numbers = parameter(
        1e-4,
        "work, by the full friction of a chamber, over the way that its joints give before they slide; the mean of the "
        "elements in their progression",
        "J",
        gt=0,
        each="segment",
    )
    spread: float = parameter(
        3.0, "largest give of the elements over their mean, and their mean over the smallest", ge=1, le=1e3
    )

    @classmethod
    def coordinate(cls, s: Symbols) -> Symbol:
        """Return moment angle(l) + load_ratio E(l) sign(l - l_0), with energy E and rest length l_0 without input."""
        import casadi as ca  # parameters do not need casadi

        direction = ca.sign(s["length"] - s["passive_length"])
        return s["moment"] * s["angle"] + s["load_ratio"] * s["energy"] * direction

    @classmethod
    def sliders(cls, s: Symbols) -> Sequence[tuple[Symbol, Symbol]]:
        """Return equal shares, and gives that are a geometric progression."""
        places = [2.0 * k / (cls.elements - 1) - 1.0 for k in range(cls.elements)]
        return [(1.0 / cls.elements, s["give"] * s["spread"] ** place) for place in places]
