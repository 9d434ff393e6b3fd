"""Reduced model: a worm as its controller sees it, averaged over a wave; symbolic, for MPC and estimator alike.

Pose and motion, with d, c and the turn omega a wave from the identified map (`control.identification.identified`), the
lags n_v in waves and T_w in seconds, f the frequency, L the body length:

    x'  = (1 - slip) v cos(h) - u sin(h)        v' = (L f d(A, f, s) - v) f / n_v
    y'  = (1 - slip) v sin(h) + u cos(h)        w' = (gain f omega(A, f, s) - w) / T_w                        (R1)
    h'  = w + yaw_bias                          u  = L (f c(A, f, s) + D(f) w') + crab (1 - slip) v + drift
                                                s' = (s_asked - s) f / blend

A and f are asked for, and the wave takes n_b waves (`BLEND`) to follow. With those in force, which an estimator knows,

    v' = (L f d(A, f, s) - v) / T_v,   T_v = (n_v - n_b) / f_p                                                (R3)

since a worm on dry friction goes as far in a slow wave as in a quick one and stands when its wave does, but for the
time by which chambers follow their commands. (T_v is 0.155 s for the default worm; what fits its stops and starts, in
the mean over phases, is 0.15 s from 0.5 Hz, 0.17 from 0.8 and 0.2 from 1.2 Hz.)

D(f) w' is what a body adds that comes to turn, since it bends more and more: a steady wave has no part of it. D falls
with the frequency (steep waves of the default worm: 0.14 s at 0.5 Hz, 0.06 at 0.8, -0.03 at 1.2), and fades where waves
are slower than was identified. Without it that worm, at 0.14 m/s, takes its heading for up to 1 degree wrong wherever
an S-curve changes its curvature, and is 0.0038 body lengths beside it in place of 0.0030 (seeds 10 to 14). The sine's
map that ships has no D: with 0.09, 0.04 and -0.03 s it is 0.0021 in place of 0.0019 beside the curve at 0.08 m/s.

s is the steering in force, which `control.gaits.steering.WaveGenerator` leads to the steering asked for: before the
map, since weak steering turns a worm out of proportion (`control.identification.surrogate`). On paths of the default
worm (R1) misses the turn rate by 0.005 rad/s; one lag of 0.95 s after a map in odd powers of the steering, by 0.008.
Below the least amplitude that was identified d, c and omega fade in proportion to it: without contraction a worm rests.
A wave of negative amplitude goes backwards (`control.gaits.steering`, (S3)): d(-A) = -d(A), c(-A) = -c(A), omega(-A) =
omega(A).
slip, yaw_bias, drift, crab and the gain of turning are what the map does not know (a slope, another ground, a worm that
is somewhat different); they are constant in the model, and estimated.

x, y is the centre of mass and h the heading, both without the rocking of a wave. That is a matter of the body's shape,
which the strains give: with the inverse of (E2) and no strain in yaw (E5),

    l_i = (l_L + l_R)/2,   th_i = (l_R - l_L)/(2 b),   a_{i+1} - a_i = th_i/2 + th_{i+1}/2 + hinge            (R2)

are lengths, bends and azimuths a_i of the segments, and (E1), (E3) place joints and masses. Exact for a flat body whose
yaw joints are not strained. On the plant the joints of the default worm lie within 4 mm of it when chambers steer, and
within 12 mm when hinges do: the ground holds the feet back, and the yaw joints give way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from control.gaits.steering import BLEND, PACE, GaitParameters, Mechanism
from control.identification.identified import Identified
from worm3d import Worm
from worm3d.physics import elements

IDENTIFIED = 0.8
"""Frequency f_p at which the lag n_v was found, about [Hz]."""
LEAST_LAG = 0.05
"""Least lag of the speed behind the wave in force [waves]."""
LONGEST_SUBSTEP = 0.5
"""Longest substep of Runge and Kutta, as a fraction of the shortest time constant."""


class ReducedState(NamedTuple):
    """State of the reduced model; each is an SX of one entry, or a number.

    Centre of mass x, y [m] and azimuth [rad]; speed v along it [m/s] and turn rate w [rad/s] that the gait makes; the
    share of v that is lost; turn rate [rad/s] and speed to the left [m/s] that the gait does not make; the steering s
    in force, a hinge [rad] or a bias; the worm's turn rate over that of the map; the angle to the left of the heading
    at which it lastingly goes [rad].
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


