"""Reduced model: a worm's motion averaged over a wave, in symbolic form for both MPC and estimator.

Pose and motion, with d, c and the turn omega a wave from the identified map (`control.identification.identified`), the
lags n_v in waves and T_w in seconds, f the frequency, L the body length:

    x'  = (1 - slip) v cos(h) - u sin(h)        v' = (L f d(A, f, s) - v) f / n_v
    y'  = (1 - slip) v sin(h) + u cos(h)        w' = (gain f omega(A, f, s) - w) / T_w                        (R1)
    h'  = w + yaw_bias                          u  = L (f c(A, f, s) + D(f) w') + crab (1 - slip) v + drift
                                                s' = (s_asked - s) f / blend

A and f are commanded, and the wave takes n_b waves (`BLEND`) to follow. With the values in force, which an estimator
knows,

    v' = (L f d(A, f, s) - v) / T_v,   T_v = (n_v - n_b) / f_p                                                (R3)

since a worm on dry friction goes as far in a slow wave as in a quick wave. When the wave stops, the worm stops after
the lag of the chambers. (T_v is 0.155 s for the default worm. The best fit to stops and starts, in the mean over
phases, is 0.15 s from 0.5 Hz, 0.17 from 0.8 and 0.2 from 1.2 Hz.)

D(f) w' is the sideways speed of a body that begins to turn and so bends more and more; a steady wave does not have this
speed. D falls with the frequency (steep waves of the default worm: 0.14 s at 0.5 Hz, 0.06 at 0.8, -0.03 at 1.2), and
fades for waves slower than the identified range. Without D the estimated heading of that worm, at 0.14 m/s, is up to 1
degree wrong where an S-curve changes curvature, and the worm is 0.0038 body lengths beside the curve instead of 0.0030
(seeds 10 to 14). The supplied map of the sine has no D: with 0.09, 0.04 and -0.03 s the distance from the curve at 0.08
m/s is 0.0021 instead of 0.0019.

s is the steering in force, which `control.gaits.steering.WaveGenerator` leads to the commanded steering. This lag comes
before the map, since weak steering turns a worm out of proportion (`control.identification.surrogate`). On paths of the
default worm (R1) misses the turn rate by 0.005 rad/s; a model with one lag of 0.95 s after a map in odd powers of the
steering misses the turn rate by 0.008. Below the least identified amplitude d, c and omega fade in proportion to the
amplitude: without contraction a worm rests. A wave of negative amplitude goes backwards (`control.gaits.steering`,
(S3)): d(-A) = -d(A), c(-A) = -c(A), omega(-A) = omega(A). The states slip, yaw_bias, drift, crab and the gain of
turning cover effects that the map does not contain (a slope, another ground, a somewhat different worm). They are
constant in the model, and estimated.

x, y is the centre of mass and h the heading, both without the rocking of a wave.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from control.gaits.steering import BLEND, PACE, GaitParameters, Mechanism
from control.identification.identified import Identified
from worm3d import Worm

IDENTIFIED = 0.8
"""Approximate frequency f_p at which the lag n_v was identified [Hz]."""
LONGEST_SUBSTEP = 0.5
"""Longest substep of Runge and Kutta, as a fraction of the shortest time constant."""


class ReducedState(NamedTuple):
    """State of the reduced model; each field is an SX of one entry, or a number.

    Centre of mass x, y [m] and azimuth [rad]; speed v along the azimuth [m/s] and turn rate w [rad/s] that the gait
    makes; the share of v that is lost; turn rate [rad/s] and speed to the left [m/s] that the gait does not make; the
    steering s in force, a hinge [rad] or a bias; the ratio of the worm's turn rate to the map's turn rate; the lasting
    angle of the motion to the left of the heading [rad].
    """

    x: float | ca.SX
    y: float | ca.SX
    heading: float | ca.SX
    speed: float | ca.SX
    turn_rate: float | ca.SX
    slip: float | ca.SX = 0.0
    yaw_bias: float | ca.SX = 0.0
    drift: float | ca.SX = 0.0
    steering: float | ca.SX = 0.0
    turn_gain: float | ca.SX = 1.0
    crab: float | ca.SX = 0.0


STATES = len(ReducedState._fields)
INDEX = {name: k for k, name in enumerate(ReducedState._fields)}
"""Index of each state by its name."""


class ReducedInput(NamedTuple):
    """Input of the reduced model: amplitude, below 0 backwards, frequency [Hz], and the commanded steering.

    The steering is a hinge [rad], a bias, or a share of both.
    """

    amplitude: float | ca.SX
    frequency: float | ca.SX
    steering: float | ca.SX


INPUTS = len(ReducedInput._fields)


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """Functions of a worm's reduced model, each with named inputs and outputs."""

    mechanism: Mechanism
    """Mechanism that steers, "hinge" or "bias"."""
    dynamics: ca.Function
    """(state (S,), input (3,)) -> rate (S,), S = `STATES`: (R1)."""
    output: ca.Function
    """(state, input) -> velocity of the centre of mass [m/s] and turn rate [rad/s], (3,)."""
    in_force: ca.Function
    """`dynamics` of a wave that already has the commanded amplitude and frequency."""
    lag: float
    """Time constant T_v of the speed behind the amplitude and frequency in force [s]."""
    longest_step: float
    """Longest time that one step of Runge and Kutta may span [s]."""

    @classmethod
    def of(cls, worm: Worm, identified: Identified, mechanism: Mechanism = "hinge") -> ReducedModel:
        """Return the model of a worm; ValueError if the worm cannot bend, or was not identified so."""
        if worm.chamber_offset == 0.0:
            raise ValueError("chamber_offset: got 0, must be above 0 for chamber lengths to tell how the body bends")
        if mechanism not in identified.maps:
            known = ", ".join(map(repr, identified.maps))
            raise ValueError(f"mechanism: got {mechanism!r}, must be one of those identified: {known}")
        state, given = ca.SX.sym("state", STATES), ca.SX.sym("input", INPUTS)
        symbols = ReducedState(*ca.vertsplit(state)), ReducedInput(*ca.vertsplit(given))
        lags, ranges = identified.lags[mechanism], identified.maps[mechanism].ranges
        lag = max(lags.amplitude - BLEND, 0.05) / IDENTIFIED
        pace = ca.fmax(symbols[1].frequency, ranges.frequency[0])  # feet that stick follow at once, however slowly
        rate = _rate(*symbols, worm, identified, mechanism, pace / lags.amplitude)
        followed = _rate(*symbols, worm, identified, mechanism, ca.SX(1.0 / lag))
        highest = ranges.frequency[1]
        fastest = max(highest / lags.amplitude, highest / BLEND, 1.0 / lags.steering)
        values = {"dynamics": rate, "output": rate[:3], "in_force": followed}
        named = {name: ca.Function(name, [state, given], [value]) for name, value in values.items()}
        return cls(mechanism, **named, lag=lag, longest_step=LONGEST_SUBSTEP / fastest)

    def step(self, dt: float) -> ca.Function:
        """Return (state, input) -> next state after `dt` > 0 [s] of constant input, by Runge-Kutta's fourth order."""
        if not dt > 0.0:
            raise ValueError(f"dt: got {dt!r} s, must be above 0")
        parts = int(np.ceil(dt / self.longest_step))
        begin, given = ca.SX.sym("state", STATES), ca.SX.sym("input", INPUTS)
        state = begin
        for _ in range(parts):
            state = self.advance(state, given, dt / parts)
        return ca.Function("step", [begin, given], [state], ["state", "input"], ["next"])

    def advance(self, state: ca.SX, given: ca.SX, dt: float | ca.SX, rate: ca.Function | None = None) -> ca.SX:
        """Return the state after one step of Runge and Kutta's fourth order; dt [s] up to `longest_step`.

        `rate` is `dynamics` if left out.
        """
        of = rate or self.dynamics
        k1 = of(state, given)
        k2 = of(state + dt / 2.0 * k1, given)
        k3 = of(state + dt / 2.0 * k2, given)
        k4 = of(state + dt * k3, given)
        return state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def parameters(self, given: ReducedInput) -> GaitParameters:
        """Return the gait parameters of an input."""
        amplitude, frequency, steering = map(float, given)
        return GaitParameters(amplitude, frequency).steered(self.mechanism, steering)


