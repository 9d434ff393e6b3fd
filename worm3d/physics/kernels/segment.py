"""Kernels of a segment. They compute 8 contact points and the chambers from 8 coordinates, and the resulting forces.

Coordinates: [p_i (3), roll g, bend th, p_{i+1} (3)]. The roll is relative to the director at the start of the step.
Points: the six apexes in the order of NOTATION.md, the tail face and the head face. The coordinates of the points are
ordered axis by axis, in row 8 axis + point. The rows of an axis are therefore consecutive points for the kernels of
`worm3d.physics.kernels.point`.

If all mass is on the axis, the roll of the whole worm has no inertia. A damper then resists the roll g of each step,
with the potential C g^2/(2 dt) and the loss C g^2/dt.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import casadi as ca

from worm3d.physics import elements
from worm3d.physics.kernels import losses
from worm3d.physics.kernels.layout import Layout

POINTS_PER_SEGMENT = 8
"""Number of contact points of a segment: six apexes and two end faces."""
COORDINATES = 8

SEGMENT_LAYOUT = Layout(
    {
        "q": COORDINATES,
        "dq": COORDINATES,  # motion of q in the step
        "t_ref": 3,
        "d_ref": 3,
        "link": 1,
        "offset": 1,
        "radius": 2,  # of the faces at p_i and p_{i+1}
        "normal": 6,  # of the world at the faces, one after the other
        "rim": 4,  # r of (E6), in the same order
        "k": 1,
        "k_apex": 1,
        "l0": 1,
        "tau": 1,  # Kelvin-Voigt time [s]
        "roll_damping": 1,  # C [N m s], 0 where roll has inertia
        "span": 1,  # beta dt [s]
        "dt": 1,
        "weights": 2,  # of s_n and s_{n-1} in s_hat
        "commanded": 2,  # rest length of each chamber at t_{n+1}
        "force": 2,  # chamber forces at t_{n+1}
        "length_hat": 2,  # of the damper
        "angle_hat": 2,
        "commanded_n": 2,
        "length_n": 2,
        "angle_n": 2,
        "f": 3 * POINTS_PER_SEGMENT,  # gradient of the potential in the points
        "of_points": 2 * POINTS_PER_SEGMENT,  # numbers that the kernel of each point leaves before the next rows
        "f_ahead": 3 * POINTS_PER_SEGMENT,  # f predicted by Newton's method, for the second derivatives
        "K": 9 * POINTS_PER_SEGMENT,  # Hessian of the potential, row 8 (3 r + c) + point
    }
)


_REDUCED = ca.SX.sym("z", COORDINATES)
"""Midpoint (3), edge p_{i+1} - p_i (3), roll and bend. Derivatives with respect to these have the shortest formulas."""


def _reduced() -> ca.SX:
    """Return the variables in `_REDUCED` as a linear function of the coordinates."""
    q = SEGMENT_LAYOUT.symbols["q"]
    return ca.vertcat((q[0:3] + q[5:8]) / 2.0, q[5:8] - q[0:3], q[3], q[4])


class _Shape(NamedTuple):
    frame: elements.Frame
    lengths: ca.SX
    angles: ca.SX
    points: ca.SX
    """Shape (24,)."""


@cache
def _shape_of_reduced() -> _Shape:
    s, z = SEGMENT_LAYOUT.symbols, _REDUCED
    middle, edge, link, offset = z[0:3], z[3:6], s["link"], s["offset"]
    f = elements.frame(edge, z[6], s["t_ref"], s["d_ref"])
    chambers = elements.chamber_lengths(f.length, z[7], offset)
    angles = [elements.hinge_angle(link, length) for length in chambers]
    return _Shape(f, ca.vertcat(*chambers), ca.vertcat(*angles), _points(middle, edge, f, chambers))


def _points(middle: ca.SX, edge: ca.SX, f: elements.Frame, chambers: list[ca.SX]) -> ca.SX:
    s = SEGMENT_LAYOUT.symbols
    points = elements.apexes(middle, f, chambers, s["link"], s["offset"])
    for k, p in enumerate((middle - edge / 2.0, middle + edge / 2.0)):
        points.append(elements.face_point(p, f, s["radius"][k], s["rim"][2 * k : 2 * k + 2]))
    return ca.vec(ca.horzcat(*points).T)


@cache
def _shape() -> _Shape:
    x = _shape_of_reduced()
    parts = [*x.frame, x.lengths, x.angles, x.points]
    *frame, lengths, angles, points = ca.substitute(parts, [_REDUCED], [_reduced()])
    return _Shape(elements.Frame(*frame), lengths, angles, points)


def shape() -> ca.Function:
    """Return the lengths of the chambers (2), tangent (3), director (3), and points (24)."""
    x = _shape()
    return SEGMENT_LAYOUT.function("segment_shape", {"rest": [x.lengths, x.frame.t, x.frame.d], "points": x.points})


def rims() -> ca.Function:
    """Return r of (E6) for both faces (4), the points of the rims that are nearest to the world."""
    normal = SEGMENT_LAYOUT.symbols["normal"]
    nearest = [elements.nearest_rim(_shape().frame, normal[3 * k : 3 * k + 3]) for k in range(2)]
    return SEGMENT_LAYOUT.function("segment_rims", {"rim": nearest})


def motion() -> ca.Function:
    """Return the first-order motion of the points (24) for the change dq of the coordinates."""
    return SEGMENT_LAYOUT.function("segment_motion", {"points": _motion()})


def _motion() -> ca.SX:
    return ca.jtimes(_shape().points, SEGMENT_LAYOUT.symbols["q"], SEGMENT_LAYOUT.symbols["dq"])


def jacobian() -> ca.Function:
    """Return the derivatives of the points with respect to the coordinates (192), ordered by point and then by axis."""
    of_reduced = ca.jacobian(_shape_of_reduced().points, _REDUCED)
    of_points = ca.substitute([of_reduced], [_REDUCED], [_reduced()])[0] @ ca.jacobian(
        _reduced(), SEGMENT_LAYOUT.symbols["q"]
    )
    rows = [of_points[POINTS_PER_SEGMENT * axis + k, :].T for k in range(POINTS_PER_SEGMENT) for axis in range(3)]
    return SEGMENT_LAYOUT.function("segment_jacobian", {"jacobian": rows})


def lengths() -> ca.SX:
    """Return the lengths of the chambers, shape (2,) [m]."""
    return _shape().lengths


def stretches() -> ca.SX:
    """Return the first-order change of the chambers' lengths for dq, shape (2,) [m]."""
    return ca.jtimes(_shape().lengths, SEGMENT_LAYOUT.symbols["q"], SEGMENT_LAYOUT.symbols["dq"])


