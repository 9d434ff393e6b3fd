"""Model of a crawling worm within a wave: chambers and hinges in, motion on flat ground out; symbolic.

Chambers and hinges follow their commands with the lag of the actuators. With (R2) they make the shape of the body,
about its centre of mass and its chord; the apexes below the chambers, (E3), and the end faces are its feet. Feet p at
x_p, y_p that reach h_p below the axis share the weight W like springs under a plate that pitches by a and rolls by b,

    N_p = W exp(z_p/d) / sum_q exp(z_q/d),   z_p = h_p - a x_p - b y_p                                        (CM1)
    sum_p N_p x_p = W k a,   sum_p N_p y_p = W k b                                                            (CM2)

since the weight has no moment about the centre of mass, but for the little that a tilt resists. d is the depth over
which load goes from one foot to another. In a step dt the body goes by D and turns by H, and foot p goes by r_p. An
implicit step of Euler balances forces and moments,

    m (D/dt - v)/dt = sum_p f_p,   (I H/dt + j - l)/dt = sum_p r_p x f_p,                                     (CM3)
    f_p = - N_p M^2 (r_p/dt) / sqrt(rho_p^2 + e^2)

with velocity v and angular momentum l before the step, that of the changing shape j, M = diag(mu_x, mu_l) along and
across the segment, mu_x forward or backward as the foot slides, the gauge rho_p of r_p/dt, (C7), and e that smooths
friction at rest. (CM2) and (CM3) are solved by a fixed number of iterations.

What it is worth, without a number fitted to motion: on the default worm a wave's way is 2 to 9 % short of the plant's.
Loads in a wave, from the plant's shapes, differ by 0.08 of the weight (rms) where they are 0.17. A bent body turns 1.8
times as much as in the plant, and a wave that is steered less than half as much: feet of the plant, whose load rocks,
slip at other instants. So layer 2 takes the place of head and tail from it, and the turn from (CP1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from control.estimation.reduced import FlatBody, flat_body
from worm3d import Friction, Worm

GRAVITY = 9.81
"""Acceleration of gravity [m/s^2]."""
DEPTH = 0.003
"""d of (CM1), for a worm of 1 m."""
TILT = 0.001
"""k of (CM2), for a worm of 1 m: 3 rad move the load by as many millimetres."""
SOFTER = (8.0, 5.0, 3.5, 2.5, 1.8, 1.4, 1.1, 1.0, 1.0)
"""Depths of the iterations of (CM2), as multiples of d: where one foot has all the load, Newton alone goes astray."""
SMOOTH = 0.004
"""e of (CM3) over the lateral coefficient [m/s], for a worm of 1 m."""
ROUNDS = 3
"""Iterations of (CM3), each with the coefficients of friction over speed of the one before."""


class ChamberState(NamedTuple):
    """Parts of the state of a worm of N segments."""

    place: ca.SX
    """Centre of mass x, y [m] and azimuth of the chord [rad], (3,)."""
    velocity: ca.SX
    """Velocity of the centre of mass in world axes [m/s], and angular momentum over moment of inertia [rad/s], (3,)."""
    lengths: ca.SX
    """Lengths of the chambers, left ones first [m], (2 N,)."""
    hinge: ca.SX
    """Hinges [rad], (N - 1,)."""
    tilt: ca.SX
    """Pitch a and roll b of (CM2), on which the next step does not depend, (2,)."""


@dataclass(frozen=True, eq=False)
class ChamberModel:
    """The model of a worm."""

    step: ca.Function
    """(state (n,), contractions of the left, of the right chambers and hinges (3 N - 1,), dt [s]) -> next state."""
    joints: ca.Function
    """state -> places of the joints in the world [m], (N + 1, 2)."""
    roll: ca.Function
    """state -> roll b of (CM2)."""

    @classmethod
    def of(cls, worm: Worm, friction: Friction | None = None, rounds: int = ROUNDS) -> ChamberModel:
        """Return the model of a worm on ground of some friction, the default one if left out."""
        n = worm.segments
        sizes = {"place": 3, "velocity": 3, "lengths": 2 * n, "hinge": n - 1, "tilt": 2}
        parts = ChamberState(**{name: ca.SX.sym(name, size) for name, size in sizes.items()})
        state, given, dt = ca.vertcat(*parts), ca.SX.sym("command", 3 * n - 1), ca.SX.sym("dt")
        after = ca.vertcat(*_after(parts, given, dt, worm, friction or Friction(), rounds))
        body = flat_body(worm, ca.reshape(parts.lengths, n, 2), parts.hinge)
        joints = _turned(body.joints, parts.place[2]) + ca.repmat(parts.place[:2].T, n + 1, 1)
        return cls(
            ca.Function("step", [state, given, dt], [ca.cse(after)], ["state", "command", "dt"], ["next"]),
            ca.Function("joints", [state], [joints], ["state"], ["joints"]),
            ca.Function("roll", [state], [parts.tilt[1]], ["state"], ["roll"]),
        )

    @property
    def size(self) -> int:
        """Number of numbers of the state."""
        return int(self.step.size1_in(0))


def _after(s: ChamberState, given: ca.SX, dt: ca.SX, worm: Worm, friction: Friction, rounds: int) -> ChamberState:
    """Return the state after a step."""
    n, m = worm.segments, worm.mass
    share = 1.0 - ca.exp(-dt / worm.actuator_lag) if worm.actuator_lag > 0.0 else 1.0
    lengths = s.lengths + share * (worm.l0 * (1.0 - given[: 2 * n]) - s.lengths)
    hinge = s.hinge + share * (given[2 * n :] - s.hinge)
    before = flat_body(worm, ca.reshape(s.lengths, n, 2), s.hinge)
    now = flat_body(worm, ca.reshape(lengths, n, 2), hinge)
    tilt, shares = _loads(now.feet, now.reach, worm.length)
    inertia = ca.sum1(now.mass * ca.sum2(now.masses**2))
    change = (now.masses - before.masses) / dt
    own = ca.sum1(now.mass * (before.masses[:, 0] * change[:, 1] - before.masses[:, 1] * change[:, 0]))
    own_velocity = (now.feet - before.feet) / dt
    momentum = ca.vertcat(m * _turned(s.velocity[:2].T, -s.place[2]).T, inertia * s.velocity[2] - own)
    twist = ca.vertcat(momentum[:2] / m, s.velocity[2])
    inert = ca.diag(ca.vertcat(m, m, inertia))
    for _ in range(rounds):
        drag, pull = _friction(now, m * GRAVITY * shares, own_velocity, twist, friction, worm)
        twist = ca.solve(drag + inert / dt, momentum / dt - pull)
    velocity = ca.vertcat(_turned(twist[:2].T, s.place[2]).T, twist[2])
    return ChamberState(s.place + dt * velocity, velocity + ca.vertcat(0, 0, own / inertia), lengths, hinge, tilt)


def _friction(
    body: FlatBody, loads: ca.SX, own: ca.SX, twist: ca.SX, friction: Friction, worm: Worm
) -> tuple[ca.SX, ca.SX]:
    """Return drag (3, 3) and pull (3,) so that forces and moment are -(drag twist + pull), near a twist, (CM3)."""
    x, y = body.feet[:, 0], body.feet[:, 1]
    vx, vy = twist[0] - twist[2] * y + own[:, 0], twist[1] + twist[2] * x + own[:, 1]
    cos, sin = ca.cos(body.azimuth), ca.sin(body.azimuth)
    along, across = cos * vx + sin * vy, cos * vy - sin * vx
    coefficients = friction.forward, friction.backward, friction.lateral
    ahead, back, side = (ca.SX(np.broadcast_to(mu, (worm.segments,))[list(body.of)]) for mu in coefficients)
    slow = SMOOTH * worm.length
    forward = (1.0 + along / ca.sqrt(along**2 + slow**2)) / 2.0
    mu = forward * ahead + (1.0 - forward) * back
    gauge = ca.sqrt((mu * along) ** 2 + (side * across) ** 2 + (slow * side) ** 2)
    c, d = loads * mu**2 / gauge, loads * side**2 / gauge
    xx, yy, xy = c * cos**2 + d * sin**2, c * sin**2 + d * cos**2, (c - d) * sin * cos
    turn_x, turn_y = xy * x - xx * y, yy * x - xy * y  # what a unit turn rate adds to the force of each foot
    rows = [
        ca.horzcat(ca.sum1(xx), ca.sum1(xy), ca.sum1(turn_x)),
        ca.horzcat(ca.sum1(xy), ca.sum1(yy), ca.sum1(turn_y)),
        ca.horzcat(ca.sum1(turn_x), ca.sum1(turn_y), ca.sum1(x * turn_y - y * turn_x)),
    ]
    fx, fy = xx * own[:, 0] + xy * own[:, 1], xy * own[:, 0] + yy * own[:, 1]
    return ca.vertcat(*rows), ca.vertcat(ca.sum1(fx), ca.sum1(fy), ca.sum1(x * fy - y * fx))


def _loads(feet: ca.SX, reach: ca.SX, length: float) -> tuple[ca.SX, ca.SX]:
    """Return the tilt (2,) and the shares of the weight (F,), (CM1) and (CM2), of a worm of some length [m]."""
    x, y, tilt, firm = feet[:, 0], feet[:, 1], ca.SX.zeros(2), TILT * length

    def shares(depth: float) -> ca.SX:
        z = (reach - tilt[0] * x - tilt[1] * y) / depth
        raised = ca.exp(z - ca.mmax(z))
        return raised / ca.sum1(raised)

    for softer in SOFTER:
        depth = softer * DEPTH * length
        w = shares(depth)
        mx, my = ca.sum1(w * x), ca.sum1(w * y)
        xx = (ca.sum1(w * x**2) - mx**2) / depth + firm
        yy = (ca.sum1(w * y**2) - my**2) / depth + firm
        xy = (ca.sum1(w * x * y) - mx * my) / depth
        gx, gy = mx - firm * tilt[0], my - firm * tilt[1]
        tilt = tilt + ca.vertcat(yy * gx - xy * gy, xx * gy - xy * gx) / (xx * yy - xy**2)
    return tilt, shares(DEPTH * length)


def _turned(places: ca.SX, angle: ca.SX) -> ca.SX:
    """Return places (K, 2) turned to the left by an angle."""
    cos, sin = ca.cos(angle), ca.sin(angle)
    return places @ ca.vertcat(ca.horzcat(cos, sin), ca.horzcat(-sin, cos))
