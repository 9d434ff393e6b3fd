"""Reduced model: a worm's motion averaged over each wave, in symbolic form for model predictive control and estimator.

The states are the pose x, y, h, the speed v, the turn rate w, the steering s in force, and five constants (see
`ReducedState`); u is the speed to the left. The identified map (`control.identification.identified`) gives the distance
d and the sideways drift c per wave [body lengths] and the turn omega per wave [rad]. n_v is the lag of the speed in
waves, T_w the lag of the turn rate in seconds, f the frequency, A the amplitude, and L the body length:

    x'  = (1 - slip) v cos(h) - u sin(h)        v' = (L f d(A, f, s) - v) f / n_v
    y'  = (1 - slip) v sin(h) + u cos(h)        w' = (gain f omega(A, f, s) - w) / T_w                        (R1)
    h'  = w + yaw_bias                          u  = L (f c(A, f, s) + D(f) w') + crab (1 - slip) v + drift
                                                s' = (s_asked - s) f / blend

In (R1), A and f are the commanded values, and s_asked is the commanded steering. The actual wave approaches commanded
values within n_b waves (blend = n_b = `BLEND`). An estimator knows the values that the wave has at present (the values
"in force"), and uses, with these values,

    v' = (L f d(A, f, s) - v) / T_v,   T_v = (n_v - n_b) / f_p                                                (R3)

where f_p is `IDENTIFIED`. This lag is a time and not a number of waves: when the wave stops, the worm stops after the
lag of the chambers. T_v is 0.155 s for the default worm. The time constants fitted to simulated stops and starts, as
means over the phase of the wave, are 0.15 s at 0.5 Hz, 0.17 s at 0.8 Hz and 0.2 s at 1.2 Hz.

D(f) w' is the sideways speed of a body whose bend increases because the body begins to turn. In a steady wave this
speed is zero. D falls with the frequency (default worm with the steep wave: 0.14 s at 0.5 Hz, 0.06 s at 0.8 Hz, -0.03 s
at 1.2 Hz), and goes to zero with the frequency below the identified range. The effect was measured with the steep wave
at 0.14 m/s on an S-curve (seeds 10 to 14): without D the estimated heading is wrong by up to 1 degree where the
curvature changes sign, and the distance of the worm from the curve is 0.0038 body lengths; with D the distance is
0.0030. The supplied map of the sine wave has D = 0, because D does not help there: with D of 0.09, 0.04 and -0.03 s at
the three frequencies, the distance from the curve at 0.08 m/s is 0.0021 body lengths instead of 0.0019.

`control.gaits.steering.WaveGenerator` leads the steering in force, s, to the commanded steering. In the model this lag
comes before the map, because the turn is not proportional to weak steering (`control.identification.surrogate`). On
paths of the default worm, the turn rate of (R1) has an error of 0.005 rad/s. A model with a single lag of 0.95 s after
a map in odd powers of the steering has an error of 0.008 rad/s.

Below the smallest identified amplitude d, c and omega are proportional to the amplitude, so that a worm without
contraction rests. A wave of negative amplitude moves the worm backwards (`control.gaits.steering`, (S3)):
d(-A) = -d(A), c(-A) = -c(A), omega(-A) = omega(A). The states slip, yaw_bias, drift, crab and turn_gain ("gain" above)
represent effects that the map does not contain (a slope, another ground, a somewhat different worm). They are constant
in the model, and the estimator estimates them.

x, y is the centre of mass and h the heading. Neither includes the periodic rocking within a wave.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from control.gaits.steering import BLEND, PACE, GaitParameters, Mechanism
from control.identification.identified import Identified
from worm3d import Worm
from worm3d.values.documented import with_fields

IDENTIFIED = 0.8
"""The lag n_v was identified at about this frequency f_p [Hz]."""
LONGEST_SUBSTEP = 0.5
"""Longest substep of the Runge-Kutta method, as a fraction of the shortest time constant."""


@with_fields
class ReducedState(NamedTuple):
    """State of the reduced model; each field is an SX of one entry, or a number."""

    x: float | ca.SX
    """x of the centre of mass [m]."""
    y: float | ca.SX
    """y of the centre of mass [m]."""
    heading: float | ca.SX
    """Azimuth h of the body [rad]."""
    speed: float | ca.SX
    """Speed v along the azimuth that the gait causes, without slip [m/s]."""
    turn_rate: float | ca.SX
    """Turn rate w that the gait causes [rad/s]."""
    slip: float | ca.SX = 0.0
    """Relative loss of speed: the worm moves at (1 - slip) v, while the map predicts v."""
    yaw_bias: float | ca.SX = 0.0
    """Turn rate that the gait does not cause [rad/s]."""
    drift: float | ca.SX = 0.0
    """Speed to the left that the gait does not cause [m/s]."""
    steering: float | ca.SX = 0.0
    """Steering s in force: a hinge angle [rad], a bias, or a fraction of both."""
    turn_gain: float | ca.SX = 1.0
    """Ratio of the worm's turn rate to the map's turn rate."""
    crab: float | ca.SX = 0.0
    """Constant angle from the heading to the direction of motion, positive to the left [rad]."""


STATES = len(ReducedState._fields)
INDEX = {name: k for k, name in enumerate(ReducedState._fields)}
"""Index of each state by its name."""


@with_fields
class ReducedInput(NamedTuple):
    """Input of the reduced model: the commanded wave."""

    amplitude: float | ca.SX
    """Amplitude A; a negative amplitude moves the worm backwards."""
    frequency: float | ca.SX
    """Frequency f [Hz]."""
    steering: float | ca.SX
    """Commanded steering: a hinge angle [rad], a bias, or a fraction of both."""


INPUTS = len(ReducedInput._fields)


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """The reduced model of a worm as CasADi functions with named inputs and outputs."""

    mechanism: Mechanism
    """Mechanism that steers the worm: "hinge", "bias" or "both"."""
    dynamics: ca.Function
    """Time derivative of the state by (R1): state (S,), input (3,) -> rate (S,), with S = `STATES`."""
    output: ca.Function
    """Velocity of the centre of mass [m/s] and turn rate [rad/s]: state (S,), input (3,) -> (3,)."""
    in_force: ca.Function
    """The same as `dynamics`, but with the speed by (R3): the wave already has the amplitude and frequency of the
    input."""
    lag: float
    """Time constant T_v of (R3) [s]."""
    longest_step: float
    """Longest time step for one step of the Runge-Kutta method [s]."""

    @classmethod
    def of(cls, worm: Worm, identified: Identified, mechanism: Mechanism = "hinge") -> ReducedModel:
        """Return the model of a worm.

        Raises
        ------
        ValueError
            The worm cannot bend, or its map does not contain the mechanism.
        """
        if worm.chamber_offset == 0.0:
            raise ValueError(
                "chamber_offset: got 0, must be above 0: otherwise the chamber lengths do not determine the body's bend"
            )
        if mechanism not in identified.maps:
            known = ", ".join(map(repr, identified.maps))
            raise ValueError(f"mechanism: got {mechanism!r}, must be one of the identified mechanisms: {known}")
        state, given = ca.SX.sym("state", STATES), ca.SX.sym("input", INPUTS)
        symbols = ReducedState(*ca.vertsplit(state)), ReducedInput(*ca.vertsplit(given))
        lags, ranges = identified.lags[mechanism], identified.maps[mechanism].ranges
        lag = max(lags.amplitude - BLEND, 0.05) / IDENTIFIED
        # Below the identified frequencies the feet stick, and the lag does not increase further.
        pace = ca.fmax(symbols[1].frequency, ranges.frequency[0])
        rate = _rate(*symbols, worm, identified, mechanism, pace / lags.amplitude)
        followed = _rate(*symbols, worm, identified, mechanism, ca.SX(1.0 / lag))
        highest = ranges.frequency[1]
        fastest = max(highest / lags.amplitude, highest / BLEND, 1.0 / lags.steering)
        values = {"dynamics": rate, "output": rate[:3], "in_force": followed}
        named = {name: ca.Function(name, [state, given], [value]) for name, value in values.items()}
        return cls(mechanism, **named, lag=lag, longest_step=LONGEST_SUBSTEP / fastest)

    def step(self, dt: float) -> ca.Function:
        """Return the function (state, input) -> state after the time `dt` > 0 [s], with constant input.

        The function uses the classical Runge-Kutta method of fourth order, with substeps of at most `longest_step`.
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
        """Return the state after one step `dt` [s] of the classical Runge-Kutta method of fourth order.

        `dt` must not exceed `longest_step`. `rate` is the time derivative of the state, by default `dynamics`.
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
    """Return the time derivative of the state by (R1); the speed approaches L f d at the rate `follows` [1/s]."""
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
