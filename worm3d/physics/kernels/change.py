"""Kernels of the sensitivities of a step: derivatives of its equations and of its results with respect to a parameter.

A step solves R(x, y, u) = 0 for the coordinates x, with the past y and the commands u, and then computes the next past
y'(x, y, u). With respect to a parameter p, and with the regimes of the contacts in the solution,

    J dx/dp = -(dR/dy dy/dp + dR/du du/dp),   J = dR/dx                                                 (FS1)
    dy'/dp = dy'/dx dx/dp + dy'/dy dy/dp + dy'/du du/dp                                                 (FS2)

(the forward method of direct differentiation; P. Michaleris, D. A. Tortorelli, C. A. Vidal, Tangent operators and
design sensitivity formulations for transient non-linear coupled problems, Int. J. Numer. Meth. Eng. 37, 2471, 1994).
The derivative of a quantity is called its *change*. The inputs of a kernel are the inputs of a point, segment, joint or
node, followed by their changes: first changes that are filled in each step, and then the changes of the past y. A
kernel `..._residual` returns the right-hand side of (FS1) without the sign, and a kernel `..._next` returns (FS2) in
the order of the changes of the past.

Two quantities are treated as constant: the multiplier of friction of the world, and the normal load before the step,
which does not affect the solution. Every formula is differentiated from the kernel of the step itself.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from worm3d.physics import contact, elements
from worm3d.physics.friction_laws import Coulomb
from worm3d.physics.hysteresis import Hysteresis, chamber_states
from worm3d.physics.kernels import actuator, inertia, joint, point, segment
from worm3d.physics.kernels.actuator import Kind, Own
from worm3d.physics.kernels.layout import Layout, once
from worm3d.physics.kernels.node import NODE_LAYOUT
from worm3d.physics.kernels.point import POINT_LAYOUT
from worm3d.physics.kernels.segment import ACTUATOR_PREFIX, CHAMBERS, POINTS_PER_SEGMENT
from worm3d.physics.segment_laws.shapes import Rhombus

CHANGE = "change_"
"""Prefix of the names of the changes."""
Changes = dict[str, ca.SX]
"""Changes by the name of the input."""

POINT_FILLED = {"x": 3, "segment_tangent": 3, "segment_director": 3}
POINT_PAST = {"past": 6, "velocity": 6, "anchor": 3, "distance_n": 1, "normal_n": 3}
NODE_FILLED = {"x": 3}
NODE_PAST = {"past": 6, "velocity": 6}
CHAMBER_FILLED = {
    "q": segment.COORDINATES,
    "f": 3 * POINTS_PER_SEGMENT,
    "normal": 6,
    "ends": 6,  # of the joints p_i and p_{i+1} at t_n
    "actuator_command": CHAMBERS,
    "actuator_force_command": CHAMBERS,
}
JOINT_FILLED = {"q": joint.COORDINATES, "t_ref": 6, "d_ref": 6, "actuator_command": 1}


@once
def chamber_past(kind: Kind, own: Own) -> dict[str, int]:
    """Return the sizes of the changes of a segment's past by name."""
    names = ["length_n", "length_m", "angle_n", "angle_m"]
    names += [f"{ACTUATOR_PREFIX}{name}" for name in ("command_n", "given_n", "force_command_n", "force_n")]
    names += [f"{ACTUATOR_PREFIX}{state}_{at}" for state in chamber_states(kind, own) for at in "nm"]
    return {"t_ref": 3, "d_ref": 3, **dict.fromkeys(names, CHAMBERS)}


@once
def joint_past(kind: Kind) -> dict[str, int]:
    """Return the sizes of the changes of a joint's past by name."""
    names = ["command_n", "given_n", *(f"{state}_{at}" for state in kind.states for at in "nm")]
    return {"angles_n": 4, "angles_m": 4, **{ACTUATOR_PREFIX + name: 1 for name in names}}


def _with_changes(layout: Layout, *changed: Mapping[str, int]) -> Layout:
    return layout.extended({CHANGE + name: size for sizes in changed for name, size in sizes.items()})


POINT = _with_changes(POINT_LAYOUT, POINT_FILLED, POINT_PAST)
NODE = _with_changes(NODE_LAYOUT, NODE_FILLED, NODE_PAST)


