"""Soft constraints on a plan. They are soft so that there is always a plan.

A constraint is a frozen dataclass whose fields are tolerances. Its method `excesses` returns values c as CasADi
symbols, each divided by its tolerance. A plan should have c <= 0 at the end of each step. If c is positive, the cost
increases by

    1/2 max(0, c)^2                                                                                          (O5)

which is the minimum of s^2/2 over slacks s >= 0 with c <= s. Users write constraints like terms of the cost, see
`control.planning.terms`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from control.planning.terms import Moment, Part
from control.tracking.preview import Preview
from worm3d.values.parameters import documented, parameter


class Constraint(Part):
    """A soft constraint of a plan."""

    @abstractmethod
    def excesses(self, at: Moment) -> ca.SX:
        """Return the excesses divided by their tolerances, shape (M,).

        A constraint is satisfied if its excess is at most 0.
        """


@documented
@dataclass(frozen=True)
class Corridor(Constraint):
    """The middle of the body stays within the corridor of the reference."""

    tolerance: float = parameter(0.005, "excess that weighs 1", "body lengths", gt=0)

    def excesses(self, at: Moment) -> ca.SX:
        """Return the excesses to the left and to the right, see `Constraint.excesses`."""
        excess = ca.vertcat(at.offset - at.wanted.left, -at.offset - at.wanted.right)
        return excess / (self.tolerance * at.length)

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return whether the corridor is bounded at each step."""
        return np.isfinite(ahead.left) | np.isfinite(ahead.right)


@documented
@dataclass(frozen=True)
class Clearance(Constraint):
    """Both ends of the body, and with them the whole body, stay on the same side of each obstacle.

    An end of the body at the distance x ahead of the middle has the offset e + x sin(h - psi). For e, h and psi see
    (O4).
    """

    tolerance: float = parameter(0.005, "excess that weighs 1", "body lengths", gt=0)

    def excesses(self, at: Moment) -> ca.SX:
        """Return the excesses of head and tail to the left, then to the right, see `Constraint.excesses`."""
        turned = at.length / 2.0 * ca.sin(at.state.heading - at.wanted.heading)
        ends = ca.vertcat(at.offset + turned, at.offset - turned)
        return ca.vertcat(ends - at.wanted.room_left, -ends - at.wanted.room_right) / (self.tolerance * at.length)

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return whether there is an obstacle beside the body at each step."""
        return np.isfinite(ahead.room_left) | np.isfinite(ahead.room_right)


@documented
@dataclass(frozen=True)
class Roll(Constraint):
    """The roll of the body within a wave is limited, if the identified map contains the roll."""

    limit: float = parameter(0.105, "greatest roll", "rad", gt=0)
    tolerance: float = parameter(0.02, "excess that weighs 1", "rad", gt=0)

    def excesses(self, at: Moment) -> ca.SX:
        """Return the excess, see `Constraint.excesses`."""
        return (at.roll - self.limit) / self.tolerance


CONSTRAINTS: Mapping[str, type[Constraint]] = MappingProxyType(
    {constraint.__name__.lower(): constraint for constraint in (Corridor, Clearance, Roll)}
)
"""Supplied constraints by name. By default a plan has all of them."""


def default_constraints() -> tuple[Constraint, ...]:
    """Return the supplied constraints with default tolerances."""
    return tuple(constraint() for constraint in CONSTRAINTS.values())