Energy = Callable[[ca.SX], ca.SX]
"""Function from the lengths of the chambers, shape (2,), to a potential [J]."""


@cache
def _potential(actuated: Energy | None) -> tuple[ca.SX, ca.SX]:
    """Return the potential of springs, dampers and actuators, and the gradient that also includes the points."""
    x = _shape_of_reduced()
    phi = _energy(x.lengths, _REDUCED[6], actuated)
    slope = ca.gradient(phi + ca.dot(SEGMENT_LAYOUT.symbols["f"], x.points), _REDUCED)
    at = ca.substitute([phi, _linear().T @ slope], [_REDUCED], [_reduced()])
    return at[0], at[1]


def _energy(lengths: ca.SX, roll: ca.SX, actuated: Energy | None) -> ca.SX:
    """Return the potential of springs, dampers and actuators [J]."""
    s = SEGMENT_LAYOUT.symbols
    phi = s["roll_damping"] / (2.0 * s["dt"]) * roll**2
    for c in range(2):
        angle = elements.hinge_angle(s["link"], lengths[c])
        stretch, turn = lengths[c] - s["length_hat"][c], angle - s["angle_hat"][c]
        phi += _chamber(lengths[c], s["commanded"][c]) + s["force"][c] * lengths[c] + _hinge(angle)
        phi += (_chamber_damping() * stretch**2 + _hinge_damping() * turn**2) / (2.0 * s["span"])
    return phi if actuated is None else phi + actuated(lengths)


def _linear() -> ca.SX:
    """Return the derivatives of `_reduced` with respect to the coordinates."""
    return ca.jacobian(_reduced(), SEGMENT_LAYOUT.symbols["q"])