@once
def chambers(kind: Kind, own: Own, law: segment.Law) -> Layout:
    """Return the inputs of the kernels of a segment."""
    return _with_changes(actuator.chambers(kind, own, law), CHAMBER_FILLED, chamber_past(kind, own))


@once
def joints(kind: Kind) -> Layout:
    """Return the inputs of the kernels of a joint."""
    return _with_changes(actuator.hinges(kind), JOINT_FILLED, joint_past(kind))


def _change(layout: Layout, expression: ca.SX, known: Changes) -> ca.SX:
    """Return the change of an expression due to the known changes of the layout's inputs."""
    return ca.jtimes(expression, ca.vertcat(*(layout.symbols[name] for name in known)), ca.vertcat(*known.values()))


def _outputs(function: ca.Function, symbols: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Return the expressions of a kernel's outputs by name."""
    found = function.call([symbols[name] for name in function.name_in()])
    return {name.removeprefix("to_"): each for name, each in zip(function.name_out(), found, strict=True)}


def _kernel(layout: Layout, name: str, outputs: Mapping[str, ca.SX]) -> ca.Function:
    """Return a kernel without repeated subexpressions."""
    return layout.function(name, dict(zip(outputs, ca.cse(list(outputs.values())), strict=True)))


# Contact points


class _Contact:
    """Changes of a contact point: of its start of the step, load, tangents and displacement y."""

    def __init__(self, law: point.Law) -> None:
        s, self.at = POINT.symbols, point.contact_of(law)
        self.dx = s[CHANGE + "x"]
        start = Layout({**POINT_LAYOUT.sizes, "normal_n": 3})
        start.symbols |= POINT_LAYOUT.symbols
        begun = {**start.symbols, "x": s["past"][:3], "normal": start.symbols["normal_n"], "distance": s["distance_n"]}
        started = _outputs(point.start(), begun)
        names = (*POINT_PAST, "segment_tangent", "segment_director")
        known = {name: s[CHANGE + name] for name in names}
        normal_n = ca.cross(s["tangent"][:3], s["tangent"][3:])

        def of(name: str) -> ca.SX:
            return ca.substitute(_change(start, started[name], known), start.symbols["normal_n"], normal_n)

        self.tangent, self.x_hat = of("tangent"), of("x_hat")
        self.distance, self.normal = ca.dot(s["normal"], self.dx), point.curvature() @ self.dx
        self.load = -s["stiff"] * (self.distance + of("carried"))
        away = s["x"] - s["anchor"]
        moved = point.in_tangents(self.dx - s[CHANGE + "anchor"])
        self.slide = moved + ca.vertcat(*(ca.dot(self.tangent[rows], away) for rows in (slice(3), slice(3, 6))))
        self.y = self.slide - of("centre")

    def along(self, fixed: ca.SX, change: ca.SX) -> ca.SX:
        """Return the change of a vector with the components `fixed`, which change by `change`, along the tangents."""
        s = POINT.symbols
        tangents = [ca.horzcat(of[:3], of[3:]) for of in (s["tangent"], self.tangent)]
        return tangents[0] @ change + tangents[1] @ fixed


def point_residual(law: point.Law = Coulomb) -> ca.Function:
    """Return the kernel of the change of the gradient f of a point's potential (3)."""
    s, c = POINT.symbols, _Contact(law)
    of, step = c.at.of, c.at.step
    at, (capacity, slope) = contact.friction(c.at.y, of, step), step.capacity(c.at.load)
    friction = capacity * c.along(at.f, contact.stiffness(at, at.f) @ c.y)
    friction += slope * c.load * (ca.horzcat(s["tangent"][:3], s["tangent"][3:]) @ at.f)
    touching = s["hold"] * friction - c.load * s["normal"] - c.at.load * c.normal
    still = s["inertia"] * (c.dx - c.x_hat)
    return _kernel(POINT, "point_residual", {"f": still + ca.if_else(c.at.load > 0.0, touching, ca.SX.zeros(3))})


def point_next(law: point.Law = Coulomb) -> ca.Function:
    """Return the kernel of the changes of a point's next past, in the order of `POINT_PAST`."""
    s, c = POINT.symbols, _Contact(law)
    slid = c.y - contact.return_stiffness(c.at.y, c.at.of, c.at.step) @ c.y
    slip = c.at.y - contact.left_after_return(c.at.y, c.at.of, c.at.step)
    held = s["hold"] > 0.0
    anchor = s[CHANGE + "anchor"] + c.along(ca.if_else(held, slip, c.at.slide), ca.if_else(held, slid, c.slide))
    known = {"x": c.dx, "x_hat": c.x_hat, "velocity": s[CHANGE + "velocity"]}
    rows = {
        "past": ca.vertcat(c.dx, s[CHANGE + "past"][:3]),
        "velocity": ca.vertcat(_change(POINT, inertia.velocity(s), known), s[CHANGE + "velocity"][:3]),
        "anchor": ca.if_else(s["load_n"] > 0.0, anchor, c.dx),
        "distance_n": c.distance,
        "normal_n": c.normal,
    }
    return _kernel(POINT, "point_next", {name: rows[name] for name in POINT_PAST})


# Joints as mass points


def node_residual() -> ca.Function:
    """Return the kernel of the change of the force of inertia and medium on a joint, at a constant position (3)."""
    s = NODE.symbols
    known = {name: s[CHANGE + name] for name in NODE_PAST}
    force = -inertia.stiffness(s) * inertia.coasting(s) - s["drag"] / s["span"] * inertia.still(s)
    return _kernel(NODE, "node_residual", {"f": _change(NODE, force, known)})


def node_next() -> ca.Function:
    """Return the kernel of the changes of a joint's next past, in the order of `NODE_PAST`."""
    s = NODE.symbols
    known = {name: s[CHANGE + name] for name in NODE_PAST}
    known = {**known, "x": s[CHANGE + "x"], "x_hat": _change(NODE, inertia.coasting(s), known)}
    velocity = _change(NODE, inertia.velocity(s), known)
    rows = [known["x"], known["past"][:3], velocity, known["velocity"][:3]]
    return _kernel(NODE, "node_next", {"past": ca.vertcat(*rows)})


# Segments with their chambers


def _of_chambers(kind: Kind, own: Own, law: segment.Law, *filled: str) -> Changes:
    """Return the changes of the inputs of a segment, with those of `CHAMBER_FILLED` that are in `filled`."""
    layout = chambers(kind, own, law)
    s, names = layout.symbols, (*filled, "actuator_command", "actuator_force_command", *chamber_past(kind, own))
    known = {name: s[CHANGE + name] for name in names if name in layout.sizes}
    for name in ("length", "angle"):
        parts = [s["weights"][k] * s[f"{CHANGE}{name}_{at}"] for k, at in enumerate("nm")]
        known[f"{name}_hat"] = parts[0] + parts[1]
    started = _outputs(actuator.start(kind, own, law), s)
    known |= {name: _change(layout, started[name], known) for name in ("commanded", "force")}
    frame = _reference(layout)
    of_rim = {**{name: known[name] for name in ("t_ref", "d_ref")}, "normal": s[CHANGE + "normal"]}
    rims = [elements.nearest_rim(frame, s["normal"][3 * k : 3 * k + 3]) for k in range(2)]
    return {**known, "rim": _change(layout, ca.vertcat(*rims), of_rim)}


def _reference(layout: Layout) -> elements.Frame:
    """Return the frame of a segment at the start of the step."""
    t, d = layout.symbols["t_ref"], layout.symbols["d_ref"]
    return elements.Frame(ca.SX(1.0), t, d, ca.cross(t, d))


def chamber_faces(kind: Kind, own: Own = Hysteresis, law: segment.Law = Rhombus) -> ca.Function:
    """Return the kernel of the changes of the points of both faces at the start of the step (6)."""
    layout = chambers(kind, own, law)
    s, known, frame = layout.symbols, _of_chambers(kind, own, law), _reference(layout)
    on = [elements.face_point(ca.SX.zeros(3), frame, s["radius"][k], s["rim"][2 * k : 2 * k + 2]) for k in range(2)]
    turned = _change(layout, ca.vertcat(*on), {name: known[name] for name in ("t_ref", "d_ref", "rim")})
    return _kernel(layout, "chamber_faces", {"x": turned + s[CHANGE + "ends"]})


def chamber_points(kind: Kind, own: Own = Hysteresis, law: segment.Law = Rhombus) -> ca.Function:
    """Return the kernel of the changes of the points (24)."""
    layout = chambers(kind, own, law)
    points = _outputs(segment.shape(law), layout.symbols)["points"]
    return _kernel(layout, "chamber_points", {"x": _change(layout, points, _of_chambers(kind, own, law, "q"))})


def chamber_residual(kind: Kind, own: Own = Hysteresis, law: segment.Law = Rhombus) -> ca.Function:
    """Return the kernel of the change of the gradient at constant coordinates (8)."""
    layout = chambers(kind, own, law)
    gradient = _outputs(actuator.gradient(kind, own, law), layout.symbols)["gradient"]
    known = _of_chambers(kind, own, law, "f")
    return _kernel(layout, "chamber_residual", {"gradient": _change(layout, gradient, known)})


def chamber_next(kind: Kind, own: Own = Hysteresis, law: segment.Law = Rhombus) -> ca.Function:
    """Return the kernel of the changes of a segment's next past, in the order of `chamber_past`."""
    layout, known = chambers(kind, own, law), _of_chambers(kind, own, law, "q")
    s, end = layout.symbols, actuator.end(kind, own, law)
    made = _outputs(actuator.start(kind, own, law), s) | ({} if end is None else _outputs(end, s))
    made |= {"frame": _outputs(segment.shape(law), s)["rest"][CHAMBERS:], "angle": segment.angles(law)}
    made["length"] = segment.lengths()

    def of(name: str) -> ca.SX:
        return _change(layout, made[name], known)

    frame = of("frame")
    rows = {"t_ref": frame[:3], "d_ref": frame[3:]}
    rows |= {f"{ACTUATOR_PREFIX}{name}_n": of(name) for name in ("command", "given", "force")}
    rows[f"{ACTUATOR_PREFIX}force_command_n"] = s[CHANGE + "actuator_force_command"]
    histories = {"length": "length", "angle": "angle"}
    histories |= {name: ACTUATOR_PREFIX + name for name in chamber_states(kind, own)}
    for name, full in histories.items():
        rows |= {f"{full}_n": of(name), f"{full}_m": s[f"{CHANGE}{full}_n"]}
    return _kernel(layout, "chamber_next", {name: rows[name] for name in chamber_past(kind, own)})


# Joints between segments


def _of_joint(kind: Kind, *filled: str) -> Changes:
    layout = joints(kind)
    s, names = layout.symbols, (*filled, "t_ref", "d_ref", "actuator_command", *joint_past(kind))
    known = {name: s[CHANGE + name] for name in names}
    known["hinge"] = _change(layout, _outputs(actuator.hinge_start(kind), s)["given"], known)
    known["strain_hat"] = _change(layout, _outputs(joint.start(), s)["strain_hat"], known)
    return known


def joint_residual(kind: Kind) -> ca.Function:
    """Return the kernel of the change of the gradient at constant coordinates, padded with zeros (16)."""
    layout = joints(kind)
    gradient = _outputs(joint.gradient(), layout.symbols)["gradient"]
    return _kernel(layout, "joint_residual", {"gradient": _change(layout, gradient, _of_joint(kind))})


def joint_next(kind: Kind) -> ca.Function:
    """Return the kernel of the changes of a joint's next past, in the order of `joint_past`."""
    layout, known = joints(kind), _of_joint(kind, "q")
    s = layout.symbols
    made = _outputs(actuator.hinge_start(kind), s) | _outputs(joint.angles(), s)
    rows = {"angles_n": _change(layout, made["angles"], known), "angles_m": s[CHANGE + "angles_n"]}
    for name in ("command", "given", *kind.states):
        rows[f"{ACTUATOR_PREFIX}{name}_n"] = _change(layout, made[name], known)
    for name in kind.states:
        rows[f"{ACTUATOR_PREFIX}{name}_m"] = s[f"{CHANGE}{ACTUATOR_PREFIX}{name}_n"]
    return _kernel(layout, "joint_next", {name: rows[name] for name in joint_past(kind)})
