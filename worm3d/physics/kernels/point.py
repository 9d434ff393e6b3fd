"""Kernels of a contact point: inertia, weight, normal contact and friction, and the state after a step.

The kernel of the world runs before. Its results, the distance g, its gradient n and its curvature H at X, are inputs
here. Kernels with friction are made for a law of friction (`worm3d.physics.friction_laws`).
`worm3d.physics.kernels.regime` contains the kernels with which Newton's method guesses regimes.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from worm3d.physics import contact
from worm3d.physics.friction_laws import MAX_PARAMETERS, Coulomb, FrictionLaw
from worm3d.physics.kernels import inertia
from worm3d.physics.kernels.layout import Layout, once

POINT_LAYOUT = Layout(
    {
        "x": 3,
        "distance": 1,
        "normal": 3,
        "curvature": 6,  # xx, xy, xz, yy, yz, zz of the distance's Hessian
        "grip": 1,  # the world's multiplier of friction at X
        "weight": 3,  # m g [N]
        "stiffness": 1,  # k [N/m], 0 without contact
        "damping": 1,  # c [N s/m]
        **inertia.SIZES,
        "tangent": 6,  # along and to the left, constant in the step; `start` computes the rows from here to "deep"
        "slide_n": 2,  # displacement from the anchor at the start of the step, in the tangents
        "x_hat": 3,
        "inertia": 1,  # m/(beta dt)^2 [N/m]
        "depth_n": 1,
        "distance_n": 1,
        "hold": 1,  # the world's multiplier of friction at the start of the step
        "load": 1,  # normal load for friction if "coupled" is 0
        "stiff": 1,  # k + c/dt of (C1) [N/m]
        "carried": 1,  # d* of (C1) [m]
        "r": 1,  # of (C3) [m]
        "centre": 2,  # s* of (C3) [m]
        "deep": 1,  # increase of depth in the step if the point moves towards the world, else 0 [m]
        "anchor": 3,
        "mu": 3,  # forward, backward, lateral
        "hardness": 3,  # H of (C2), in the same order
        "yield_gauge": 1,  # rho_b [m]
        "gauge_damping": 1,  # D [s/m]
        "limit_ratio": 1,  # c_0 of (C3): static_ratio while stuck, otherwise 1
        "pull": 2,  # predicted friction f of (C5), per unit of capacity; also its name in stored states
        "foreseen": 1,  # normal load predicted by the last Newton step
        "regime": 1,  # FREE, or the assumed regime, regardless of X
        "error": 1,  # error of the prediction [m]
        "breaks": 1,  # square of the ratio of eta to the yield limit above which a stuck contact slides at any error
        "pull_m": 2,  # predicted friction and normal load at the end of the step before the last
        "load_m": 1,
        "coupled": 1,  # 1 if friction uses the normal load at X, otherwise 0
        "load_n": 1,  # normal load at the end of the last step; for `after`, of this step
        "f": 3,  # for `after`: the point's gradient at the end of the step
        "of_segment": 1,  # row for the 8 terms of the segment's ledger, which are directly before "first"
        "first": 3,  # (dX/dq) dq
        "stored_n": 1,  # energy of the anchor at the end of the last step [J]
        "segment_tangent": 3,  # of the segment, at the start of the step
        "segment_director": 3,
        "law": MAX_PARAMETERS,  # parameters of the law of friction
    }
)

FREE, OPEN, SLIDING, STICKING_FORWARD, STICKING_BACK = map(float, range(5))
"""Regimes. FREE: the friction law decides. OPEN: no contact. SLIDING: a contact that slides; it has a load even if the
point is above the surface. STICKING_FORWARD and STICKING_BACK: a contact that sticks, even beyond the yield surface.

