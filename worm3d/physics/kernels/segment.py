"""Kernels of a segment: shape, contact points, potential with gradient and Hessian, and terms of the energy ledger.

A kernel is a compiled function that the solver calls for all segments. Each takes the inputs of `SEGMENT_LAYOUT`. A
segment has 8 coordinates q, 2 chambers (left and right) and 8 contact points.

Coordinates: [p_i (3), roll g, bend th, p_{i+1} (3)], where p_i and p_{i+1} are the joints at the ends of the segment.
The roll is the rotation about the segment's axis relative to the director at the start of the step.

Points: the six apexes in the order of NOTATION.md, then the contact points of the tail face and of the head face. An
array with the coordinates of the points has 24 rows: x of all points, then y, then z (row 8 axis + point). The kernels
of `worm3d.physics.kernels.point` need this order.

Kernels whose expressions depend on the segment law (`worm3d.physics.segment_laws`) are made for a class of laws. The
inputs of such a kernel are the inputs of `layout`.

If all mass lies on the axis, the roll of the whole worm has no inertia. In this case a damper resists the roll g in
each step, with the potential C g^2/(2 dt) and the loss C g^2/dt.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import reduce
from operator import add
from typing import Any, NamedTuple

import casadi as ca

from worm3d.physics import elements
from worm3d.physics.actuators import COMMANDS
from worm3d.physics.expressions import answer, scalar
from worm3d.physics.kernels import losses
from worm3d.physics.kernels.layout import Layout, once
from worm3d.physics.segment_laws.law import SEGMENT_INPUTS, SegmentLaw, Spring
from worm3d.physics.segment_laws.shapes import Rhombus

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
        "link": 1,  # length of the links of a chamber, or half of the greatest length of a chamber without links [m]
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
        "angle_hat": 2,  # like s_hat, for the angles of the chambers (`SegmentLaw.angle`)
        "commanded_n": 2,  # "commanded" at the start of the step, t_n
        "length_n": 2,  # lengths of the chambers at t_n
        "angle_n": 2,  # angles of the chambers at t_n
        "f": 3 * POINTS_PER_SEGMENT,  # gradient of the points' potential with respect to the points
        "of_points": 2 * POINTS_PER_SEGMENT,  # unused here: further outputs of the kernel of each point
        "f_ahead": 3 * POINTS_PER_SEGMENT,  # f predicted by Newton's method, used in the second derivatives
        "K": 9 * POINTS_PER_SEGMENT,  # Hessian of the potential of each point; entry (r, c): row 8 (3 r + c) + point
    }
)
"""Inputs of the kernels of a segment: the name and the number of rows of each."""

Law = type[SegmentLaw]
"""Class of segment laws."""

ACTUATOR_PREFIX = "actuator_"
"""Prefix of the names of the actuators' inputs, which distinguishes them from the inputs of a segment."""
SEGMENT_LAW_PREFIX = "segment_law_"
"""Prefix of the names of the inputs that a segment law adds to the inputs of a segment."""
CHAMBERS = 2
"""Number of chambers of a segment, left and right, and of their actuators."""


@once
def layout(law: Law = Rhombus) -> Layout:
    """Return the inputs of a segment with a segment law.

    A law without inputs of its own, such as the rhombus, has `SEGMENT_LAYOUT`. Otherwise the commands of the actuators
    follow, which these kernels do not use, and then the inputs of the law. The commands come first so that their rows
    are the same for all laws.
    """
    own = law.inputs()
    if not own:
        return SEGMENT_LAYOUT
    before = SEGMENT_LAYOUT.extended({ACTUATOR_PREFIX + name: CHAMBERS for name in COMMANDS})
    return before.extended({SEGMENT_LAW_PREFIX + name: size for name, size in own.items()})


def law_rows(law: Law) -> int:
    """Return the number of rows of the inputs that a segment law adds."""
    return sum(law.inputs().values())


