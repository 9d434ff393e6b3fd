"""Terms of the cost of a plan, found by name: what a plan is to achieve, and how much each miss weighs.

A term is a frozen dataclass with its tolerances as fields and its misses as symbols of CasADi; one of a user is
in `control/README.md`. In Python it is added by `GaitMPC(worm, identified, model, terms=[*default_terms(), Thrift()])`.

With the speed V_ref, point r, heading psi and frequency f_0 that are wanted, the terms that ship are

    speed    (V - V_ref)/a_V            heading   (h - psi + crab)/a_h,  crab = u / V_ref
    offset   e/a_e,  e = (p - r) . n    arrival   e_H sqrt(L/w)/a_e,  L = a_e/a_h                                (O4)
    change   (u_k - u_{k-1})/a_rate     frequency (f - f_0)/a_f             steering  s/a_s

V being the speed along the heading, less what slips, and n(psi) = (-sin psi, cos psi) the left of the path. The body
stands across its path by the angle crab, so that its centre of mass follows the path although it is carried to the left
by u. Steering itself carries it so, hence the cost takes u from the predicted state: with the u of an earlier plan,
crab angle and plan would oscillate, and a worm would come back to its line along another way than the cost says.

The arrival is that at the end of the horizon, and stands for all that comes later. Of an offset e over the way s whose
slope e' is free, int (e/a_e)^2 + (e'/a_h)^2 ds is least for e ~ exp(-s/L), L = a_e/a_h, and its cost from e_H on is
e_H^2 L/a_e^2: as much as L/w steps of the way w. An offset thus dies away over the way L, however short the horizon is.
A turn rate b that the estimate does not know leaves an offset of b L^2/V, where the steering that undoes it is what the
offset asks for: with 5 mrad/s, as much as a default worm's is unsure, 1.3 mm.

From afar that way is long: to bring 0.3 body lengths down to 0.02 it takes 2.7 L. A worm that is far off its path does
well to go straight for it, so that with b = 0.35 rad, five tolerances, a miss m of the heading costs

    (b/a_h)^2 (sqrt(1 + (m/b)^2) - 1),   half (m/a_h)^2 where it is small, (b/a_h) |m|/a_h where it is large   (O7)

A miss of the speed costs likewise, with b = 3 a_V. Where a worm is pushed or turns as sharply as it can, it has another
speed than is asked for whatever it does; squared, that miss would outweigh the offset, and shorten the waves that turn.
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
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.spelling import Spelled

MAX_CRAB = 0.3
"""Largest angle by which the body may stand across its path [rad]."""
LEAST_WAY = 0.02
"""Way in a step that a slower worm counts as going, where its way is divided by [body lengths]."""


WALLED = 0.1
"""Factor of a miss of the path where walls keep the worm to it: with it the offset is 0.013 in place of 0.012 body
lengths, and the rms error of the speed 3.6 in place of 6.2 % (scene velocity_pipe, seeds 10 to 12)."""


class Wanted(NamedTuple):
    """What the reference asks for at the end of a step; each is an SX of one entry."""

    speed: ca.SX
    """Speed forward [m/s]."""
    x: ca.SX
    """Point of the path [m]; 0 without a path."""
    y: ca.SX
    heading: ca.SX
    """Heading of the path, or the one asked for [rad]; 0 without either."""
    crab: ca.SX
    """Angle by which the body is to stand to the right of that heading, for each m/s of speed to the left [s/m]."""
    frequency: ca.SX
    """Frequency that suits the speed, scaled like the inputs."""
    left: ca.SX
    """Greatest offset to the left of the path that is allowed [m]."""
    right: ca.SX
    """Greatest offset to the right, as a positive number [m]."""
    room_left: ca.SX
    """Greatest offset to the left that is allowed to both ends of the body [m]."""
    room_right: ca.SX
    """Greatest offset of both ends to the right, as a positive number [m]."""


@dataclass(frozen=True, eq=False)
class Moment:
    """The worm at the end of a step and what is wanted of it there, in symbols of CasADi."""

    state: ReducedState
    given: ReducedInput
    """Inputs during the step: amplitude, frequency [Hz] and steering."""
    scaled: ca.SX
    """The inputs, the amplitude as its size, scaled to [-1, 1] over the ranges of the map, shape (3,)."""
    before: ca.SX
    """Scaled inputs of the step before, shape (3,)."""
    speed: ca.SX
    """Speed along the heading, less what slips [m/s]."""
    sideways: ca.SX
    """Speed to the left of the heading [m/s]."""
    turn_rate: ca.SX
    """Turn rate to the left [rad/s]."""
    roll: ca.SX
    """Greatest roll in a wave by the identified map [rad]; 0 where the map does not say."""
    wanted: Wanted
    length: float
    """Length of the body [m]."""

    @property
    def offset(self) -> ca.SX:
        """Distance to the left of the path [m], e of (O4)."""
        wanted, state = self.wanted, self.state
        return (state.y - wanted.y) * ca.cos(wanted.heading) - (state.x - wanted.x) * ca.sin(wanted.heading)


class CostTerm(Spelled, ABC):
    """A term of the cost: half the sum of squares of its misses at the end of each step."""

    @abstractmethod
    def misses(self, at: Moment) -> ca.SX:
        """Return the misses over their tolerances, shape (M,)."""

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return factors of the misses, one or one for each step: 0 where the reference does not ask for it."""
        return 1.0


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

    tolerance: float = parameter(0.004, unit="body lengths/s", gt=0, meaning="a_V, miss of the speed that weighs 1")
    large: float = parameter(
        0.02, unit="body lengths/s", gt=0, meaning="miss from which on the cost rises by the miss, no faster"
    )

    def __post_init__(self) -> None:
        check(self)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return _levelled((at.speed - at.wanted.speed) / at.length, self.large) / self.tolerance