At any y, STICKING_FORWARD uses the coefficient against motion towards the head, and STICKING_BACK the coefficient
against motion towards the tail. If a regime other than FREE is set and "coupled" is 1, K is the matrix of (C5) at the
predicted forces. Otherwise K is the derivative of f.
"""

Law = type[FrictionLaw]


class Contact(NamedTuple):
    """Contact of a point at X, in symbols."""

    pressed: ca.SX
    """Penetration that causes load [m]."""
    touching: ca.SX
    """Penetration, negative if the point does not touch the world [m]."""
    load: ca.SX
    of: contact.Coefficients
    step: contact.Step
    slide: ca.SX
    """Displacement s from the anchor, shape (2,)."""
    y: ca.SX
    """s - s* of (C3), shape (2,)."""


@once
def contact_of(law: Law) -> Contact:
    """Return the contact of a point under a law of friction."""
    s = POINT_LAYOUT.symbols
    touching = -s["distance"] - s["carried"]  # -g - d* of (C1)
    pressed = penetration(touching)
    step = contact.Step(s["r"], s["limit_ratio"], s["centre"], s["dt"], law, law.symbols(s["law"]))
    slide = in_tangents(s["x"] - s["anchor"])
    of = contact.Coefficients(*(contact.Directions(*ca.vertsplit(s[name])) for name in ("mu", "hardness")))
    return Contact(pressed, touching, s["stiff"] * pressed, of, step, slide, slide - step.centre)


def penetration(touching: ca.SX) -> ca.SX:
    """Return the penetration that causes load [m]; it is negative if an open point is wrongly assumed to touch."""
    regime = POINT_LAYOUT.symbols["regime"]
    return ca.if_else(regime >= SLIDING, touching, ca.if_else(regime == OPEN, 0.0, ca.fmax(0.0, touching)))


def in_tangents(vector: ca.SX) -> ca.SX:
    """Return the components of a vector along the segment and to its left, shape (2,)."""
    return ca.vertcat(*[ca.dot(t, vector) for t in _tangents()])


def _tangents() -> tuple[ca.SX, ca.SX]:
    return POINT_LAYOUT.symbols["tangent"][0:3], POINT_LAYOUT.symbols["tangent"][3:6]


def curvature() -> ca.SX:
    """Return the Hessian of the distance at X, shape (3, 3) [1/m]."""
    xx, xy, xz, yy, yz, zz = ca.vertsplit(POINT_LAYOUT.symbols["curvature"])
    return ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))


def force(law: Law = Coulomb) -> ca.Function:
    """Return the gradient f (3) of a point's potential, the potential and the load.

    If "coupled" is 1, f is the true residual, and the potential is meaningless.
    """
    outputs = _force(law)
    return POINT_LAYOUT.function("point_force", {name: outputs[name] for name in ("f", "phi", "load")})


def stiffness(law: Law = Coulomb) -> ca.Function:
    """Return the outputs of `force`, f with the predicted forces (3), and the Hessian K (9, row by row).

    If "coupled" is 1, K is the unsymmetric derivative of the residual. The f with the predicted forces is used in the
    second derivatives of the points.
    """
    return POINT_LAYOUT.function("point_stiffness", _force(law))


def ahead(law: Law = Coulomb) -> ca.Function:
    """Return the outputs of `stiffness`, but with the K of a free point. The part of the contact is added later."""
    return POINT_LAYOUT.function("point_ahead", {**_force(law), "K": ca.vec(_still()[2])})


def free_force() -> ca.Function:
    """Return the outputs of `force` for a point in the regime OPEN with "coupled" equal to 1."""
    outputs = _free()
    return POINT_LAYOUT.function("point_free_force", {name: outputs[name] for name in ("f", "phi", "load")})


def free_stiffness() -> ca.Function:
    """Return the outputs of `stiffness` for such a point."""
    return POINT_LAYOUT.function("point_free_stiffness", _free())


def _free() -> dict[str, ca.SX]:
    f, phi, K = _still()
    return {"f": f, "phi": phi, "load": ca.SX(0.0), "f_ahead": f, "K": ca.vec(K)}


def _still() -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return gradient, potential and Hessian of inertia and weight."""
    s = POINT_LAYOUT.symbols
    phi = s["inertia"] / 2.0 * ca.sumsqr(s["x"] - s["x_hat"]) - ca.dot(s["weight"], s["x"])
    return inertia.force(s) - s["weight"], phi, s["inertia"] * ca.SX.eye(3)


@once
def _force(law: Law) -> dict[str, ca.SX]:
    s, c = POINT_LAYOUT.symbols, contact_of(law)
    T = ca.horzcat(*_tangents())
    soft = [ca.if_else(s["coupled"] != 0.0, each, 1.0) for each in c.of.hardness]  # else f would have no potential
    of = sided(contact.Coefficients(c.of.mu, contact.Directions(*soft)))
    at = contact.friction(c.y, of, c.step, s["regime"] >= STICKING_FORWARD)
    mixed = ca.logic_and(s["coupled"] != 0.0, s["regime"] != FREE)
    load = ca.if_else(ca.logic_and(mixed, s["regime"] != OPEN), s["foreseen"], c.load)
    pull = ca.if_else(mixed, s["pull"], at.f)
    K_y = contact.stiffness(at, pull)
    (capacity, _), (ahead, slope) = (
        c.step.capacity(ca.if_else(s["coupled"] != 0.0, each, s["load"])) for each in (c.load, load)
    )
    grip, held = s["hold"] * capacity, s["hold"] * ahead
    still, phi, K = _still()
    f = still - c.load * s["normal"] + grip * (T @ at.f)
    f_ahead = still - load * s["normal"] + held * (T @ pull)
    rising = ca.if_else(ca.logic_or(c.pressed > 0.0, s["regime"] >= SLIDING), s["stiff"], 0.0)
    K += rising * s["normal"] @ s["normal"].T - load * curvature()
    coupling = s["coupled"] * s["hold"] * slope * rising * (T @ pull) @ s["normal"].T
    K += ca.fmax(held, 0.0) * (T @ K_y @ T.T) - coupling
    phi += c.load * c.pressed / 2.0 + grip * at.potential
    return {"f": f, "phi": phi, "load": c.load, "f_ahead": f_ahead, "K": ca.vec(K.T)}