def kernel_name(law: Law, name: str) -> str:
    """Return the name, among the inputs of the kernels, of an input of a segment law."""
    return SEGMENT_LAW_PREFIX + name if name in law.inputs() else name


def _known(law: Law) -> dict[str, ca.SX]:
    """Return the inputs that the methods of a segment law get, by name."""
    s = layout(law).symbols
    known = {name: s[name] for name in SEGMENT_INPUTS if name != "link" or law.has_links}
    return known | {name: s[kernel_name(law, name)] for name in law.inputs()}


def _answered(law: Law, method: str, *given: Any) -> ca.SX:
    """Return the scalar expression that a method of a segment law returns."""
    return scalar(f"{law.__name__}.{method}", answer(law, method, _known(law), *given))


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


@once
def _shape_of_reduced(law: Law) -> _Shape:
    s, z = SEGMENT_LAYOUT.symbols, _REDUCED
    middle, edge, offset = z[0:3], z[3:6], s["offset"]
    f = elements.frame(edge, z[6], s["t_ref"], s["d_ref"])
    chambers = elements.chamber_lengths(f.length, z[7], offset)
    angles = [_answered(law, "angle", length, z[7]) for length in chambers]
    return _Shape(f, ca.vertcat(*chambers), ca.vertcat(*angles), _points(law, middle, edge, f, chambers))


def _points(law: Law, middle: ca.SX, edge: ca.SX, f: elements.Frame, chambers: list[ca.SX]) -> ca.SX:
    s = SEGMENT_LAYOUT.symbols
    outlines = [_outline(law, length, s["commanded"][c]) for c, length in enumerate(chambers)]
    points = elements.apexes(middle, f, outlines, s["offset"])
    for k, p in enumerate((middle - edge / 2.0, middle + edge / 2.0)):
        points.append(elements.face_point(p, f, s["radius"][k], s["rim"][2 * k : 2 * k + 2]))
    return ca.vec(ca.horzcat(*points).T)


