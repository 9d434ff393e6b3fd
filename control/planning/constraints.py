"""Constraints on a plan, found by name; all are soft, so that there is always a plan.

A constraint is a frozen dataclass with tolerances as fields and excesses c as CasADi symbols. c <= 0 is wanted at the
end of each step, and an excess has the weight of a miss: the cost grows by

    1/2 max(0, c)^2,   c over its tolerance                                                                  (O5)

the least of s^2/2 over slacks s >= 0, c <= s. A user's constraint is written like a user's term,
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
        """Return the excesses over their tolerance, shape (M,); at most 0 where the constraint is kept."""


@documented
@dataclass(frozen=True)
class Corridor(Constraint):
    """Offset of the middle within the corridor of the reference."""

    tolerance: float = parameter(0.005, "excess that weighs 1", "body lengths", gt=0)

    def excesses(self, at: Moment) -> ca.SX:
        """Return the excesses to the left and to the right; see `Constraint`."""
        excess = ca.vertcat(at.offset - at.wanted.left, -at.offset - at.wanted.right)
        return excess / (self.tolerance * at.length)

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return whether the path has a bound at each step."""
        return np.isfinite(ahead.left) | np.isfinite(ahead.right)


@documented
@dataclass(frozen=True)
class Clearance(Constraint):
    """Both ends of the body, and so the whole body, on one side of each obstacle.

    An end at the distance x ahead of the middle has the offset e + x sin(h - psi), (O4).
    """

    tolerance: float = parameter(0.005, "excess that weighs 1", "body lengths", gt=0)

    def excesses(self, at: Moment) -> ca.SX:
        """Return the excesses to the left and to the right of head and tail; see `Constraint`."""
        turned = at.length / 2.0 * ca.sin(at.state.heading - at.wanted.heading)
        ends = ca.vertcat(at.offset + turned, at.offset - turned)
        return ca.vertcat(ends - at.wanted.room_left, -ends - at.wanted.room_right) / (self.tolerance * at.length)

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return whether there is an obstacle beside the body."""
        return np.isfinite(ahead.room_left) | np.isfinite(ahead.room_right)


@documented
@dataclass(frozen=True)
class Roll(Constraint):
    """Roll of the body within a wave, if the identified map contains the roll."""

    limit: float = parameter(0.105, "greatest roll", "rad", gt=0)
    tolerance: float = parameter(0.02, "excess that weighs 1", "rad", gt=0)

    def excesses(self, at: Moment) -> ca.SX:
        """Return the excess; see `Constraint`."""
        return (at.roll - self.limit) / self.tolerance


CONSTRAINTS: Mapping[str, type[Constraint]] = MappingProxyType(
    {constraint.__name__.lower(): constraint for constraint in (Corridor, Clearance, Roll)}
)
"""Constraints by name; a plan has all of them unless others are given."""


def default_constraints() -> tuple[Constraint, ...]:
    """Return the supplied constraints, each with the default tolerances."""
    return tuple(constraint() for constraint in CONSTRAINTS.values())