def sided(of: contact.Coefficients) -> contact.Coefficients:
    """Return the coefficients of the regime. If the contact sticks, both directions along the segment have the same."""
    regime = POINT_LAYOUT.symbols["regime"]
    sides = [
        contact.Directions(
            ca.if_else(regime == STICKING_BACK, each.backward, each.forward),
            ca.if_else(regime == STICKING_FORWARD, each.forward, each.backward),
            each.lateral,
        )
        for each in of
    ]
    return contact.Coefficients(*sides)


def start() -> ca.Function:
    """Return the quantities that are known at the start of a step: the rows from "tangent" to "deep" (22)."""
    s = POINT_LAYOUT.symbols
    tangents, slide = _projected()
    depth = ca.fmax(0.0, -s["distance"])
    damping, gauge_damping = s["damping"] / s["dt"], s["gauge_damping"] / s["dt"]
    stiff, r = s["stiffness"] + damping, 1.0 / (1.0 / s["yield_gauge"] + gauge_damping)
    approach = -ca.dot(s["velocity"][:3], s["normal"])
    strikes = ca.logic_and(s["stiffness"] > 0.0, approach > 0.0)
    rows: dict[str, ca.SX | list[ca.SX]] = {
        "tangent": tangents,
        "slide_n": slide,
        "x_hat": inertia.coasting(s),
        "inertia": inertia.stiffness(s),
        "depth_n": depth,
        "distance_n": s["distance"],
        "hold": s["grip"],
        "load": s["load_n"],
        "stiff": stiff,
        "carried": ca.if_else(stiff > 0.0, damping * depth / stiff, 0.0),
        "r": r,
        "centre": [gauge_damping * r * each for each in slide],
        "deep": ca.if_else(strikes, approach * s["dt"] - ca.fmax(0.0, s["distance"]), 0.0),
    }
    return POINT_LAYOUT.function("point_start", rows)


def _projected() -> tuple[list[ca.SX], list[ca.SX]]:
    """Return the tangents at X, and the components of the displacement from the anchor along both.

    The first tangent is the tangent of the segment, projected on the surface. The second points to its left. If the
    segment is parallel to the normal to within 1e-6 rad, its upward director is projected instead.
    """
    s = POINT_LAYOUT.symbols
    n, t = s["normal"], s["segment_tangent"]
    along, upward = (each - ca.dot(each, n) * n for each in (t, ca.cross(t, s["segment_director"])))
    along = ca.if_else(ca.sumsqr(along) < 1e-6**2, upward, along)
    along /= ca.norm_2(along)
    left = ca.cross(n, along)
    return [along, left], [ca.dot(each, s["x"] - s["anchor"]) for each in (along, left)]


def _slip(law: Law) -> ca.SX:
    """Return the motion of the anchor, (C4), shape (2,): 0 without contact, s where the world has no friction."""
    s, c = POINT_LAYOUT.symbols, contact_of(law)
    slip = c.y - contact.left_after_return(c.y, c.of, c.step)
    return ca.if_else(c.load > 0.0, ca.if_else(s["hold"] > 0.0, slip, c.slide), ca.SX.zeros(2))


LEDGER_TERMS = (
    "kinetic",
    "potential",
    "load_change",
    "penetration",
    "anchor",
    "viscous_loss",
    "impact",
    "numerical_loss",
    "work_friction_p13",
    "friction_loss",
)
AFTER = Layout(
    {
        "terms": len(LEDGER_TERMS),
        "force": 3,  # of the world on the point [N]
        "stuck": 1,
        "slipped": 1,  # [m]
        "velocity": 3,
        "anchor": 3,
        "stored": 1,
    }
)
"""Outputs of `after`."""