def _outline(law: Law, length: ca.SX, commanded: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return half-height and outward distance of a chamber [m]; raise ValueError unless the law returns such a pair."""
    found = answer(law, "outline", _known(law), length, commanded)
    if not (isinstance(found, tuple) and len(found) == 2):
        raise ValueError(
            f"{law.__name__}.outline: got {type(found).__name__}, must be a pair: height, outward distance"
        )
    height, outward = (scalar(f"{law.__name__}.outline", each) for each in found)
    return height, outward


@once
def _shape(law: Law) -> _Shape:
    x = _shape_of_reduced(law)
    parts = [*x.frame, x.lengths, x.angles, x.points]
    *frame, lengths, angles, points = ca.substitute(parts, [_REDUCED], [_reduced()])
    return _Shape(elements.Frame(*frame), lengths, angles, points)


def shape(law: Law = Rhombus) -> ca.Function:
    """Return the kernel of the shape: chamber lengths (2), tangent (3), director (3), and points (24)."""
    x = _shape(law)
    return layout(law).function("segment_shape", {"rest": [x.lengths, x.frame.t, x.frame.d], "points": x.points})


def rims() -> ca.Function:
    """Return the kernel of the "rim" inputs (4): the direction of the point of each face's rim nearest to the world."""
    normal = SEGMENT_LAYOUT.symbols["normal"]
    nearest = [elements.nearest_rim(_shape(Rhombus).frame, normal[3 * k : 3 * k + 3]) for k in range(2)]
    return SEGMENT_LAYOUT.function("segment_rims", {"rim": nearest})


def motion(law: Law = Rhombus) -> ca.Function:
    """Return the kernel of the displacement of the points (24) due to dq, to first order."""
    return layout(law).function("segment_motion", {"points": _motion(law)})


def _motion(law: Law) -> ca.SX:
    return ca.jtimes(_shape(law).points, SEGMENT_LAYOUT.symbols["q"], SEGMENT_LAYOUT.symbols["dq"])


def _moved_by_command(law: Law) -> ca.SX:
    """Return the displacement of the points (24) due to the change of the commanded rest lengths, to first order."""
    s = SEGMENT_LAYOUT.symbols
    return ca.jtimes(_shape(law).points, s["commanded"], s["commanded"] - s["commanded_n"])


def jacobian(law: Law = Rhombus) -> ca.Function:
    """Return the kernel of the derivatives of the points with respect to the coordinates (192).

    The order is: 8 derivatives of x of the first point, 8 of its y, 8 of its z, then the second point, and so on.
    """
    of_reduced = ca.jacobian(_shape_of_reduced(law).points, _REDUCED)
    of_points = ca.substitute([of_reduced], [_REDUCED], [_reduced()])[0] @ ca.jacobian(
        _reduced(), SEGMENT_LAYOUT.symbols["q"]
    )
    rows = [of_points[POINTS_PER_SEGMENT * axis + k, :].T for k in range(POINTS_PER_SEGMENT) for axis in range(3)]
    return layout(law).function("segment_jacobian", {"jacobian": rows})


def lengths() -> ca.SX:
    """Return the lengths of the chambers, shape (2,) [m]. They do not depend on the segment law."""
    return _shape(Rhombus).lengths


def angles(law: Law = Rhombus) -> ca.SX:
    """Return the angles of the chambers, shape (2,) [rad]."""
    return _shape(law).angles


def stretches() -> ca.SX:
    """Return the change of the chambers' lengths due to dq, to first order, shape (2,) [m]."""
    return ca.jtimes(lengths(), SEGMENT_LAYOUT.symbols["q"], SEGMENT_LAYOUT.symbols["dq"])


Energy = Callable[[ca.SX], ca.SX]
"""Function from the lengths of the chambers, shape (2,) [m], to a potential [J]."""


@once
def _potential(law: Law, actuated: Energy | None) -> tuple[ca.SX, ca.SX]:
    """Return the potential of springs, dampers and actuators, and a gradient with respect to the coordinates.

    The gradient also contains the potential of the points, whose own gradient is the input f.
    """
    x = _shape_of_reduced(law)
    phi = _energy(law, x.frame.length, x.lengths, _REDUCED[6], _REDUCED[7], actuated)
    slope = ca.gradient(phi + ca.dot(SEGMENT_LAYOUT.symbols["f"], x.points), _REDUCED)
    at = ca.substitute([phi, _linear().T @ slope], [_REDUCED], [_reduced()])
    return at[0], at[1]


def _energy(law: Law, length: ca.SX, lengths: ca.SX, roll: ca.SX, bend: ca.SX, actuated: Energy | None) -> ca.SX:
    """Return the potential of springs, dampers and actuators [J]."""
    s, springs = SEGMENT_LAYOUT.symbols, springs_of(law)
    phi = s["roll_damping"] / (2.0 * s["dt"]) * roll**2
    for c in range(CHAMBERS):
        at = _coordinates(law, lengths[c], bend)
        first, *others = (spring.energy(each, s["commanded"][c]) for spring, each in zip(springs, at, strict=False))
        dampers = [
            spring.damping * (each - hat) ** 2 for spring, each, hat in zip(springs, at, _pasts("hat", c), strict=False)
        ]
        phi += reduce(add, others, first + s["force"][c] * lengths[c])
        phi += reduce(add, dampers) / (2.0 * s["span"])
    phi += _answered(law, "bending", length, bend, s["commanded"])
    return phi if actuated is None else phi + actuated(lengths)


def springs_of(law: Law) -> tuple[Spring, ...]:
    """Return the springs of a chamber with a segment law.

    Raises
    ------
    ValueError
        The method `springs` of the law raises an error, or does not return one or two springs.
    """
    found = answer(law, "springs", _known(law))
    if not (isinstance(found, tuple) and 1 <= len(found) <= 2 and all(isinstance(each, Spring) for each in found)):
        raise ValueError(f"{law.__name__}.springs: got {found!r}, must be a tuple of one or two worm3d.Spring")
    return found


def joints(law: Law, length: ca.SX) -> Mapping[str, ca.SX]:
    """Return the results of `SegmentLaw.joints` for a chamber of the given length."""
    return {
        name: scalar(f"{law.__name__}.joints, {name}", value)
        for name, value in answer(law, "joints", _known(law), length).items()
    }


def _coordinates(law: Law, length: ca.SX, bend: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the coordinates of the springs of a chamber: its length [m] and its angle [rad]."""
    return length, _answered(law, "angle", length, bend)


def _pasts(at: str, c: int) -> tuple[ca.SX, ca.SX]:
    """Return the past coordinates of the springs of chamber c. `at` is "n" or "hat"."""
    s = SEGMENT_LAYOUT.symbols
    return s[f"length_{at}"][c], s[f"angle_{at}"][c]


def _linear() -> ca.SX:
    """Return the derivatives of `_reduced` with respect to the coordinates, shape (8, 8)."""
    return ca.jacobian(_reduced(), SEGMENT_LAYOUT.symbols["q"])


def _hessian(law: Law, actuated: Energy | None) -> ca.SX:
    """Return the Hessian of the potential of springs, dampers, actuators and points with respect to the coordinates.

    The entries for the midpoint treat the points as free masses (see `hessian`).
    """
    s, frame = SEGMENT_LAYOUT.symbols, _shape_of_reduced(law).frame
    axes = ca.horzcat(*frame[1:])
    turn = ca.diagcat(axes, axes, ca.SX.eye(2))
    symbols = [ca.SX.sym("length"), ca.SX.sym("bend"), ca.SX.sym("t_ref", 3), ca.SX.sym("f", 3, POINTS_PER_SEGMENT)]
    values = [
        frame.length,
        _REDUCED[7],
        axes.T @ s["t_ref"],
        axes.T @ ca.reshape(s["f_ahead"], POINTS_PER_SEGMENT, 3).T,
    ]
    curve = turn @ ca.substitute([_curve(law, actuated, *symbols)], symbols, values)[0] @ turn.T
    curve[:3, :3] = ca.sum1(s["K"][:POINTS_PER_SEGMENT]) * ca.SX.eye(3)
    curve = _linear().T @ ca.triu2symm(ca.triu(curve)) @ _linear()
    return ca.substitute(ca.triu2symm(ca.triu(curve)), _REDUCED, _reduced())


def _curve(law: Law, actuated: Energy | None, length: ca.SX, bend: ca.SX, t_ref: ca.SX, f: ca.SX) -> ca.SX:
    """Return the Hessian with respect to midpoint, edge, roll and bend, in components along the frame of the segment.

    Relative to the midpoint m, a point X has the position r = X - m. In components along the frame, r depends only on
    length and bend. w is the infinitesimal rotation of the frame, (E1) in `worm3d.physics.elements`. The first and
    second variations of a point are dX = dm + w x r + dr and d2X = dw x r + w x (w' x r) + w x dr' + w' x dr + d2r,
    where the prime marks a second, independent variation.
    """
    s, roll, shape, way = SEGMENT_LAYOUT.symbols, _REDUCED[6], ca.vertcat(length, bend), ca.SX.eye(2)
    own = elements.Frame(length, *ca.horzsplit(ca.SX.eye(3)))
    lengths = along = elements.chamber_lengths(length, bend, s["offset"])
    if law.is_long:
        lengths = [ca.SX.sym("length_c") for _ in along]
        shape, way = ca.vertcat(shape, *lengths), ca.vertcat(way, ca.jacobian(ca.vertcat(*along), shape))
    points = ca.reshape(_points(law, ca.SX.zeros(3), length * own.t, own, lengths), POINTS_PER_SEGMENT, 3).T
    phi, twist = _energy(law, length, ca.vertcat(*lengths), roll, bend, actuated), points @ f.T
    curve = ca.SX.zeros(8, 8)  # rows and columns: dm (3), w (3), length, bend
    bent, slope = ca.hessian(phi + ca.dot(f, points), shape)
    curve[6:, 6:], slope = way.T @ bent @ way, way.T @ slope
    curve[3:6, 3:6] = twist - ca.trace(twist) * ca.SX.eye(3)
    for k in range(POINTS_PER_SEGMENT):
        moved = ca.jacobian(points[:, k], shape) @ way
        first = ca.horzcat(ca.SX.eye(3), -ca.skew(points[:, k]), moved)
        curve += s["K"][k] * (first.T @ first)
        turned = -ca.skew(f[:, k]) @ moved
        curve[3:6, 6:] += turned
        curve[6:, 3:6] += turned.T
    m = ca.vertcat(twist[1, 2] - twist[2, 1], twist[2, 0] - twist[0, 2], twist[0, 1] - twist[1, 0])
    a = elements.holonomy(own, t_ref)
    turn = ca.diagcat(ca.SX.eye(3), ca.skew(own.t) / length + own.t @ a.T, ca.SX.zeros(2, 2))
    turn[3, 6] = turn[6, 3] = turn[7, 7] = 1.0
    curve = turn.T @ curve @ turn
    of_edge, of_roll = elements.spin_change(own, t_ref, m)
    curve[3:6, 3:6] += of_edge + slope[0] / length * (ca.SX.eye(3) - own.t @ own.t.T)
    curve[6, 3:6] += of_roll.T
    curve[6, 6] += ca.hessian(phi, roll)[0]
    curve = ca.triu2symm(ca.triu(curve))
    return ca.substitute([curve], lengths, along)[0] if law.is_long else curve


def gradient(inputs: Layout = SEGMENT_LAYOUT, actuated: Energy | None = None, law: Law = Rhombus) -> ca.Function:
    """Return the kernel of the potential and the gradient (8) with respect to the coordinates.

    The potential is that of springs, dampers and actuators. The gradient also contains the potential of the points.

    Parameters
    ----------
    inputs : Layout
        Layout of the inputs: the inputs of `layout`, then the inputs of `actuated`.
    actuated : callable, optional
        Potential of the actuators as a function of the chambers' lengths.
    law : type of SegmentLaw
        Segment law.
    """
    phi, slope = _potential(law, actuated)
    return inputs.function("segment_gradient", {"phi": phi, "gradient": slope})


def hessian(inputs: Layout = SEGMENT_LAYOUT, actuated: Energy | None = None, law: Law = Rhombus) -> ca.Function:
    """Return the kernel of the outputs of `gradient` followed by the Hessian (64), row by row.

    Points without contact only have inertia, for which K is a multiple of the unit matrix. The Hessian treats all
    points in this way: it uses the entry xx of K for all axes.
    """
    outputs = [*_potential(law, actuated), _hessian(law, actuated)]
    found = ca.cse(outputs) if law.is_long else outputs
    return inputs.function("segment_hessian", dict(zip(("phi", "gradient", "hessian"), found, strict=True)))


LEDGER_TERMS = ("work_contract", "elastic", "viscous_loss", "numerical_loss", "work_contract_p11")
"""Terms of the energy ledger that belong to a segment."""
LEDGER_ROWS = POINTS_PER_SEGMENT
"""Number of outputs of `ledger` before the displacement of the points; they fill one row of an array of points."""


def ledger(law: Law = Rhombus) -> ca.Function:
    """Return the kernel of the segment's terms of the energy ledger.

    Its outputs are the terms in the order of `LEDGER_TERMS`, the angles of the chambers (2), an unused value, and the
    displacement of the points (24) to first order. The displacement is due to dq, as in `motion`, and due to the
    change of the commanded rest lengths. The work of the actuators contains f . (dX/dl_cmd) dl_cmd for the latter.
    """
    s, moved = SEGMENT_LAYOUT.symbols, _moved_by_command(law)
    terms = _chamber_ledger(law, 0) + _chamber_ledger(law, 1) + _bending_ledger(law)
    terms[LEDGER_TERMS.index("viscous_loss")] += s["roll_damping"] / s["dt"] * s["q"][3] * s["dq"][3]
    terms[LEDGER_TERMS.index("work_contract")] += ca.dot(s["f"], moved)
    rest = {"nothing": ca.SX.zeros(LEDGER_ROWS - len(LEDGER_TERMS) - 2), "points": _motion(law) + moved}
    return layout(law).function("segment_ledger", {"terms": terms, "angles": _shape(law).angles, **rest})


def _chamber_ledger(law: Law, c: int) -> ca.SX:
    s, x = SEGMENT_LAYOUT.symbols, _shape(law)
    length, length_n, now, force = x.lengths[c], s["length_n"][c], s["commanded"][c], s["force"][c]
    parts = zip(springs_of(law), (length, x.angles[c]), _pasts("n", c), _pasts("hat", c), strict=False)
    booked = [_spring_ledger(*part, now) for part in parts]
    stretch, spring = booked[0].first, springs_of(law)[0]
    commanding = [spring.energy(at, now) - spring.energy(at, s["commanded_n"][c]) for at in (length_n, length)]
    work, missed = losses.trapezoid(*commanding)  # integral of (dE/dl_cmd) dl_cmd
    pulled = length - length_n
    pull, passive = (losses.slope(lambda at, to=to: spring.energy(at, to), length) for to in (now, s["l0"]))  # type: ignore[misc]
    numerical = reduce(add, [each.numerical for each in booked[1:]], booked[0].numerical + missed)
    return ca.vertcat(
        work - force * pulled,
        reduce(add, [each.change for each in booked], commanding[0]),
        reduce(add, [each.lost for each in booked]),
        reduce(add, [each.off for each in booked], numerical) + force * (stretch - pulled),
        -(pull + force - passive) * stretch,
    )


class _Booked(NamedTuple):
    """Terms of a spring and its damper in the energy ledger."""

    first: ca.SX
    """First-order change of the coordinate."""
    change: ca.SX
    numerical: ca.SX
    lost: ca.SX
    off: ca.SX
    """Numerical loss of the damper."""


def _spring_ledger(spring: Spring, at: ca.SX, at_n: ca.SX, hat: ca.SX, commanded: ca.SX) -> _Booked:
    s = SEGMENT_LAYOUT.symbols
    first = ca.jtimes(at, s["q"], s["dq"])
    change, numerical = losses.spring(lambda x: ca.SX(spring.energy(x, commanded)), at, at_n, first)
    lost, off = losses.damper(spring.damping, at - hat, s["span"], s["dt"], first)
    return _Booked(first, change, numerical, lost, off)


def _bending_ledger(law: Law) -> ca.SX:
    """Return the terms of the further energy (SL3), whose past coordinates are the mean length and the angle at t_n."""
    s, x = SEGMENT_LAYOUT.symbols, _shape(law)
    now, before, rest = s["commanded"], s["commanded_n"], ca.vertcat(s["l0"], s["l0"])
    at, at_n = (ca.sum1(x.lengths) / 2.0, s["q"][4]), (ca.sum1(s["length_n"]) / 2.0, s["angle_n"][0])

    def energy(where: tuple[ca.SX, ca.SX], commanded: ca.SX) -> ca.SX:
        return _answered(law, "bending", *where, commanded)

    work, missed = losses.trapezoid(*(energy(where, now) - energy(where, before) for where in (at_n, at)))
    change = energy(at, now) - energy(at_n, now)
    way, passive = (ca.jtimes(energy(at, commanded), s["q"], s["dq"]) for commanded in (now, rest))
    commanding = energy(at_n, now) - energy(at_n, before)
    return ca.vertcat(work, commanding + change, 0.0, way - change + missed, passive - way)
