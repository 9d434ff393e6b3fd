"""Kinematics and elastic energies of the 3D linkage, in CasADi symbols. Each formula is written once.

The simulator's kernels, their derivatives and the controller's model are generated from these formulas.
Axes: x forward, y left, z up. Segment i has the end joints p_i and p_{i+1}, the roll g_i and the chamber bend th_i.

Frame (E1) of a segment: e = p_{i+1} - p_i, l = |e|, tangent t = e/l. The reference director d_ref is a unit vector
normal to the reference tangent t_ref. It is carried to t by parallel transport P and then turned about t by the roll g.
The result is the director d, which points left; u = t x d points up:

    P(a -> b) d = d - (d.b)/(1 + a.b) (a + b)
    d = cos(g) P(t_ref -> t) d_ref + sin(g) t x P(t_ref -> t) d_ref

If e and g change by de and dg, the frame turns by w = t x de/l + t (dg + a.de), a = -(t_ref x t)/((1 + t_ref.t) l).

Chambers (E2) lie at the lateral offsets +b (left) and -b (right). Their lengths are l_L = l - b th and l_R = l + b th.
Each chamber is a rhombus with links of length a, so that its half-height is h_c = sqrt(a^2 - l_c^2/4).

Apexes (E3) of a segment with the midpoint m = (p_i + p_{i+1})/2, in the order of NOTATION.md
[L-below, L-above, L-outward, R-below, R-above, R-outward]:

    below/above of chamber c: m +- b d -+ h_c u (upper sign of b: left),   outward: m +- w_c d,   w_c = b + h_c

Other segment laws (`worm3d.physics.segment_laws.law`) have other half-heights h_c and outward distances w_c.

End faces (E6) are discs of radius R across the ends of the worm. The point of a disc that is nearest to a wall with the
normal n is

    p + R (r_d d + r_u u),   (r_d, r_u) = -(n.d, n.u)/sqrt((n.d)^2 + (n.u)^2 + FACING^2)

If the disc faces the wall, this is the centre of the disc. r is chosen at the start of a step and fixed to the body
within the step, because friction acts on a material point of the worm, which turns with the worm. Inner joints touch
the world with R = 0, at the joint itself.

Springs (E4): the springs of a chamber have the energy k/2 l0/2 (1 - l_c/l_cmd)^2, half of (P7). The apex hinges of a
chamber have the energy k_apex/2 (angle_c - angle_0)^2 with angle = 2 asin(l_c/(2 a)); k_apex is the stiffness per
segment, and each of the two chambers has two hinges.

Joints (E5) between segments with the tangents t_1, t_2 and directors d_1, d_2. With c = t_1 x t_2 and the normalised
means d and u of the directors and normals of the two segments,

    pitch strain  c.d + cross0
    yaw strain    c.u - sin(th_1/2 + th_2/2 + hinge)
    twist strain  m = angle from the transported director P(t_1 -> t_2) d_1 to d_2, about t_2

Each strain has the energy k/2 strain^2. In the (x, z) plane, c.d is minus the cross product of the planar model.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

SIDE_SIGNS = (1.0, -1.0)
"""Sign of the lateral offset of the chambers [left, right]."""

FACING = 1e-3
"""Sine of the angle between face and wall below which the contact point moves from the rim to the centre."""


class Frame(NamedTuple):
    """A segment's length [m], tangent, lateral director (left) and normal (up), each of shape (3,)."""

    length: ca.SX
    t: ca.SX
    d: ca.SX
    u: ca.SX


def transport(a: ca.SX, b: ca.SX, d: ca.SX) -> ca.SX:
    """Return d carried from the unit vector a to the unit vector b by parallel transport, (E1); d is normal to a."""
    return d - ca.dot(d, b) / (1.0 + ca.dot(a, b)) * (a + b)


def frame(e: ca.SX, roll: ca.SX, t_ref: ca.SX, d_ref: ca.SX) -> Frame:
    """Return the material frame of a segment with e = p_{i+1} - p_i, (E1)."""
    length = ca.sqrt(ca.dot(e, e))
    t = e / length
    carried = transport(t_ref, t, d_ref)
    d = ca.cos(roll) * carried + ca.sin(roll) * ca.cross(t, carried)
    return Frame(length, t, d, ca.cross(t, d))


def holonomy(f: Frame, t_ref: ca.SX) -> ca.SX:
    """Return a of (E1), the rotation of the frame about t per change of e, shape (3,)."""
    return -ca.cross(t_ref, f.t) / ((1.0 + ca.dot(t_ref, f.t)) * f.length)


