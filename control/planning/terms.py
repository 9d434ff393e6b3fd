"""Terms of the cost of a plan, which express its goals and their weights.

A term is a frozen dataclass whose fields are tolerances. Its method `misses` returns deviations from the goal as CasADi
symbols, each divided by its tolerance. The cost of a plan is half the sum of the squares of all misses, at the end of
each step of the horizon. `.docs/guides/control.md` has an example of a user's term, `Thrift`. In Python a term is added
by `GaitMPC(worm, identified, model, terms=[*default_terms(), Thrift()])`.

Let V_ref, r, psi and f_0 be the requested speed, point of the path, heading and frequency. The supplied terms are

    speed    (V - V_ref)/a_V            heading   (h - psi + crab)/a_h,  crab = u / V_ref
    offset   e/a_e,  e = (p - r) . n    arrival   e_H sqrt(L/w)/a_e,  L = a_e/a_h                                (O4)
    change   (u_k - u_{k-1})/a_rate     frequency (f - f_0)/a_f             steering  s/a_s

Here p, h and V are the position, the heading, and the speed along the heading (slip subtracted) of the worm, s its
steering, and n(psi) = (-sin psi, cos psi) points to the left of the path. u_k are the inputs of step k.

*Crab angle.* The worm also moves to its left with a speed u. Therefore it must point to the right of the path by the
angle crab, so that its centre of mass follows the path. Since steering causes a part of u, the cost uses u of the
predicted state. With u of an earlier plan, crab angle and plan would oscillate, and the worm would not return to the
path as the cost predicts.

*Arrival* is the weighted offset e_H at the end of the horizon, and represents the cost of all later steps. For an
offset e over the distance s with free slope e', the integral of (e/a_e)^2 + (e'/a_h)^2 is smallest for e ~ exp(-s/L),
with L = a_e/a_h. The cost after the horizon is then e_H^2 L/a_e^2, as much as L/w steps of length w. Therefore an
offset decays over the distance L, however short the horizon is. If the estimate misses a turn rate b, an offset of b
L^2/V remains: there the steering for the offset cancels b. For the default worm, the turn rate is uncertain by 5
mrad/s, and this offset is 1.3 mm.

*Large misses.* The decay of a large offset takes a long distance: 2.7 L from 0.3 body lengths to 0.02. A worm far from
the path should go straight towards it. Therefore the cost of a heading miss m grows only linearly if m is large. With
b = 0.35 rad, five tolerances, it is

    (b/a_h)^2 (sqrt(1 + (m/b)^2) - 1),   half (m/a_h)^2 for a small m, (b/a_h) |m|/a_h for a large m          (O7)

The cost of a speed miss has the same form, with b = 5 a_V. A worm that is pushed, or that turns as sharply as possible,
cannot reach the requested speed. The square of this miss would outweigh the offset, and the plan would turn less.
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
from worm3d.values.documented import with_fields
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import Checked

MAX_CRAB = 0.3
"""Largest crab angle, between the body and the path, that the cost aims at [rad]."""
LEAST_WAY = 0.02
"""Smallest distance covered in a step that is used as a divisor [body lengths]."""


WALLED = 0.1
"""Factor of the misses of offset and heading where walls keep the worm on the path. With this factor the offset is
0.013 instead of 0.012 body lengths, and the rms error of the speed is 3.6 instead of 6.2 % (scene velocity_pipe, seeds
10 to 12)."""


@with_fields
class Wanted(NamedTuple):
    """Goals of the reference for the end of a step. Each field is an SX with one entry."""

    speed: ca.SX
    """Requested forward speed [m/s]."""
    x: ca.SX
    """x of the point of the path [m]. 0 without a path."""
    y: ca.SX
    """y of the point of the path [m]. 0 without a path."""
    heading: ca.SX
    """Heading of the path, or else the requested heading [rad]. 0 without either."""
    crab: ca.SX
    """Crab angle, to the right of this heading, per speed to the left [s/m]."""
    frequency: ca.SX
    """Frequency that suits the requested speed, scaled like the inputs."""
    left: ca.SX
    """Greatest allowed offset to the left of the path [m]."""
    right: ca.SX
    """Greatest allowed offset to the right of the path, a positive number [m]."""
    room_left: ca.SX
    """Greatest allowed offset of both ends of the body to the left of the path [m]."""
    room_right: ca.SX
    """Greatest allowed offset of both ends of the body to the right of the path, a positive number [m]."""


@with_fields
@dataclass(frozen=True, eq=False)
class Moment:
    """State of the worm at the end of a step and the goals for this instant, as CasADi symbols."""

    state: ReducedState
    """State of the reduced model: position, heading, speed, turn rate, steering and five constants."""
    given: ReducedInput
    """Inputs during the step: amplitude, frequency [Hz] and steering."""
    scaled: ca.SX
    """Scaled inputs, in [-1, 1], with the absolute value of the amplitude, shape (3,)."""
    before: ca.SX
    """Scaled inputs of the previous step, shape (3,)."""
    speed: ca.SX
    """Speed along the heading, with the slip subtracted [m/s]."""
    sideways: ca.SX
    """Speed to the left of the heading [m/s]."""
    turn_rate: ca.SX
    """Turn rate to the left [rad/s]."""
    roll: ca.SX
    """Greatest roll in a wave according to the identified map [rad]. 0 if the map does not contain the roll."""
    wanted: Wanted
    """Goals for this instant: speed, point and heading of the path, and bounds of the offset."""
    length: float
    """Length of the body [m]."""

    @property
    def offset(self) -> ca.SX:
        """Distance to the left of the path [m], e of (O4)."""
        wanted, state = self.wanted, self.state
        return (state.y - wanted.y) * ca.cos(wanted.heading) - (state.x - wanted.x) * ca.sin(wanted.heading)


class Part(Checked, ABC):
    """Base class of the terms of the cost and of the constraints."""

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return the factor of the values, as a scalar or an array with one factor per step.

        A factor of 0 means that the part does not apply.
        """
        return 1.0