def after(law: Law = Coulomb) -> ca.Function:
    """Return the point's terms of the ledger, as in `LEDGER_TERMS`, and the state at the start of the next step."""
    s, slip, touches = POINT_LAYOUT.symbols, _slip(law), POINT_LAYOUT.symbols["load_n"] > 0.0
    stored, friction = _friction_ledger(law, slip)
    parts = (friction, _normal_ledger(law), inertia.ledger(s, s["first"]))
    terms = [sum((part[name] for part in parts if name in part), ca.SX(0.0)) for name in LEDGER_TERMS]
    along, left = _tangents()
    rows = {
        "terms": ca.vertcat(*terms),
        "force": inertia.force(s) - s["weight"] - s["f"],
        "stuck": ca.logic_or(ca.logic_not(touches), ca.logic_and(slip[0] == 0.0, slip[1] == 0.0)),
        "slipped": ca.norm_2(slip),
        "velocity": inertia.velocity(s),
        "anchor": ca.if_else(touches, s["anchor"] + along * slip[0] + left * slip[1], s["x"]),
        "stored": ca.if_else(touches, stored, 0.0),
    }
    return POINT_LAYOUT.function("point_after", {name: rows[name] for name in AFTER.sizes})


def touches() -> ca.Function:
    """Return whether a point has or had load, or is in the world. For other points `free_after` equals `after`."""
    s = POINT_LAYOUT.symbols
    signs = ca.vertcat(s["load_n"], s["stored_n"], s["depth_n"], -s["distance"])
    return POINT_LAYOUT.function("point_touches", {"touches": ca.mmax(signs) > 0.0})


def free_after() -> ca.Function:
    """Return the outputs of `after` for a point that touches nothing."""
    s = POINT_LAYOUT.symbols
    own = inertia.ledger(s, s["first"])
    rows = {
        "terms": ca.vertcat(*[own.get(name, ca.SX(0.0)) for name in LEDGER_TERMS]),
        "force": ca.SX.zeros(3),
        "stuck": ca.SX(1.0),
        "slipped": ca.SX(0.0),
        "velocity": inertia.velocity(s),
        "anchor": s["x"],
        "stored": ca.SX(0.0),
    }
    return POINT_LAYOUT.function("point_free_after", {name: rows[name] for name in AFTER.sizes})


def momenta() -> ca.Function:
    """Return momentum (3), angular momentum about the origin (3) and mass times position (3)."""
    return POINT_LAYOUT.function("point_momenta", {"momenta": inertia.momenta(POINT_LAYOUT.symbols)})


def _normal_ledger(law: Law) -> dict[str, ca.SX]:
    """Return the terms of the normal contact: change of penetration energy, loss by impact, and numerical loss."""
    s, c = POINT_LAYOUT.symbols, contact_of(law)
    depth = ca.fmax(0.0, -s["distance"])
    rise = s["stiffness"] / 2.0 * (depth**2 - s["depth_n"] ** 2)
    mean, first = (c.load * ca.dot(s["normal"], way) for way in (inertia.mean_motion(s), s["first"]))
    damped = (c.load - s["stiffness"] * depth) * (s["distance_n"] - s["distance"])
    impact = ca.if_else(s["lands"] != 0.0, -mean - rise, damped)
    return {"penetration": rise, "impact": impact, "numerical_loss": -first - rise - impact}


def _friction_ledger(law: Law, slip: ca.SX) -> tuple[ca.SX, dict[str, ca.SX]]:
    """Return the energy of the anchor at the end of the step, and the terms of friction."""
    s, c = POINT_LAYOUT.symbols, contact_of(law)
    touching = c.load > 0.0
    load, s_n = s["hold"] * c.step.capacity(c.load)[0], s["slide_n"]
    moved, first, mean = map(in_tangents, (inertia.motion(s), s["first"], inertia.mean_motion(s)))
    left = s_n + ca.if_else(touching, moved - slip, ca.SX.zeros(2))
    y = ca.SX.sym("y", 2)
    energy = contact.anchor_energy(y, c.of, s["yield_gauge"])

    def of(expression: ca.SX, at: ca.SX) -> ca.SX:
        return ca.substitute(expression, y, at)

    stored, stored_n = load * of(energy, left), load * of(energy, s_n)
    spring = load * of(ca.gradient(energy, y), left)
    at = contact.friction(c.y, c.of, c.step)
    force = load * at.f  # the return (C4) does not change the force
    lost = ca.sqrt(contact.squares(slip, c.of)[0])
    loss = load * c.step.strength(lost)[0] * lost
    load_change = stored_n - s["stored_n"]
    stretch = left - s_n
    impact = s["lands"] * ca.dot(force, mean - moved)
    numerical = ca.dot(spring, stretch) - (stored - stored_n) + ca.dot(force, first - moved)
    numerical += ca.dot(force, slip) - loss - impact
    viscous = ca.dot(force - spring, stretch)
    return stored, {
        "load_change": load_change,
        "anchor": stored - stored_n + load_change,
        "friction_loss": loss,
        "viscous_loss": viscous,
        "impact": impact,
        "numerical_loss": numerical,
        "work_friction_p13": -ca.dot(force, moved),
    }