@documented
@dataclass(frozen=True)
class Offset(CostTerm):
    """Offset from the path."""

    tolerance: float = parameter(0.01, unit="body lengths", gt=0, meaning="a_e, offset that weighs 1")

    def __post_init__(self) -> None:
        check(self)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return at.offset / (self.tolerance * at.length)

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return whether there is a path."""
        return _kept(ahead)


@documented
@dataclass(frozen=True)
class Arrival(CostTerm):
    """Offset at the end of the horizon, for what comes later."""

    tolerance: float = parameter(0.01, unit="body lengths", gt=0, meaning="a_e, that of the offset")
    way: float = parameter(0.01 / 0.07, unit="body lengths", gt=0, meaning="L, in which an offset dies away to 37 %")

    def __post_init__(self) -> None:
        check(self)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return at.offset / (self.tolerance * at.length)

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return the weight of the last step, if there is a path."""
        last = _kept(ahead) * np.sqrt(self.way / max(abs(float(ahead.way[-1])), LEAST_WAY))
        return np.append(np.zeros(len(ahead.way) - 1), last)


@documented
@dataclass(frozen=True)
class Heading(CostTerm):
    """Miss of the heading, the body standing across its path as far as it is carried sideways."""

    tolerance: float = parameter(0.07, unit="rad", gt=0, meaning="a_h, miss of the heading that weighs 1")
    large: float = parameter(0.35, unit="rad", gt=0, meaning="miss from which on the cost rises by the miss, no faster")

    def __post_init__(self) -> None:
        check(self)

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
    """Change of the inputs from step to step, each as a share of half its range."""

    amplitude: float = parameter(0.3, gt=0, meaning="a_rate, change of the amplitude that weighs 1")
    frequency: float = parameter(0.2, gt=0, meaning="a_rate, change of the frequency that weighs 1")
    steering: float = parameter(0.25, gt=0, meaning="a_rate, change of the steering that weighs 1")

    def __post_init__(self) -> None:
        check(self)

    def misses(self, at: Moment) -> ca.SX:
        """Return the misses; see `CostTerm`."""
        return (at.scaled - at.before) / ca.DM([self.amplitude, self.frequency, self.steering])


@documented
@dataclass(frozen=True)
class Frequency(CostTerm):
    """Distance of the frequency from the preferred one, as a share of half its range."""

    tolerance: float = parameter(1.0, gt=0, meaning="a_f, distance that weighs 1")

    def __post_init__(self) -> None:
        check(self)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return (at.scaled[1] - at.wanted.frequency) / self.tolerance


@documented
@dataclass(frozen=True)
class Steering(CostTerm):
    """Steering where nothing is to be followed, as a share of the greatest."""

    tolerance: float = parameter(0.2, gt=0, meaning="a_s, steering that weighs 1")

    def __post_init__(self) -> None:
        check(self)

    def misses(self, at: Moment) -> ca.SX:
        """Return the miss; see `CostTerm`."""
        return at.scaled[2] / self.tolerance

    def weight(self, ahead: Preview) -> ArrayLike:
        """Return whether there is neither path nor heading."""
        return float(not ahead.heads)


TERMS: Mapping[str, type[CostTerm]] = MappingProxyType(
    {
        "speed": Speed,
        "offset": Offset,
        "arrival": Arrival,
        "heading": Heading,
        "change": Change,
        "frequency": Frequency,
        "steering": Steering,
    }
)
"""Terms by name; a plan's cost has all of them unless others are given.

Tolerances of offset (0.01 to 0.02), heading (0.05 to 0.1) and change of the steering (0.25 to 1) were tuned on the
default worm with the sensors' default noise: seven triples in runs of a minute on line, circle and S-curve with the
seeds 10 and 11, as many as `control.baselines.Gains` had; mean rms offsets are 0.0017 (0.015 and 0.07) to 0.0021 body
lengths. The tolerance of the offset is 0.01 since then, for b L^2/V: a side slope of 2 degrees, which turns worms, has
0.0065 in place of 0.0081, a push 0.026 in place of 0.030, and a worm that begins apart joins its line after 8.4 waves
in place of 9.6; circles of 1.5 body lengths have 0.0022 in place of 0.0020 (means over the seeds 10 to 14).
The large miss of the speed (0.004 to 0.02 and none) is that with which a worm that begins apart from its line comes to
it soonest, on the seeds 10 to 13, with a tolerance of 0.015: after 9.4 waves on average, with 0.012 after more than 10,
with none after 9.6.
"""


def default_terms() -> tuple[CostTerm, ...]:
    """Return the terms that ship, each with its default tolerances."""
    return tuple(term() for term in TERMS.values())