def _hessian(actuated: Energy | None) -> ca.SX:
    """Return the Hessian of everything that moves with the segment. The points are treated as free masses."""
    s, frame = SEGMENT_LAYOUT.symbols, _shape_of_reduced().frame
    axes = ca.horzcat(*frame[1:])
    turn = ca.diagcat(axes, axes, ca.SX.eye(2))
    symbols = [ca.SX.sym("length"), ca.SX.sym("bend"), ca.SX.sym("t_ref", 3), ca.SX.sym("f", 3, POINTS_PER_SEGMENT)]
    values = [
        frame.length,
        _REDUCED[7],
        axes.T @ s["t_ref"],
        axes.T @ ca.reshape(s["f_ahead"], POINTS_PER_SEGMENT, 3).T,
    ]
    curve = turn @ ca.substitute([_curve(actuated, *symbols)], symbols, values)[0] @ turn.T
    curve[:3, :3] = ca.sum1(s["K"][:POINTS_PER_SEGMENT]) * ca.SX.eye(3)
    curve = _linear().T @ ca.triu2symm(ca.triu(curve)) @ _linear()
    return ca.substitute(ca.triu2symm(ca.triu(curve)), _REDUCED, _reduced())


def _curve(actuated: Energy | None, length: ca.SX, bend: ca.SX, t_ref: ca.SX, f: ca.SX) -> ca.SX:
    """Return the Hessian with respect to midpoint, edge, roll and bend, with vectors in components along the frame.

    In the frame, the points r = X - midpoint depend only on length and bend. With the spin w of the frame, (E1), and
    the motion dm of the midpoint,

        dX = dm + w x r + dr,   d2X = dw x r + w x (w' x r) + w x dr' + w' x dr + d2r
    """
    s, roll, shape = SEGMENT_LAYOUT.symbols, _REDUCED[6], ca.vertcat(length, bend)
    own = elements.Frame(length, *ca.horzsplit(ca.SX.eye(3)))
    lengths = elements.chamber_lengths(length, bend, s["offset"])
    points = ca.reshape(_points(ca.SX.zeros(3), length * own.t, own, lengths), POINTS_PER_SEGMENT, 3).T
    phi, twist = _energy(ca.vertcat(*lengths), roll, actuated), points @ f.T
    curve = ca.SX.zeros(8, 8)  # in dm, w, dl and bend
    curve[6:, 6:], slope = ca.hessian(phi + ca.dot(f, points), shape)
    curve[3:6, 3:6] = twist - ca.trace(twist) * ca.SX.eye(3)
    for k in range(POINTS_PER_SEGMENT):
        moved = ca.jacobian(points[:, k], shape)
        first = ca.horzcat(ca.SX.eye(3), -ca.skew(points[:, k]), moved)
        curve += s["K"][k] * (first.T @ first)
        turned = -ca.skew(f[:, k]) @ moved
        curve[3:6, 6:] += turned
        curve[6:, 3:6] += turned.T
    m = ca.vertcat(twist[1, 2] - twist[2, 1], twist[2, 0] - twist[0, 2], twist[0, 1] - twist[1, 0])
    a = elements.holonomy(own, t_ref)
    way = ca.diagcat(ca.SX.eye(3), ca.skew(own.t) / length + own.t @ a.T, ca.SX.zeros(2, 2))
    way[3, 6] = way[6, 3] = way[7, 7] = 1.0
    curve = way.T @ curve @ way
    of_edge, of_roll = elements.spin_change(own, t_ref, m)
    curve[3:6, 3:6] += of_edge + slope[0] / length * (ca.SX.eye(3) - own.t @ own.t.T)
    curve[6, 3:6] += of_roll.T
    curve[6, 6] += ca.hessian(phi, roll)[0]
    return ca.triu2symm(ca.triu(curve))


def _chamber(length: ca.SX, commanded: ca.SX) -> ca.SX:
    return elements.chamber_energy(SEGMENT_LAYOUT.symbols["k"], SEGMENT_LAYOUT.symbols["l0"], length, commanded)


