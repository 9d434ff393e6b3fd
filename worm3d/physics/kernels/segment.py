"""Kernels of a segment: shape, contact points, potential with gradient and Hessian, and terms of the energy ledger.

A kernel is a compiled function that the solver calls for all segments. Each takes the inputs of `SEGMENT_LAYOUT`. A
segment has 8 coordinates q, 2 chambers (left and right) and 8 contact points.

Coordinates: [p_i (3), roll g, bend th, p_{i+1} (3)], where p_i and p_{i+1} are the joints at the ends of the segment.
The roll is the rotation about the segment's axis relative to the director at the start of the step.

Points: the six apexes in the order of NOTATION.md, then the contact points of the tail face and of the head face. An
array with the coordinates of the points has 24 rows: x of all points, then y, then z (row 8 axis + point). The kernels
of `worm3d.physics.kernels.point` need this order.

If all mass lies on the axis, the roll of the whole worm has no inertia. In this case a damper resists the roll g in
each step, with the potential C g^2/(2 dt) and the loss C g^2/dt.
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
"""Number of contact points of a segment: six apexes and two faces."""
COORDINATES = 8
"""Number of coordinates of a segment."""

SEGMENT_LAYOUT = Layout(
    {
        "q": COORDINATES,
        "dq": COORDINATES,  # change of q in the step
        "t_ref": 3,  # tangent at the start of the step
        "d_ref": 3,  # director at the start of the step
        "link": 1,  # length of the links of a chamber [m]
        "offset": 1,  # distance of the chambers from the axis [m]
        "radius": 2,  # radii of the faces at p_i and p_{i+1} [m]
        "normal": 6,  # normal of the world at the face at p_i (3), then at p_{i+1} (3)
        "rim": 4,  # r of (E6) in worm3d.physics.elements, for the face at p_i (2), then at p_{i+1} (2)
        "k": 1,  # stiffness of the springs [N]
        "k_apex": 1,  # stiffness of the hinges at the apexes [N m]
        "l0": 1,  # rest length [m]
        "tau": 1,  # Kelvin-Voigt time [s]
        "roll_damping": 1,  # C [N m s]; 0 if the roll has inertia
        "span": 1,  # beta dt [s]
        "dt": 1,
        "weights": 2,  # weights of s_n and s_{n-1} in s_hat, the past state that an implicit step starts from
        "commanded": 2,  # rest length of each chamber at the end of the step, t_{n+1}
        "force": 2,  # force of each chamber at the end of the step
        "length_hat": 2,  # like s_hat, for the lengths of the chambers (for the damper)
        "angle_hat": 2,  # like s_hat, for the hinge angles
        "commanded_n": 2,  # "commanded" at the start of the step, t_n
        "length_n": 2,  # lengths of the chambers at t_n
        "angle_n": 2,  # hinge angles at t_n
        "f": 3 * POINTS_PER_SEGMENT,  # gradient of the points' potential with respect to the points
        "of_points": 2 * POINTS_PER_SEGMENT,  # unused here: further outputs of the kernel of each point
        "f_ahead": 3 * POINTS_PER_SEGMENT,  # f predicted by Newton's method, used in the second derivatives
        "K": 9 * POINTS_PER_SEGMENT,  # Hessian of the potential of each point; entry (r, c): row 8 (3 r + c) + point
    }
)
"""Inputs of the kernels of a segment: the name and the number of rows of each."""


_REDUCED = ca.SX.sym("z", COORDINATES)
"""Reduced coordinates: midpoint (3), edge p_{i+1} - p_i (3), roll, bend. Derivatives with respect to these coordinates
are the shortest expressions."""


def _reduced() -> ca.SX:
    """Return the variables in `_REDUCED` as a linear function of the coordinates."""
    q = SEGMENT_LAYOUT.symbols["q"]
    return ca.vertcat((q[0:3] + q[5:8]) / 2.0, q[5:8] - q[0:3], q[3], q[4])


class _Shape(NamedTuple):
    """Shape of a segment as symbolic expressions."""

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
    """Return the kernel of the shape: chamber lengths (2), tangent (3), director (3), and points (24)."""
    x = _shape()
    return SEGMENT_LAYOUT.function("segment_shape", {"rest": [x.lengths, x.frame.t, x.frame.d], "points": x.points})


def rims() -> ca.Function:
    """Return the kernel of the "rim" inputs (4): the direction of the point of each face's rim nearest to the world."""
    normal = SEGMENT_LAYOUT.symbols["normal"]
    nearest = [elements.nearest_rim(_shape().frame, normal[3 * k : 3 * k + 3]) for k in range(2)]
    return SEGMENT_LAYOUT.function("segment_rims", {"rim": nearest})


def motion() -> ca.Function:
    """Return the kernel of the displacement of the points (24) due to dq, to first order."""
    return SEGMENT_LAYOUT.function("segment_motion", {"points": _motion()})


