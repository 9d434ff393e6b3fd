"""Terms of the cost of a plan, found by name: the goals of a plan, and the weight of each miss.

A term is a frozen dataclass with tolerances as fields and misses as CasADi symbols; `control/README.md` has an example
of a user's term. In Python it is added by `GaitMPC(worm, identified, model, terms=[*default_terms(), Thrift()])`.

With the wanted speed V_ref, point r, heading psi and frequency f_0, the supplied terms are

    speed    (V - V_ref)/a_V            heading   (h - psi + crab)/a_h,  crab = u / V_ref
    offset   e/a_e,  e = (p - r) . n    arrival   e_H sqrt(L/w)/a_e,  L = a_e/a_h                                (O4)
    change   (u_k - u_{k-1})/a_rate     frequency (f - f_0)/a_f             steering  s/a_s

V being the speed along the heading, minus the slip, and n(psi) = (-sin psi, cos psi) the left of the path. The body
stands across the path by the angle crab, so that the centre of mass follows the path although the worm moves to the
left with the speed u. Steering also causes u, so that the cost takes u from the predicted state. With the u of an
earlier plan, crab angle and plan would oscillate, and a worm would not return to the path as the cost predicts.

The arrival is the offset at the end of the horizon, and represents the cost of all later steps. For an offset e over
the distance s with free slope e', int (e/a_e)^2 + (e'/a_h)^2 ds is least for e ~ exp(-s/L), L = a_e/a_h. The cost from
e_H on is then e_H^2 L/a_e^2: as much as L/w steps of length w. An offset thus decays over the distance L, however short
the horizon is. A turn rate b that is missing in the estimate leaves an offset of b L^2/V, at which the steering for the
offset cancels b. With 5 mrad/s, the uncertainty of the default worm's turn rate, this offset is 1.3 mm.

For a large offset this distance is long: the decay from 0.3 body lengths to 0.02 takes 2.7 L. A worm far from the path
should go straight towards the path, so that with b = 0.35 rad, five tolerances, a miss m of the heading costs

    (b/a_h)^2 (sqrt(1 + (m/b)^2) - 1),   half (m/a_h)^2 for a small m, (b/a_h) |m|/a_h for a large m          (O7)

A miss of the speed has the same form, with b = 3 a_V. A worm that is pushed, or turns as sharply as possible, cannot
have the wanted speed. The square of this miss would outweigh the offset, and shorten the waves that turn.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from control.estimation.reduced import ReducedInput, ReducedState
from control.tracking.preview import Preview
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import Checked

MAX_CRAB = 0.3
"""Largest allowed angle of the body across the path [rad]."""
LEAST_WAY = 0.02
"""Least distance in a step where the distance is a divisor [body lengths]."""


WALLED = 0.1
"""Factor of a miss of the path where walls keep the worm on the path. With this factor the offset is 0.013 instead of
0.012 body lengths, and the rms error of the speed 3.6 instead of 6.2 % (scene velocity_pipe, seeds 10 to 12)."""


class Wanted(NamedTuple):
    """Wanted values at the end of a step, by the reference; each is an SX of one entry."""

    speed: ca.SX
    """Speed forward [m/s]."""
    x: ca.SX
    """Point of the path [m]; 0 without a path."""
    y: ca.SX
    heading: ca.SX
    """Heading of the path, or the wanted heading [rad]; 0 without either."""
    crab: ca.SX
    """Wanted angle of the body to the right of this heading, for each m/s of speed to the left [s/m]."""
    frequency: ca.SX
    """Frequency that suits the speed, scaled like the inputs."""
    left: ca.SX
    """Greatest allowed offset to the left of the path [m]."""
    right: ca.SX
    """Greatest allowed offset to the right, as a positive number [m]."""
    room_left: ca.SX
    """Greatest allowed offset of both ends of the body to the left [m]."""
    room_right: ca.SX
    """Greatest allowed offset of both ends to the right, as a positive number [m]."""


@dataclass(frozen=True, eq=False)
class Moment:
    """State of the worm at the end of a step, and the wanted values, in symbols of CasADi."""

    state: ReducedState
    given: ReducedInput
    """Inputs during the step: amplitude, frequency [Hz] and steering."""
    scaled: ca.SX
    """The inputs with the absolute value of the amplitude, scaled to [-1, 1] over the ranges of the map, shape (3,)."""
    before: ca.SX
    """Scaled inputs of the step before, shape (3,)."""
    speed: ca.SX
    """Speed along the heading, minus the slip [m/s]."""
    sideways: ca.SX
    """Speed to the left of the heading [m/s]."""
    turn_rate: ca.SX
    """Turn rate to the left [rad/s]."""
    roll: ca.SX
    """Greatest roll in a wave by the identified map [rad]; 0 if the map has no roll."""
    wanted: Wanted
    length: float
    """Length of the body [m]."""

    @property
    def offset(self) -> ca.SX:
        """Distance to the left of the path [m], e of (O4)."""
        wanted, state = self.wanted, self.state
        return (state.y - wanted.y) * ca.cos(wanted.heading) - (state.x - wanted.x) * ca.sin(wanted.heading)


class Part(Checked, ABC):
    """A term of the cost, or a constraint."""

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return factors of the values, a scalar or one factor per step: 0 where the part does not apply."""
        return 1.0