class CostTerm(Part):
    """A term of the cost. It adds half the sum of its squared misses at the end of each step."""

    @abstractmethod
    def misses(self, at: Moment) -> ca.SX:
        """Return the misses divided by their tolerances, shape (M,)."""


def _levelled(miss: ca.SX, large: float) -> ca.SX:
    """Return a value whose half square is the cost (O7) of a miss, multiplied by the square of the tolerance."""
    return miss * ca.sqrt(2.0 / (1.0 + ca.sqrt(1.0 + (miss / large) ** 2)))


def _kept(ahead: Preview) -> float:
    """Return the factor for misses of the path. It is 0 without a path."""
    return ahead.follows * (WALLED if ahead.walled else 1.0)


@documented
@dataclass(frozen=True)
class Speed(CostTerm):
    """Miss of the speed."""

    tolerance: float = parameter(0.004, "a_V, miss of the speed that weighs 1", "body lengths/s", gt=0)
    large: float = parameter(0.02, "miss above which the cost is linear in the miss", "body lengths/s", gt=0)

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
        """Return the factor of the offset, which is 0 without a path."""
        return _kept(ahead)


@documented
@dataclass(frozen=True)
class Arrival(Offset):
    """Offset at the end of the horizon, which represents all later steps."""

    way: float = parameter(0.01 / 0.07, "L, length over which an offset decays to 37 %", "body lengths", gt=0)

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return the factor of each step, which is 0 except in the last step, and 0 without a path."""
        last = _kept(ahead) * np.sqrt(self.way / max(abs(float(ahead.way[-1])), LEAST_WAY))
        return np.append(np.zeros(len(ahead.way) - 1), last)


@documented
@dataclass(frozen=True)
class Heading(CostTerm):
    """Miss of the heading, including the crab angle that compensates the sideways motion."""

    tolerance: float = parameter(0.07, "a_h, miss of the heading that weighs 1", "rad", gt=0)
    large: float = parameter(0.35, "miss above which the cost is linear in the miss", "rad", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        crab = ca.fmax(-MAX_CRAB, ca.fmin(MAX_CRAB, at.wanted.crab * at.sideways))
        miss = at.state.heading - at.wanted.heading + crab
        return _levelled(miss, self.large) / self.tolerance

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return 1 if there is a path or a requested heading, otherwise 0."""
        return float(ahead.heads)


@documented
@dataclass(frozen=True)
class Change(CostTerm):
    """Change of the inputs between steps, as a share of half the range of each input."""

    amplitude: float = parameter(0.3, "a_rate, change of the amplitude that weighs 1", gt=0)
    frequency: float = parameter(0.2, "a_rate, change of the frequency that weighs 1", gt=0)
    steering: float = parameter(0.25, "a_rate, change of the steering that weighs 1", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the misses; see `CostTerm`."""
        return (at.scaled - at.before) / ca.DM([self.amplitude, self.frequency, self.steering])


@documented
@dataclass(frozen=True)
class Frequency(CostTerm):
    """Difference between the frequency and the preferred frequency, as a share of half the frequency range."""

    tolerance: float = parameter(1.0, "a_f, distance that weighs 1", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return (at.scaled[1] - at.wanted.frequency) / self.tolerance


@documented
@dataclass(frozen=True)
class Steering(CostTerm):
    """Steering in runs without a path or a requested heading, as a share of the greatest steering."""

    tolerance: float = parameter(0.2, "a_s, steering that weighs 1", gt=0)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return at.scaled[2] / self.tolerance

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return 1 if there is neither a path nor a requested heading, otherwise 0."""
        return float(not ahead.heads)


SUPPLIED: tuple[type[CostTerm], ...] = (Speed, Offset, Arrival, Heading, Change, Frequency, Steering)
TERMS: Mapping[str, type[CostTerm]] = MappingProxyType({term.__name__.lower(): term for term in SUPPLIED})
"""Supplied terms by name. By default a plan's cost has all of them.

The tolerances of offset (0.01 to 0.02), heading (0.05 to 0.1) and change of the steering (0.25 to 1) were tuned on the
default worm with default sensor noise. Seven triples were compared in runs of one minute on a line, a circle and an
S-curve with the seeds 10 and 11, as many runs as for `control.baselines.Gains`. Mean rms offsets were 0.0017 (offset
0.015, heading 0.07) to 0.0021 body lengths. The tolerance of the offset was then reduced to 0.01, because of the
remaining offset b L^2/V. This changed the offset from 0.0081 to 0.0065 on a side slope of 2 degrees, which turns worms,
from 0.030 to 0.026 with a push, and from 0.0020 to 0.0022 on circles of 1.5 body lengths. A worm that begins beside the
line reaches the line after 8.4 waves instead of 9.6 (means over the seeds 10 to 14).

The cost is linear in speed misses above a limit. This limit was chosen among 0.004 to 0.02 and infinity. With 0.02, a
worm that begins beside the line reaches the line soonest (seeds 10 to 13, with an offset tolerance of 0.015): after 9.4
waves on average. With 0.012 this takes more than 10 waves, and with infinity 9.6.
"""


def default_terms() -> tuple[CostTerm, ...]:
    """Return the supplied terms with default tolerances."""
    return tuple(term() for term in TERMS.values())
