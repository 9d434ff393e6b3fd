"""Kernels of a joint: pitch, yaw and twist between two segments, their springs, dampers and hinge.

Coordinates: [p_{j-1} (3), g_{j-1}, th_{j-1}, p_j (3), g_j, th_j, p_{j+1} (3)] of the segments behind and ahead.
The dampers act on the strains for the hinge angle of the step, as the chambers' dampers act for a given command.

The derivatives use the spins w_1, w_2 of the frames, (E1). The strains depend only on the difference of the spins:

    (EJ1) ds_i = m_i.(w_2 - w_1),   m_twist = (t_1 + t_2)/(1 + t_1.t_2)
          m_pitch = t_2 x (d x t_1) + d_2 x (c - s d)/|d_1 + d_2|   with the mean d of (E5), m_yaw the same with u

Here s = c.d. An energy whose derivatives with respect to the strains are f_i has the moment m = sum f_i m_i. Let m' be
the change of m if only the second frame turns. The second variation of the energy at constant f_i is

    (EJ2) (w_2 - w_1).(m'(w_2' - w_1') + w_1' x m) + m.(dw_2' - dw_1')
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from worm3d.physics import elements
from worm3d.physics.kernels import losses
from worm3d.physics.kernels.layout import Layout

COORDINATES = 13
ROW = 16
"""Length of a row of derivatives, which is padded with zeros to two vectors."""

JOINT_LAYOUT = Layout(
    {
        "q": COORDINATES,
        "dq": COORDINATES,
        "t_ref": 6,  # of the segment behind, then of the segment ahead
        "d_ref": 6,
        "k": 3,  # pitch, yaw, twist
        "cross0": 1,
        "tau": 1,
        "span": 1,
        "dt": 1,
        "hinge": 1,  # at t_{n+1}
        "hinge_n": 1,
        "weights": 2,  # of s_n and s_{n-1} in the damper's s_hat
        "angles_n": 4,  # c.d, c.u, twist and sum of bends at t_n
        "angles_m": 4,  # at t_{n-1}
        "strain_hat": 3,  # of the dampers
        "strain_n": 3,  # at t_n, with the hinge of t_{n+1}
        "strain_old": 3,  # at t_n, with the hinge of t_n
    }
)


_REDUCED = ca.SX.sym("z", 9)
"""Edges behind and ahead (3 each), rolls behind and ahead, and sum of the bends. The strains depend only on these."""


def _reduced() -> ca.SX:
    """Return the variables in `_REDUCED` as a linear function of the coordinates."""
    return _reduced_of(JOINT_LAYOUT.symbols["q"])


def _reduced_of(q: ca.SX) -> ca.SX:
    return ca.vertcat(q[5:8] - q[0:3], q[10:13] - q[5:8], q[3], q[8], q[4] + q[9])


@cache
def _angles_of_reduced() -> ca.SX:
    return ca.vertcat(*elements.joint_angles(*_frames_of_reduced()), _REDUCED[8])


def _frames_of_reduced() -> list[elements.Frame]:
    z = _REDUCED
    return [elements.frame(z[3 * k : 3 * k + 3], z[6 + k], *_reference(k)) for k in range(2)]


def _reference(k: int) -> tuple[ca.SX, ca.SX]:
    rows = slice(3 * k, 3 * k + 3)
    return JOINT_LAYOUT.symbols["t_ref"][rows], JOINT_LAYOUT.symbols["d_ref"][rows]


@cache
def _angles() -> ca.SX:
    """Return c.d, c.u, twist and the sum of the bends, shape (4,)."""
    return ca.substitute(_angles_of_reduced(), _REDUCED, _reduced())


def _strains(angles: ca.SX, hinge: ca.SX) -> ca.SX:
    *turns, bends = ca.vertsplit(angles)
    return ca.vertcat(*elements.joint_strains(turns, bends, hinge, JOINT_LAYOUT.symbols["cross0"]))


def start() -> ca.Function:
    """Return the quantities that are known at the start of a step: the rows from "strain_hat" on (9)."""
    s = JOINT_LAYOUT.symbols
    known = (("angles_n", "hinge"), ("angles_m", "hinge"), ("angles_n", "hinge_n"))
    n, m, old = (_strains(s[at], s[hinge]) for at, hinge in known)
    hat = s["weights"][0] * n + s["weights"][1] * m
    return JOINT_LAYOUT.function("joint_start", {"strain_hat": hat, "strain_n": n, "strain_old": old})


@cache
def _potential() -> tuple[ca.SX, ca.SX]:
    """Return the potential, and the gradient padded with zeros."""
    phi = _energy(_strains_of(_angles_of_reduced()))
    at = ca.substitute([phi, _linear().T @ ca.gradient(phi, _REDUCED)], [_REDUCED], [_reduced()])
    return at[0], ca.vertcat(at[1], ca.SX.zeros(ROW - COORDINATES))


def _energy(strains: ca.SX) -> ca.SX:
    """Return the potential of springs and dampers [J]. `strains` has the shape (3,)."""
    s = JOINT_LAYOUT.symbols
    return ca.dot(s["k"] / 2.0, strains**2 + s["tau"] / s["span"] * (strains - s["strain_hat"]) ** 2)


def _strains_of(angles: ca.SX) -> ca.SX:
    return _strains(angles, JOINT_LAYOUT.symbols["hinge"])


def _linear() -> ca.SX:
    """Return the derivatives of `_reduced` with respect to the coordinates."""
    return ca.jacobian(_reduced(), JOINT_LAYOUT.symbols["q"])


def gradient() -> ca.Function:
    """Return the potential, and the gradient (13) padded with zeros (16)."""
    phi, slope = _potential()
    return JOINT_LAYOUT.function("joint_gradient", {"phi": phi, "gradient": slope})


_FRAMES = [elements.Frame(ca.SX.sym("l"), *(ca.SX.sym(axis, 3) for axis in "tdu")) for _ in range(2)]


@cache
def _derivatives() -> tuple[ca.SX, ca.SX]:
    """Return the derivatives of the strains times the square roots of their stiffnesses (13, 3), and the Hessian."""
    angles, strains = ca.SX.sym("angles", 4), ca.SX.sym("strains", 3)
    stiffness, force = ca.hessian(_energy(strains), strains)
    moments, bending = ca.horzcat(*_moments()), ca.jacobian(_strains_of(angles), angles[3])
    spins = [_spin(k) for k in range(2)]
    roots = ca.vertcat((spins[1] - spins[0]).T @ moments, bending.T) @ ca.sqrt(stiffness)
    curve = roots @ roots.T
    curve[:8, :8] += _curve(moments @ force, spins)
    curve[8, 8] += ca.dot(force, ca.jacobian(bending, angles[3]))
    curve = _linear().T @ ca.triu2symm(ca.triu(curve)) @ _linear()
    known = _angles_of_reduced()
    symbols = [strains, angles, *(part for frame in _FRAMES for part in frame)]
    values = [_strains_of(known), known, *(part for frame in _frames_of_reduced() for part in frame)]
    at = ca.substitute([_linear().T @ roots, ca.triu2symm(ca.triu(curve))], symbols, values)
    roots, curve = ca.substitute(at, [_REDUCED], [_reduced()])
    return roots, curve


def _moments() -> list[ca.SX]:
    """Return m of pitch, yaw and twist, (EJ1), each of shape (3,)."""
    f, g = _FRAMES
    c, found = ca.cross(f.t, g.t), []
    for own, other in ((f.d, g.d), (f.u, g.u)):
        size = ca.norm_2(own + other)
        mean = (own + other) / size
        found.append(ca.cross(g.t, ca.cross(mean, f.t)) + ca.cross(other, (c - ca.dot(c, mean) * mean) / size))
    return [*found, (f.t + g.t) / (1.0 + ca.dot(f.t, g.t))]


def _spin(k: int) -> ca.SX:
    """Return the derivatives of a segment's spin, (E1), with respect to `_REDUCED` without the bends, shape (3, 8)."""
    f, spin = _FRAMES[k], ca.SX.zeros(3, 8)
    spin[:, 3 * k : 3 * k + 3], spin[:, 6 + k] = (
        ca.skew(f.t) / f.length + f.t @ elements.holonomy(f, _reference(k)[0]).T,
        f.t,
    )
    return spin