def _motion() -> ca.SX:
    return ca.jtimes(_shape().points, SEGMENT_LAYOUT.symbols["q"], SEGMENT_LAYOUT.symbols["dq"])


def jacobian() -> ca.Function:
    """Return the kernel of the derivatives of the points with respect to the coordinates (192).

    The order is: 8 derivatives of x of the first point, 8 of its y, 8 of its z, then the second point, and so on.
    """
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
    """Return the change of the chambers' lengths due to dq, to first order, shape (2,) [m]."""
    return ca.jtimes(_shape().lengths, SEGMENT_LAYOUT.symbols["q"], SEGMENT_LAYOUT.symbols["dq"])


Energy = Callable[[ca.SX], ca.SX]
"""Function from the lengths of the chambers, shape (2,) [m], to a potential [J]."""


@cache
def _potential(actuated: Energy | None) -> tuple[ca.SX, ca.SX]:
    """Return the potential of springs, dampers and actuators, and a gradient with respect to the coordinates.

    The gradient also contains the potential of the points, whose own gradient is the input f.
    """
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
    """Return the derivatives of `_reduced` with respect to the coordinates, shape (8, 8)."""
    return ca.jacobian(_reduced(), SEGMENT_LAYOUT.symbols["q"])


def _hessian(actuated: Energy | None) -> ca.SX:
    """Return the Hessian of the potential of springs, dampers, actuators and points with respect to the coordinates.

    The entries for the midpoint treat the points as free masses (see `hessian`).
    """
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
    """Return the Hessian with respect to midpoint, edge, roll and bend, in components along the frame of the segment.

    Relative to the midpoint m, a point X has the position r = X - m. In components along the frame, r depends only on
    length and bend. w is the infinitesimal rotation of the frame, (E1) in `worm3d.physics.elements`. The first and
    second variations of a point are dX = dm + w x r + dr and d2X = dw x r + w x (w' x r) + w x dr' + w' x dr + d2r,
    where the prime marks a second, independent variation.
    """
    s, roll, shape = SEGMENT_LAYOUT.symbols, _REDUCED[6], ca.vertcat(length, bend)
    own = elements.Frame(length, *ca.horzsplit(ca.SX.eye(3)))
    lengths = elements.chamber_lengths(length, bend, s["offset"])
    points = ca.reshape(_points(ca.SX.zeros(3), length * own.t, own, lengths), POINTS_PER_SEGMENT, 3).T
    phi, twist = _energy(ca.vertcat(*lengths), roll, actuated), points @ f.T
    curve = ca.SX.zeros(8, 8)  # rows and columns: dm (3), w (3), length, bend
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
    """Return the damping of one chamber: Kelvin-Voigt time times stiffness [N s/m]."""
    return SEGMENT_LAYOUT.symbols["tau"] * SEGMENT_LAYOUT.symbols["k"] / (2.0 * SEGMENT_LAYOUT.symbols["l0"])


def _hinge_damping() -> ca.SX:
    return SEGMENT_LAYOUT.symbols["tau"] * SEGMENT_LAYOUT.symbols["k_apex"]


def gradient(layout: Layout = SEGMENT_LAYOUT, actuated: Energy | None = None) -> ca.Function:
    """Return the kernel of the potential and the gradient (8) with respect to the coordinates.

    The potential is that of springs, dampers and actuators. The gradient also contains the potential of the points.

    Parameters
    ----------
    layout : Layout
        Layout of the inputs: the segment's inputs, then the inputs of `actuated`.
    actuated : callable, optional
        Potential of the actuators as a function of the chambers' lengths.
    """
    phi, slope = _potential(actuated)
    return layout.function("segment_gradient", {"phi": phi, "gradient": slope})


def hessian(layout: Layout = SEGMENT_LAYOUT, actuated: Energy | None = None) -> ca.Function:
    """Return the kernel of the outputs of `gradient` followed by the Hessian (64), row by row.

    Points without contact only have inertia, for which K is a multiple of the unit matrix. The Hessian treats all
    points in this way: it uses the entry xx of K for all axes.
    """
    phi, slope = _potential(actuated)
    return layout.function("segment_hessian", {"phi": phi, "gradient": slope, "hessian": _hessian(actuated)})


LEDGER_TERMS = ("work_contract", "elastic", "viscous_loss", "numerical_loss", "work_contract_p11")
"""Terms of the energy ledger that belong to a segment."""
LEDGER_ROWS = POINTS_PER_SEGMENT
"""Number of outputs of `ledger` before the displacement of the points; they fill one row of an array of points."""


def ledger() -> ca.Function:
    """Return the kernel of the segment's terms of the energy ledger.

    Its outputs are the terms in the order of `LEDGER_TERMS`, the hinge angles (2), an unused value, and the outputs of
    `motion` (24).
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