class CostTerm(Part):
    """A term of the cost: half the sum of the squared misses at the end of each step."""

    @abstractmethod
    def misses(self, at: Moment) -> ca.SX:
        """Return the misses over their tolerances, shape (M,)."""


def _levelled(miss: ca.SX, large: float) -> ca.SX:
    """Return a residual; half of its square is the cost (O7) of a miss, times the square of the tolerance."""
    return miss * ca.sqrt(2.0 / (1.0 + ca.sqrt(1.0 + (miss / large) ** 2)))


def _kept(ahead: Preview) -> float:
    """Return the factor of a miss of the path; 0 without a path."""
    return ahead.follows * (WALLED if ahead.walled else 1.0)


@documented
@dataclass(frozen=True)
class Speed(CostTerm):
    """Miss of the speed."""

    tolerance: float = parameter(0.004, "a_V, miss of the speed that weighs 1", "body lengths/s", gt=0)
    large: float = parameter(0.02, "miss from which on the cost rises by the miss, no faster", "body lengths/s", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return _levelled((at.speed - at.wanted.speed) / at.length, self.large) / self.tolerance


@documented
@dataclass(frozen=True)
class Offset(CostTerm):
    """Offset from the path."""

    tolerance: float = parameter(0.01, "a_e, offset that weighs 1", "body lengths", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return at.offset / (self.tolerance * at.length)

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return whether there is a path."""
        return _kept(ahead)


@documented
@dataclass(frozen=True)
class Arrival(Offset):
    """Offset at the end of the horizon, for all later steps."""

    way: float = parameter(0.01 / 0.07, "L, in which an offset dies away to 37 %", "body lengths", gt=0)

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return the weight of the last step, if there is a path."""
        last = _kept(ahead) * np.sqrt(self.way / max(abs(float(ahead.way[-1])), LEAST_WAY))
        return np.append(np.zeros(len(ahead.way) - 1), last)


@documented
@dataclass(frozen=True)
class Heading(CostTerm):
    """Miss of the heading, the body standing across the path to compensate the sideways motion."""

    tolerance: float = parameter(0.07, "a_h, miss of the heading that weighs 1", "rad", gt=0)
    large: float = parameter(0.35, "miss from which on the cost rises by the miss, no faster", "rad", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        crab = ca.fmax(-MAX_CRAB, ca.fmin(MAX_CRAB, at.wanted.crab * at.sideways))
        miss = at.state.heading - at.wanted.heading + crab
        return _levelled(miss, self.large) / self.tolerance

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return whether there is a path or a heading."""
        return float(ahead.heads)


@documented
@dataclass(frozen=True)
class Change(CostTerm):
    """Change of the inputs from step to step, as a share of half the range of each input."""

    amplitude: float = parameter(0.3, "a_rate, change of the amplitude that weighs 1", gt=0)
    frequency: float = parameter(0.2, "a_rate, change of the frequency that weighs 1", gt=0)
    steering: float = parameter(0.25, "a_rate, change of the steering that weighs 1", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the misses; see `CostTerm`."""
        return (at.scaled - at.before) / ca.DM([self.amplitude, self.frequency, self.steering])


@documented
@dataclass(frozen=True)
class Frequency(CostTerm):
    """Distance of the frequency from the preferred frequency, as a share of half the frequency range."""

    tolerance: float = parameter(1.0, "a_f, distance that weighs 1", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return (at.scaled[1] - at.wanted.frequency) / self.tolerance


@documented
@dataclass(frozen=True)
class Steering(CostTerm):
    """Steering without a path or heading to follow, as a share of the greatest steering."""

    tolerance: float = parameter(0.2, "a_s, steering that weighs 1", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return at.scaled[2] / self.tolerance

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return whether there is neither path nor heading."""
        return float(not ahead.heads)


SUPPLIED: tuple[type[CostTerm], ...] = (Speed, Offset, Arrival, Heading, Change, Frequency, Steering)
TERMS: Mapping[str, type[CostTerm]] = MappingProxyType({term.__name__.lower(): term for term in SUPPLIED})
"""Terms by name; a plan's cost has all of them unless others are given.

Tolerances of offset (0.01 to 0.02), heading (0.05 to 0.1) and change of the steering (0.25 to 1) were tuned on the
default worm with the sensors' default noise: seven triples in runs of a minute on line, circle and S-curve with the
seeds 10 and 11, as many as for `control.baselines.Gains`. Mean rms offsets are 0.0017 (0.015 and 0.07) to 0.0021 body
lengths. The tolerance of the offset was then set to 0.01, because of b L^2/V. On a side slope of 2 degrees, which turns
worms, the offset is 0.0065 instead of 0.0081; with a push 0.026 instead of 0.030; on circles of 1.5 body lengths 0.0022
instead of 0.0020. A worm that begins beside the line reaches the line after 8.4 waves instead of 9.6 (means over the
seeds 10 to 14). The large miss of the speed (0.004 to 0.02 and none) is the value with which a worm that begins beside
the line reaches the line soonest, on the seeds 10 to 13, with a tolerance of 0.015: after 9.4 waves on average, with
0.012 after more than 10, with none after 9.6.
"""


def default_terms() -> tuple[CostTerm, ...]:
    """Return the supplied terms, each with the default tolerances."""
    return tuple(term() for term in TERMS.values())