def _hinge(angle: ca.SX) -> ca.SX:
    s = SEGMENT_LAYOUT.symbols
    return elements.hinge_energy(s["k_apex"], angle, elements.hinge_angle(s["link"], s["l0"]))


def _chamber_damping() -> ca.SX:
    """Return the damping of a chamber: Kelvin-Voigt time times stiffness [N s/m]."""
    return SEGMENT_LAYOUT.symbols["tau"] * SEGMENT_LAYOUT.symbols["k"] / (2.0 * SEGMENT_LAYOUT.symbols["l0"])


def _hinge_damping() -> ca.SX:
    return SEGMENT_LAYOUT.symbols["tau"] * SEGMENT_LAYOUT.symbols["k_apex"]


def gradient(layout: Layout = SEGMENT_LAYOUT, actuated: Energy | None = None) -> ca.Function:
    """Return the potential of springs, dampers and actuators, and the gradient (8), which also includes the points.

    Parameters
    ----------
    layout : Layout
        Layout of the inputs: the segment's inputs, then the inputs of `actuated`.
    actuated : callable, optional
        Potential of the actuators.
    """
    phi, slope = _potential(actuated)
    return layout.function("segment_gradient", {"phi": phi, "gradient": slope})


def hessian(layout: Layout = SEGMENT_LAYOUT, actuated: Energy | None = None) -> ca.Function:
    """Return the outputs of `gradient`, and the Hessian (64), row by row.

    The points are treated as free masses: the entries xx of K are used for all axes.
    """
    phi, slope = _potential(actuated)
    return layout.function("segment_hessian", {"phi": phi, "gradient": slope, "hessian": _hessian(actuated)})


LEDGER_TERMS = ("work_contract", "elastic", "viscous_loss", "numerical_loss", "work_contract_p11")
LEDGER_ROWS = POINTS_PER_SEGMENT
"""Number of rows of `ledger` before the motion of the points. They occupy the row "of_segment" of the points."""


def ledger() -> ca.Function:
    """Return the segment's terms of the energy ledger, in the order of `LEDGER_TERMS`, and its hinge angles (2).

    A row without use and the outputs of `motion` (24) follow.
    """
    s = SEGMENT_LAYOUT.symbols
    terms = _chamber_ledger(0) + _chamber_ledger(1)
    terms[LEDGER_TERMS.index("viscous_loss")] += s["roll_damping"] / s["dt"] * s["q"][3] * s["dq"][3]
    rest = {"nothing": ca.SX.zeros(LEDGER_ROWS - len(LEDGER_TERMS) - 2), "points": _motion()}
    return SEGMENT_LAYOUT.function("segment_ledger", {"terms": terms, "angles": _shape().angles, **rest})


def _chamber_ledger(c: int) -> ca.SX:
    s, x = SEGMENT_LAYOUT.symbols, _shape()
    length, length_n, now, force = x.lengths[c], s["length_n"][c], s["commanded"][c], s["force"][c]
    stretch, opening = (ca.jtimes(each, s["q"], s["dq"]) for each in (length, x.angles[c]))

    def chamber(at: ca.SX) -> ca.SX:
        return _chamber(at, now)

    commanding = [chamber(at) - _chamber(at, s["commanded_n"][c]) for at in (length_n, length)]
    work, missed = losses.trapezoid(*commanding)  # integral of (dE/dl_cmd) dl_cmd
    change, numerical = losses.spring(chamber, length, length_n, stretch)
    hinge_change, hinge_numerical = losses.spring(_hinge, x.angles[c], s["angle_n"][c], opening)
    span, dt = s["span"], s["dt"]
    lost, off = losses.damper(_chamber_damping(), length - s["length_hat"][c], span, dt, stretch)
    hinge_lost, hinge_off = losses.damper(_hinge_damping(), x.angles[c] - s["angle_hat"][c], span, dt, opening)
    pulled = length - length_n
    passive = losses.slope(lambda at: _chamber(at, s["l0"]), length)
    return ca.vertcat(
        work - force * pulled,
        commanding[0] + change + hinge_change,
        lost + hinge_lost,
        numerical + missed + hinge_numerical + off + hinge_off + force * (stretch - pulled),
        -(losses.slope(chamber, length) + force - passive) * stretch,
    )