def _curve(m: ca.SX, spins: list[ca.SX]) -> ca.SX:
    """Return the second variation (EJ2) as a matrix, shape (8, 8)."""
    axes, between = _FRAMES[1][1:], spins[1] - spins[0]
    turning = ca.jacobian(m, ca.vertcat(*axes)) @ ca.vertcat(*[-ca.skew(axis) for axis in axes])
    curve = between.T @ (turning @ between - ca.skew(m) @ spins[0])
    for k, (sign, f) in enumerate(zip((-1.0, 1.0), _FRAMES, strict=True)):
        edge, (of_edge, of_roll) = slice(3 * k, 3 * k + 3), elements.spin_change(f, _reference(k)[0], m)
        curve[edge, edge] += sign * of_edge
        curve[6 + k, edge] += sign * of_roll.T
    return curve


def hessian() -> ca.Function:
    """Return the outputs of `gradient`, and the whole Hessian row by row, padded with zeros (13 x 16)."""
    phi, slope = _potential()
    rows = ca.vertcat(_derivatives()[1], ca.SX.zeros(ROW - COORDINATES, COORDINATES))
    return JOINT_LAYOUT.function("joint_hessian", {"phi": phi, "gradient": slope, "hessian": rows})


def angles() -> ca.Function:
    """Return c.d, c.u, twist and the sum of the bends (4)."""
    return JOINT_LAYOUT.function("joint_angles", {"angles": _angles()})