def _rate(
    s: ReducedState, u: ReducedInput, worm: Worm, identified: Identified, mechanism: Mechanism, follows: ca.SX
) -> ca.SX:
    """Return (R1); the speed approaches the speed of the wave at the rate `follows` [1/s]."""
    found, lags = identified.maps[mechanism], identified.lags[mechanism]
    least = found.ranges.amplitude[0]
    size, way = ca.fabs(u.amplitude), ca.if_else(u.amplitude < 0.0, -1.0, 1.0)
    known, fading = (ca.fmax(size, least), u.frequency, s.steering), ca.fmin(1.0, size / least)
    forward = (1.0 - s.slip) * s.speed
    sideways = way * fading * worm.length * found.drift_speed(*known) + s.crab * forward + s.drift
    speed_rate = (way * fading * worm.length * found.speed(*known) - s.speed) * follows
    turn_acceleration = (s.turn_gain * fading * found.turn_rate(*known) - s.turn_rate) / lags.steering
    pace = ca.fmax(u.frequency, found.ranges.frequency[0])
    sideways += worm.length * (lags.swing + lags.swing_rise * pace) * u.frequency / pace * turn_acceleration
    return ca.vertcat(
        forward * ca.cos(s.heading) - sideways * ca.sin(s.heading),
        forward * ca.sin(s.heading) + sideways * ca.cos(s.heading),
        s.turn_rate + s.yaw_bias,
        speed_rate,
        turn_acceleration,
        ca.SX.zeros(3),
        (u.steering - s.steering) * ca.fmax(u.frequency, PACE) / BLEND,
        ca.SX.zeros(2),
    )