def spin_change(f: Frame, t_ref: ca.SX, m: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return derivatives of m.w, (E1), with respect to e at constant m.

    m.w is linear in de and dg. The results are the derivative of the coefficient of de, shape (3, 3), and the
    derivative of the coefficient of dg, shape (3,).
    """
    a, room = holonomy(f, t_ref), 1.0 + ca.dot(t_ref, f.t)
    across = (m - ca.dot(m, f.t) * f.t) / f.length
    of_a = -(ca.skew(t_ref) + a @ ((t_ref + f.t * (1.0 + room)) * f.length).T) / (room * f.length**2)
    of_t = ca.skew(m) @ (ca.SX.eye(3) - f.t @ f.t.T) - ca.cross(m, f.t) @ f.t.T
    return of_t / f.length**2 + a @ across.T + ca.dot(m, f.t) * of_a, across


def chamber_lengths(length: ca.SX, bend: ca.SX, offset: ca.SX) -> list[ca.SX]:
    """Return the lengths of the chambers [left, right], (E2) [m]."""
    return [length - side * offset * bend for side in SIDE_SIGNS]


def half_height(link: ca.SX, chamber_length: ca.SX) -> ca.SX:
    """Return the half-height of a chamber's rhombus, (E2) [m]."""
    return ca.sqrt(link**2 - chamber_length**2 / 4.0)


def apexes(middle: ca.SX, f: Frame, outlines: Sequence[tuple[ca.SX, ca.SX]], offset: ca.SX) -> list[ca.SX]:
    """Return the six apexes of a segment, (E3), each of shape (3,) [m].

    `middle` is (p_i + p_{i+1})/2. `outlines` are the half-height and the outward distance of each chamber [m].
    """
    points = []
    for side, (h, outward) in zip(SIDE_SIGNS, outlines, strict=True):
        centre = middle + side * offset * f.d
        points += [centre - h * f.u, centre + h * f.u, middle + side * outward * f.d]
    return points


def nearest_rim(f: Frame, normal: ca.SX) -> ca.SX:
    """Return r of (E6), shape (2,): the point of a face's rim nearest to a wall with the given normal."""
    across = ca.vertcat(ca.dot(normal, f.d), ca.dot(normal, f.u))
    return -across / ca.sqrt(ca.sumsqr(across) + FACING**2)


def face_point(p: ca.SX, f: Frame, radius: ca.SX, rim: ca.SX) -> ca.SX:
    """Return the point of an end face at r = `rim`, (E6), shape (3,) [m]."""
    return p + radius * (rim[0] * f.d + rim[1] * f.u)


def chamber_energy(k: ca.SX, l0: ca.SX, chamber_length: ca.SX, commanded: ca.SX) -> ca.SX:
    """Return the spring energy of one chamber, (E4) [J]."""
    return k / 2.0 * l0 / 2.0 * (1.0 - chamber_length / commanded) ** 2


def hinge_angle(link: ca.SX, chamber_length: ca.SX) -> ca.SX:
    """Return the angle of a chamber's apex hinges [rad]."""
    return 2.0 * ca.asin(chamber_length / (2.0 * link))


def hinge_energy(k_apex: ca.SX, angle: ca.SX, rest: ca.SX) -> ca.SX:
    """Return the energy of a chamber's apex hinges, (E4) [J]; `rest` is their rest angle."""
    return k_apex / 2.0 * (angle - rest) ** 2


def joint_angles(first: Frame, second: Frame) -> list[ca.SX]:
    """Return c.d, c.u and the twist m of a joint, (E5); `first` is the frame of the segment nearer the tail."""
    c = ca.cross(first.t, second.t)
    d, u = _mean(first.d, second.d), _mean(first.u, second.u)
    carried = transport(first.t, second.t, first.d)
    twist = ca.atan2(ca.dot(ca.cross(carried, second.d), second.t), ca.dot(carried, second.d))
    return [ca.dot(c, d), ca.dot(c, u), twist]


def joint_strains(angles: list[ca.SX], bends: ca.SX, hinge: ca.SX, cross0: ca.SX) -> list[ca.SX]:
    """Return pitch, yaw and twist strain of a joint, (E5).

    Parameters
    ----------
    angles : list of SX
        Result of `joint_angles`.
    bends : SX
        Sum of the segments' chamber bends, th_1 + th_2 [rad].
    hinge : SX
        Commanded hinge angle; positive yaws the headward segment to the left [rad].
    cross0 : SX
        Rest value of the planar cross product.
    """
    pitch, across, twist = angles
    return [pitch + cross0, across - ca.sin(bends / 2.0 + hinge), twist]


def _mean(a: ca.SX, b: ca.SX) -> ca.SX:
    total = a + b
    return total / ca.sqrt(ca.dot(total, total))
