"""Reduced model: a worm's motion averaged over a wave, in symbolic form for both MPC and estimator.

Let v and w be the speed and turn rate caused by the gait, u the sideways speed, h the heading, f the frequency, A the
amplitude, s the steering in force, and L the body length. The identified map (`control.identification.identified`)
gives the distance d, the sideways drift c and the turn omega per wave. The lag n_v is in waves and T_w in seconds. Then

    x'  = (1 - slip) v cos(h) - u sin(h)        v' = (L f d(A, f, s) - v) f / n_v
    y'  = (1 - slip) v sin(h) + u cos(h)        w' = (gain f omega(A, f, s) - w) / T_w                        (R1)
    h'  = w + yaw_bias                          u  = L (f c(A, f, s) + D(f) w') + crab (1 - slip) v + drift
                                                s' = (s_asked - s) f / blend

x, y is the centre of mass. x, y and h exclude the rocking of a wave.

*Amplitude and frequency in force.* In (R1) A and f are the commanded values. The wave takes n_b waves (`BLEND`) to
follow them. An estimator knows the values in force, and uses

    v' = (L f d(A, f, s) - v) / T_v,   T_v = (n_v - n_b) / f_p                                                (R3)

The lag T_v is a time instead of a number of waves, since a worm on dry friction goes as far in a slow wave as in a
quick wave. When the wave stops, the worm stops after the lag of the chambers. T_v is 0.155 s for the default worm. The
best fits to stops and starts, averaged over phases, are 0.15 s from 0.5 Hz, 0.17 s from 0.8 Hz and 0.2 s from 1.2 Hz.

*Sideways speed.* D(f) w' is the sideways speed of a body that begins to turn and therefore bends more and more. A
steady wave does not have this speed. D decreases with the frequency (steep waves of the default worm: 0.14 s at 0.5 Hz,
0.06 at 0.8, -0.03 at 1.2), and vanishes for waves slower than the identified range. Without D, at 0.14 m/s, the error
of the estimated heading is up to 1 degree where an S-curve changes its curvature, and the offset of the worm from the
curve is 0.0038 body lengths instead of 0.0030 (seeds 10 to 14). The supplied map of the sine has no D. With 0.09, 0.04
and -0.03 s the offset at 0.08 m/s is 0.0021 instead of 0.0019.

*Steering.* `control.gaits.steering.WaveGenerator` leads the steering in force s to the commanded steering s_asked. This
lag is applied before the map, since the turn is not proportional to weak steering (`control.identification.surrogate`).
On paths of the default worm, the error of the turn rate of (R1) is 0.005 rad/s. With a single lag of 0.95 s after a map
in odd powers of the steering, it is 0.008 rad/s.

*Amplitudes outside the map.* Below the smallest identified amplitude, d, c and omega decrease in proportion to the
amplitude, since a worm without contraction rests. A wave of negative amplitude goes backwards
(`control.gaits.steering`, (S3)): d(-A) = -d(A), c(-A) = -c(A), omega(-A) = omega(A).

*Disturbances.* The states slip, yaw_bias, drift, crab and the gain of turning represent effects that the map does not
contain, such as a slope, another ground or a somewhat different worm. The model predicts them as constant, and the
estimator estimates them.
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
"""Longest step of the Runge-Kutta method, as a fraction of the shortest time constant."""


class ReducedState(NamedTuple):
    """State of the reduced model. Each field is an SX with one entry, or a number.

    x, y : centre of mass [m].
    heading : azimuth of the worm [rad].
    speed : speed v along the heading caused by the gait [m/s].
    turn_rate : turn rate w caused by the gait [rad/s].
    slip : share of v that is lost.
    yaw_bias : turn rate that the gait does not cause [rad/s].
    drift : speed to the left that the gait does not cause [m/s].
    steering : steering s in force, a hinge [rad], a bias, or a share of both.
    turn_gain : ratio of the worm's turn rate to the map's turn rate.
    crab : lasting angle of the motion to the left of the heading [rad].
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
    """Input of the reduced model: amplitude (negative backwards), frequency [Hz], and commanded steering.

    The steering is a hinge [rad], a bias, or a share of both.
    """

    amplitude: float | ca.SX
    frequency: float | ca.SX
    steering: float | ca.SX


INPUTS = len(ReducedInput._fields)


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """The reduced model of a worm as CasADi functions with named inputs and outputs."""

    mechanism: Mechanism
    """Mechanism that steers, a key of the identified maps."""
    dynamics: ca.Function
    """(state (S,), input (3,)) -> rate (S,) by (R1), with S = `STATES`."""
    output: ca.Function
    """(state, input) -> velocity of the centre of mass [m/s] and turn rate [rad/s], (3,)."""
    in_force: ca.Function
    """Like `dynamics`, but for a wave whose amplitude and frequency in force equal the commanded values, (R3)."""
    lag: float
    """Time constant T_v with which the speed follows the amplitude and frequency in force [s]."""
    longest_step: float
    """Longest time step of the Runge-Kutta method [s]."""

    @classmethod
    def of(cls, worm: Worm, identified: Identified, mechanism: Mechanism = "hinge") -> ReducedModel:
        """Return the model of a worm. ValueError if the worm cannot bend, or if the mechanism was not identified."""
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
        """Return the function (state, input) -> state after `dt` > 0 [s] of constant input.

        The Runge-Kutta method of fourth order is used.
        """
        if not dt > 0.0:
            raise ValueError(f"dt: got {dt!r} s, must be above 0")
        parts = int(np.ceil(dt / self.longest_step))
        begin, given = ca.SX.sym("state", STATES), ca.SX.sym("input", INPUTS)
        state = begin
        for _ in range(parts):
            state = self.advance(state, given, dt / parts)
        return ca.Function("step", [begin, given], [state], ["state", "input"], ["next"])

    def advance(self, state: ca.SX, given: ca.SX, dt: float | ca.SX, rate: ca.Function | None = None) -> ca.SX:
        """Return the state after one step of the fourth-order Runge-Kutta method. dt [s] is at most `longest_step`.

        `rate` is by default `dynamics`.
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
    """Return the rates (R1). The speed approaches the speed of the wave with the rate `follows` [1/s]."""
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
