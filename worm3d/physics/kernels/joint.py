"""Kernels of a joint: pitch, yaw and twist between two segments, their springs, dampers and hinge.

Coordinates: [p_{j-1} (3), g_{j-1}, th_{j-1}, p_j (3), g_j, th_j, p_{j+1} (3)] of the segments behind and ahead.
The dampers act on the strains at the hinge angle of the step, as those of the chambers act at a given command.
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from worm3d.physics import elements
from worm3d.physics.kernels import losses
from worm3d.physics.kernels.layout import Layout

COORDINATES = 13
STRAINS = 3
ROW = 16
"""Length of a row of derivatives, with zeros at its end: two vectors."""
_FILLING = ca.SX.zeros(ROW - COORDINATES)

LAYOUT = Layout(
    {
        "q": COORDINATES,
        "dq": COORDINATES,
        "t_ref": 6,  # of the segment behind, then of the one ahead
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
        "angles_m": 4,  # and at t_{n-1}
        "strain_hat": 3,  # of the dampers
        "strain_n": 3,  # at t_n, with the hinge of t_{n+1}
        "strain_old": 3,  # with that of t_n
    }
)


_REDUCED = ca.SX.sym("z", 9)
"""Edges behind and ahead (3 each), rolls behind and ahead, sum of the bends: all that the strains depend on."""


def _reduced() -> ca.SX:
    """Return `_REDUCED` as the linear function of the coordinates that it is."""
    return _reduced_of(LAYOUT.symbols["q"])


def _reduced_of(q: ca.SX) -> ca.SX:
    return ca.vertcat(q[5:8] - q[0:3], q[10:13] - q[5:8], q[3], q[8], q[4] + q[9])


@cache
def _angles_of_reduced() -> ca.SX:
    z = _REDUCED
    frames = [elements.frame(z[3 * k : 3 * k + 3], z[6 + k], *_reference(k)) for k in range(2)]
    return ca.vertcat(*elements.joint_angles(*frames), z[8])


def _reference(k: int) -> tuple[ca.SX, ca.SX]:
    rows = slice(3 * k, 3 * k + 3)
    return LAYOUT.symbols["t_ref"][rows], LAYOUT.symbols["d_ref"][rows]


@cache
def _angles() -> ca.SX:
    """c.d, c.u, twist and the sum of the bends, shape (4,)."""
    return ca.substitute(_angles_of_reduced(), _REDUCED, _reduced())


def _strains(angles: ca.SX, hinge: ca.SX) -> list[ca.SX]:
    *turns, bends = ca.vertsplit(angles)
    return elements.joint_strains(turns, bends, hinge, LAYOUT.symbols["cross0"])


def start() -> ca.Function:
    """Return what is known at the start of a step, the rows from "strain_hat" on (9)."""
    s = LAYOUT.symbols
    n, m, old = (ca.vertcat(*_strains(s[at], s[hinge])) for at, hinge in _KNOWN)
    hat = s["weights"][0] * n + s["weights"][1] * m
    return LAYOUT.function("joint_start", {"strain_hat": hat, "strain_n": n, "strain_old": old})


_KNOWN = (("angles_n", "hinge"), ("angles_m", "hinge"), ("angles_n", "hinge_n"))
"""Angles and hinge at which `start` takes the strains."""


@cache
def _potential() -> tuple[ca.SX, ca.SX, ca.SX]:
    """Potential, gradient, and the strains' derivatives (3, 13), each times the root of its stiffness in the step."""
    s, strains = LAYOUT.symbols, ca.vertcat(*_strains(_angles_of_reduced(), LAYOUT.symbols["hinge"]))
    damped = s["tau"] / s["span"]
    phi = ca.dot(s["k"] / 2.0, strains**2 + damped * (strains - s["strain_hat"]) ** 2)
    root, L = ca.diag(ca.sqrt(s["k"] * (1.0 + damped))), ca.jacobian(_reduced(), s["q"])
    parts = [phi, L.T @ ca.gradient(phi, _REDUCED), root @ ca.jacobian(strains, _REDUCED) @ L]
    at = ca.substitute(parts, [_REDUCED], [_reduced()])
    return at[0], ca.vertcat(at[1], _FILLING), ca.vertcat(at[2].T, ca.SX.zeros(ROW - COORDINATES, STRAINS))


def gradient() -> ca.Function:
    """Return potential and gradient (13), filled up with zeros (16)."""
    phi, slope, _ = _potential()
    return LAYOUT.function("joint_gradient", {"phi": phi, "gradient": slope})


def roots() -> ca.Function:
    """Return what `gradient` does, and three rows J (13), each filled up likewise.

    J^T J is Gauss-Newton's Hessian, without the second derivatives of the strains.
    """
    phi, slope, roots = _potential()
    return LAYOUT.function("joint_roots", {"phi": phi, "gradient": slope, "roots": roots})


def hessian() -> ca.Function:
    """Return what `gradient` does, and the whole Hessian, row by row, each filled up likewise (13 x 16)."""
    phi, slope, _ = _potential()
    rows = ca.vertcat(ca.hessian(phi, LAYOUT.symbols["q"])[0], ca.SX.zeros(ROW - COORDINATES, COORDINATES))
    return LAYOUT.function("joint_hessian", {"phi": phi, "gradient": slope, "hessian": rows})


def angles() -> ca.Function:
    """Return c.d, c.u, twist and the sum of the bends (4)."""
    return LAYOUT.function("joint_angles", {"angles": _angles()})


LEDGER_TERMS = ("work_contract", "elastic", "viscous_loss", "numerical_loss")


def ledger() -> ca.Function:
    """Return the joint's terms of the energy ledger, in the order of `LEDGER_TERMS`, and its angles (4)."""
    s = LAYOUT.symbols
    terms, firsts = ca.SX.zeros(len(LEDGER_TERMS)), _first_strains()
    now, before = s["strain_n"], s["strain_old"]
    strains, strains_before = (_strains(_angles(), s[name]) for name in ("hinge", "hinge_n"))
    for i, strain in enumerate(strains):
        first = firsts[i]

        def energy(at: ca.SX, k: ca.SX = s["k"][i]) -> ca.SX:
            return k / 2.0 * at**2

        commanding = energy(now[i]) - energy(before[i])
        work, missed = losses.trapezoid(commanding, energy(strain) - energy(strains_before[i]))
        change, numerical = losses.spring(energy, strain, now[i], first)
        lost, off = losses.damper(s["tau"] * s["k"][i], strain - s["strain_hat"][i], s["span"], s["dt"], first)
        terms += ca.vertcat(work, commanding + change, lost, numerical + missed + off)
    return LAYOUT.function("joint_ledger", {"terms": terms, "angles": _angles()})


def _first_strains() -> ca.SX:
    """Return the first-order motion of the strains, shape (3,): through the angles, which take the most to derive."""
    s, angles = LAYOUT.symbols, ca.SX.sym("angles", 4)
    turned = ca.jtimes(_angles_of_reduced(), _REDUCED, _reduced_of(s["dq"]))
    turned = ca.substitute(turned, _REDUCED, _reduced())
    first = ca.jtimes(ca.vertcat(*_strains(angles, s["hinge"])), angles, turned)
    return ca.substitute(first, angles, _angles())