class ReducedInput(NamedTuple):
    """Input of the reduced model: amplitude, below 0 backwards, frequency [Hz], and the steering asked for.

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
    """Time T_v by which the speed follows these [s]."""
    shape: ca.Function
    """(chamber_length (N, 2) [m], hinge (N-1,) [rad]) -> joints (N+1, 2) [m] with the centre of mass at the origin and
    the tail-to-head chord along x: (R2)."""
    longest_step: float
    """Longest time that one step of Runge and Kutta may span [s]."""

    @classmethod
    def of(cls, worm: Worm, identified: Identified, mechanism: Mechanism = "hinge") -> ReducedModel:
        """Return the model of a worm; ValueError if it was not identified with this mechanism."""
        if mechanism not in identified.maps:
            known = ", ".join(map(repr, identified.maps))
            raise ValueError(f"mechanism: got {mechanism!r}, must be one of those identified: {known}")
        state, given = ca.SX.sym("state", STATES), ca.SX.sym("input", INPUTS)
        symbols = ReducedState(*ca.vertsplit(state)), ReducedInput(*ca.vertsplit(given))
        lags, ranges = identified.lags[mechanism], identified.maps[mechanism].ranges
        lag = max(lags.amplitude - BLEND, LEAST_LAG) / IDENTIFIED
        pace = ca.fmax(symbols[1].frequency, ranges.frequency[0])  # how slowly so ever, feet that stick follow at once
        rate = _rate(*symbols, worm, identified, mechanism, pace / lags.amplitude)
        followed = _rate(*symbols, worm, identified, mechanism, ca.SX(1.0 / lag))
        names = ["state", "input"]
        highest = ranges.frequency[1]
        fastest = max(highest / lags.amplitude, highest / BLEND, 1.0 / lags.steering)
        return cls(
            mechanism,
            ca.Function("dynamics", [state, given], [rate], names, ["rate"]),
            ca.Function("output", [state, given], [rate[:3]], names, ["velocity"]),
            ca.Function("in_force", [state, given], [followed], names, ["rate"]),
            lag,
            body_shape(worm),
            LONGEST_SUBSTEP / fastest,
        )

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
    """Return (R1); the speed comes closer to that of the wave at the rate `follows` [1/s]."""
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


def body_shape(worm: Worm) -> ca.Function:
    """Return the body's shape from its chamber lengths and hinges, (R2); see `ReducedModel.shape`.

    Raises ValueError if the chambers lie on the centre line: their lengths do not tell the bend.
    """
    if worm.chamber_offset == 0.0:
        raise ValueError("chamber_offset: got 0, must be above 0 for chamber lengths to tell how the body bends")
    lengths, hinge = ca.SX.sym("chamber_length", worm.segments, 2), ca.SX.sym("hinge", max(worm.segments - 1, 0))
    azimuth = _azimuths(lengths, hinge, worm.chamber_offset)
    along = (lengths[:, 0] + lengths[:, 1]) / 2.0
    edges = [
        ca.vertcat(along[i] * ca.cos(azimuth[i]), along[i] * ca.sin(azimuth[i]), 0.0) for i in range(worm.segments)
    ]
    joints = [ca.SX.zeros(3)]
    for edge in edges:
        joints.append(joints[-1] + edge)
    com = sum(mass * place for mass, place in _masses(worm, joints, edges, lengths)) / worm.mass
    chord = joints[-1] - joints[0]
    cos, sin = chord[0] / ca.norm_2(chord[:2]), chord[1] / ca.norm_2(chord[:2])
    places = ca.horzcat(*(joint - com for joint in joints))[:2, :].T
    turned = places @ ca.vertcat(ca.horzcat(cos, -sin), ca.horzcat(sin, cos))
    return ca.Function("shape", [lengths, hinge], [turned], ["chamber_length", "hinge"], ["joints"])


def _azimuths(lengths: ca.SX, hinge: ca.SX, offset: float) -> list[ca.SX]:
    """Return the azimuths of the segments against the tail's, (R2)."""
    bend = (lengths[:, 1] - lengths[:, 0]) / (2.0 * offset)
    azimuth = [ca.SX(0)]
    for j in range(hinge.numel()):
        azimuth.append(azimuth[-1] + bend[j] / 2.0 + bend[j + 1] / 2.0 + hinge[j])
    return azimuth


def _masses(worm: Worm, joints: list[ca.SX], edges: list[ca.SX], lengths: ca.SX) -> Iterator[tuple[float, ca.SX]]:
    yield from zip(worm.joint_mass.tolist(), joints, strict=True)
    ahead, left = ca.SX([1, 0, 0]), ca.SX([0, 1, 0])
    for i, edge in enumerate(edges):
        f = elements.frame(edge, ca.SX(0), ahead, left)
        middle, chambers = (joints[i] + joints[i + 1]) / 2.0, [lengths[i, 0], lengths[i, 1]]
        places = elements.apexes(middle, f, chambers, ca.SX(worm.link_length[i]), ca.SX(worm.chamber_offset))
        yield from zip(worm.apex_mass[i].tolist(), places, strict=True)
