"""Mass points in CasADi symbols: reference positions of the integrator, velocities, momenta and terms of the ledger.

Joints (`worm3d.physics.kernels.node`) and contact points (`worm3d.physics.kernels.point`) are mass points. The layout
of each kind contains the inputs `SIZES`, the position "x" and the "weight".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

SIZES = {
    "past": 6,  # X at t_n and t_{n-1}
    "velocity": 6,  # V at t_n and t_{n-1}
    "mass": 1,
    "dt": 1,
    "span": 1,  # beta dt, (1 + w)/(1 + 2 w) dt [s]
    "ratio": 1,  # w: this time step over the last time step, 0 for implicit Euler
    "lands": 1,  # 1 in a step in which a point strikes the world
}
Symbols = Mapping[str, ca.SX]


def weights(ratio: Any) -> tuple[Any, Any]:
    """Return the weights of t_n and t_{n-1} in the backward difference of the integrator.

    BDF2 takes the derivative at the end of a step from the parabola through the last three values. With w = dt/dt_old,

        x'_{n+1} = (x_{n+1} - (1 + w)^2/(1 + 2 w) x_n + w^2/(1 + 2 w) x_{n-1})/(beta dt),   beta = (1 + w)/(1 + 2 w)

    For equal steps, the weights are 4/3 and -1/3, and beta is 2/3. w = 0 is implicit Euler.
    """
    return (1.0 + ratio) ** 2 / (1.0 + 2.0 * ratio), -(ratio**2) / (1.0 + 2.0 * ratio)


def _weigh(s: Symbols, both: ca.SX) -> ca.SX:
    """Return the weighted sum of the values at t_n and t_{n-1} in the integrator's difference, shape (3,)."""
    w0, w1 = weights(s["ratio"])
    weighed: ca.SX = w0 * both[:3] + w1 * both[3:]
    return weighed


def still(s: Symbols) -> ca.SX:
    """Return the position at the end of the step for which the integrator's velocity is 0, shape (3,) [m]."""
    return _weigh(s, s["past"])


def coasting(s: Symbols) -> ca.SX:
    """Return "x_hat", the position at the end of the step for which the acceleration is 0, shape (3,) [m]."""
    return still(s) + s["span"] * _weigh(s, s["velocity"])


def force(s: Symbols) -> ca.SX:
    """Return mass times acceleration, shape (3,) [N]."""
    return s["inertia"] * (s["x"] - s["x_hat"])


def stiffness(s: Symbols) -> ca.SX:
    """Return m/(beta dt)^2 [N/m]."""
    return s["mass"] / s["span"] ** 2


def velocity(s: Symbols) -> ca.SX:
    """Return the velocity at the end of the step, shape (3,) [m/s]."""
    return (s["x"] - s["x_hat"]) / s["span"] + _weigh(s, s["velocity"])


def motion(s: Symbols) -> ca.SX:
    """Return X - X_n, shape (3,) [m]."""
    return s["x"] - s["past"][:3]


def mean_motion(s: Symbols) -> ca.SX:
    """Return dt (V + V_n)/2, the displacement with which a step's force does work on a free mass, shape (3,) [m]."""
    return 0.5 * s["dt"] * (velocity(s) + s["velocity"][:3])


def ledger(s: Symbols, first: ca.SX) -> dict[str, ca.SX]:
    """Return a mass point's terms of the energy ledger [J]; `first` is the first-order motion, shape (3,) [m].

    In a step with a strike, the contact also carries the weight. The impulse of the weight is not part of the impact.
    """
    v, v_n, v_m, mean = velocity(s), s["velocity"][:3], s["velocity"][3:], mean_motion(s)
    w = s["ratio"]
    e_v = w / (1.0 + w) * (v - (1.0 + w) * v_n + w * v_m)  # dt A - dV
    carried, moved = s["lands"] * ca.dot(s["weight"], first - mean), motion(s)
    lost = s["mass"] * ca.dot(e_v, mean) / s["dt"] + ca.dot(force(s), first - mean)
    return {
        "kinetic": 0.5 * s["mass"] * (ca.sumsqr(v) - ca.sumsqr(v_n)),
        "potential": -ca.dot(s["weight"], moved),
        "impact": carried,
        "numerical_loss": lost - ca.dot(s["weight"], first - moved) - carried,
    }


def momenta(s: Symbols) -> ca.SX:
    """Return momentum (3), angular momentum about the origin (3) and mass times position (3), at t_n."""
    x, p = s["past"][:3], s["mass"] * s["velocity"][:3]
    return ca.vertcat(p, ca.cross(x, p), s["mass"] * x)