LEDGER_TERMS = ("work_contract", "elastic", "viscous_loss", "numerical_loss")


def ledger() -> ca.Function:
    """Return the joint's terms of the energy ledger, in the order of `LEDGER_TERMS`, and its angles (4)."""
    s = JOINT_LAYOUT.symbols
    terms, firsts = ca.SX.zeros(len(LEDGER_TERMS)), _first_strains()
    now, before = s["strain_n"], s["strain_old"]
    strains, strains_before = (_strains(_angles(), s[name]) for name in ("hinge", "hinge_n"))
    for i in range(3):
        strain, first = strains[i], firsts[i]

        def energy(at: ca.SX, k: ca.SX = s["k"][i]) -> ca.SX:
            return k / 2.0 * at**2

        commanding = energy(now[i]) - energy(before[i])
        work, missed = losses.trapezoid(commanding, energy(strain) - energy(strains_before[i]))
        change, numerical = losses.spring(energy, strain, now[i], first)
        lost, off = losses.damper(s["tau"] * s["k"][i], strain - s["strain_hat"][i], s["span"], s["dt"], first)
        terms += ca.vertcat(work, commanding + change, lost, numerical + missed + off)
    return JOINT_LAYOUT.function("joint_ledger", {"terms": terms, "angles": _angles()})


def _first_strains() -> ca.SX:
    """Return the first-order change of the strains, shape (3,). The chain rule saves repeating the angles' formulas."""
    s, angles = JOINT_LAYOUT.symbols, ca.SX.sym("angles", 4)
    turned = ca.jtimes(_angles_of_reduced(), _REDUCED, _reduced_of(s["dq"]))
    turned = ca.substitute(turned, _REDUCED, _reduced())
    first = ca.jtimes(_strains_of(angles), angles, turned)
    return ca.substitute(first, angles, _angles())
