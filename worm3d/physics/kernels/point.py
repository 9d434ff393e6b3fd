"""Kernels of a contact point: inertia, weight, normal contact and friction, and what follows after a step.

The world has been evaluated already: distance g, its gradient n and curvature H at X are inputs.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import casadi as ca

from worm3d.physics import contact
from worm3d.physics.kernels import inertia
from worm3d.physics.kernels.layout import Layout

LAYOUT = Layout(
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
        "tangent": 6,  # along and to the left, frozen at the start of the step; with the rows up to "deep" by `start`
        "slide_n": 2,  # displacement from the anchor at the start of the step, in these tangents
        "x_hat": 3,
        "inertia": 1,  # m/(beta dt)^2 [N/m]
        "depth_n": 1,
        "distance_n": 1,
        "hold": 1,  # the multiplier at the start of the step
        "load": 1,  # normal load for friction while it is not coupled
        "stiff": 1,  # k + c/dt of (C1) [N/m]
        "carried": 1,  # d* of (C1) [m]
        "r": 1,  # of (C3) [m]
        "centre": 2,  # s* of (C3) [m]
        "deep": 1,  # how deep it would get in the step as it moves towards the world, else 0 [m]
        "anchor": 3,
        "mu": 3,  # forward, backward, lateral
        "hardness": 3,  # H of (C2), likewise
        "yield_gauge": 1,  # rho_b [m]
        "gauge_damping": 1,  # D [s/m]
        "cap": 1,
        "pull": 2,  # f of (C5), friction per unit of normal load, along and to the left
        "foreseen": 1,  # normal load, as the last step of Newton foresaw it
        "regime": 1,  # FREE, or what the contact is taken for, whatever X says
        "error": 1,  # of what is foreseen [m]
        "breaks": 1,  # square of the share of the yield limit beyond which what sticks slides, whatever the error
        "pull_m": 2,  # pull and load a step before the last
        "load_m": 1,
        "coupled": 1,  # 1: friction takes the normal load of X itself
        "load_n": 1,  # at the end of the last step: for `after`, of this one
        "f": 3,  # for `after`: the point's gradient at the end of the step
        "of_segment": 1,  # 8 numbers of each segment, which its ledger leaves before what follows
        "first": 3,  # (dX/dq) dq
        "stored_n": 1,  # energy of the anchor at the end of the last step [J]
        "segment_tangent": 3,  # of the segment, at the start of the step
        "segment_director": 3,
    }
)

ALONG_NORMAL = 1e-6
"""Sine of the angle between segment and normal below which friction's tangent is the segment's upward normal."""


FREE, OPEN, SLIDING, STICKING, STICKING_BACK = 0.0, 1.0, 2.0, 3.0, 4.0
"""Regimes: the law decides; no contact; contact, loaded even where apart; and stuck, even beyond the yield surface.

What sticks has the coefficient against motion towards the head or, the last one, towards the tail, wherever y leads.
With a regime and coupled, K is Newton's of (C5) with the forces that were foreseen, else the derivative of f.
"""


class _Contact(NamedTuple):
    pressed: ca.SX
    """Penetration that carries load [m]."""
    touching: ca.SX
    """Penetration, negative where nothing touches [m]."""
    load: ca.SX
    of: contact.Coefficients
    law: contact.Law
    slide: ca.SX
    """Displacement from the anchor, shape (2,)."""


@cache
def _contact() -> _Contact:
    s = LAYOUT.symbols
    touching = contact.pressing(s["distance"], s["carried"])
    pressed = _pressed(touching)
    law = contact.Law(s["r"], s["cap"], s["centre"])
    away = s["x"] - s["anchor"]
    slide = ca.vertcat(*[ca.dot(t, away) for t in _tangents()])
    of = contact.Coefficients(*(contact.Directions(*ca.vertsplit(s[name])) for name in ("mu", "hardness")))
    return _Contact(pressed, touching, s["stiff"] * pressed, of, law, slide)


def _tangents() -> tuple[ca.SX, ca.SX]:
    return LAYOUT.symbols["tangent"][0:3], LAYOUT.symbols["tangent"][3:6]


def _curvature() -> ca.SX:
    xx, xy, xz, yy, yz, zz = ca.vertsplit(LAYOUT.symbols["curvature"])
    return ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))


def force() -> ca.Function:
    """Return the gradient f (3) of a point's potential, the potential and the load.

    With `coupled` f is the true residual; the potential then means nothing.
    """
    outputs = _force()
    return LAYOUT.function("point_force", {name: outputs[name] for name in ("f", "phi", "load")})


def stiffness() -> ca.Function:
    """Return what `force` does, f with the forces that were foreseen (3), and the Hessian K (9, row by row).

    With `coupled` K is the unsymmetric derivative of the residual. What was foreseen is for the second derivatives of
    the points.
    """
    return LAYOUT.function("point_stiffness", _force())


@cache
def _force() -> dict[str, ca.SX]:
    s, c = LAYOUT.symbols, _contact()
    T = ca.horzcat(*_tangents())
    y = c.slide - c.law.centre
    soft = [ca.if_else(s["coupled"] != 0.0, each, 1.0) for each in c.of.hardness]  # else f had no potential
    of = _sided(contact.Coefficients(c.of.mu, contact.Directions(*soft)))
    at = contact.friction(y, of, c.law, s["regime"] >= STICKING)
    mixed = ca.logic_and(s["coupled"] != 0.0, s["regime"] != FREE)
    load = ca.if_else(ca.logic_and(mixed, s["regime"] != OPEN), s["foreseen"], c.load)
    pull = ca.if_else(mixed, s["pull"], at.f)
    K_y = contact.stiffness(at, pull)
    grip, held = (s["hold"] * ca.if_else(s["coupled"] != 0.0, each, s["load"]) for each in (c.load, load))
    still = inertia.force(s) - s["weight"]
    f = still - c.load * s["normal"] + grip * (T @ at.f)
    f_ahead = still - load * s["normal"] + held * (T @ pull)
    rising = ca.if_else(ca.logic_or(c.pressed > 0.0, s["regime"] >= SLIDING), s["stiff"], 0.0)
    K = s["inertia"] * ca.SX.eye(3) + rising * s["normal"] @ s["normal"].T - load * _curvature()
    K += ca.fmax(held, 0.0) * (T @ K_y @ T.T) - s["coupled"] * s["hold"] * rising * (T @ pull) @ s["normal"].T
    phi = (
        s["inertia"] / 2.0 * ca.sumsqr(s["x"] - s["x_hat"])
        - ca.dot(s["weight"], s["x"])
        + c.load * c.pressed / 2.0
        + grip * contact.potential(y, at, c.law)
    )
    return {"f": f, "phi": phi, "load": c.load, "f_ahead": f_ahead, "K": ca.vec(K.T)}


def _sided(of: contact.Coefficients) -> contact.Coefficients:
    """Return the coefficients of a regime: where a contact sticks, the same for both directions along the segment."""
    regime = LAYOUT.symbols["regime"]
    sides = [
        contact.Directions(
            ca.if_else(regime == STICKING_BACK, each.backward, each.forward),
            ca.if_else(regime == STICKING, each.forward, each.backward),
            each.lateral,
        )
        for each in of
    ]
    return contact.Coefficients(*sides)


def start() -> ca.Function:
    """Return what is known at the start of a step: the rows from "tangent" to "deep" (22)."""
    s = LAYOUT.symbols
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
        "deep": ca.if_else(strikes, approach * s["dt"] - s["distance"], 0.0),
    }
    return LAYOUT.function("point_start", rows)


def _projected() -> tuple[list[ca.SX], list[ca.SX]]:
    """Return the tangents at X, along the segment, projected, and to its left, and the displacement in them."""
    s = LAYOUT.symbols
    n, t = s["normal"], s["segment_tangent"]
    along, upward = (each - ca.dot(each, n) * n for each in (t, ca.cross(t, s["segment_director"])))
    along = ca.if_else(ca.sumsqr(along) < ALONG_NORMAL**2, upward, along)
    along /= ca.norm_2(along)
    left = ca.cross(n, along)
    return [along, left], [ca.dot(each, s["x"] - s["anchor"]) for each in (along, left)]


SWUNG = 3e-5
"""Square of the change of y, as a fraction of itself, after which the K of a contact that slides is made anew."""

HELD = 0.25
"""Square of the share of the law's own force below which the force of what slides is foreseen where it sticks."""

TURNED = 1e-7
"""Fraction of the yield limit up to which it does not count on which side of 0 the force of a stuck contact is."""


def yielding() -> ca.Function:
    """Return what a contact does at X + `first`, to first order, in metres.

    y = s - s* (2); by how much it is beyond the yield limit, for the largest coefficient; the penetration -g - d*
    (negative where nothing touches); f' (2) of (C5) and the normal load; the square of the fraction of itself, or of
    the yield limit, by which y changes; the regime that follows where the law denies one by more than `error`;
    whether K of before is out of date: with another regime, or where y changes by more than `SWUNG`; by how much eta is
    beyond (C6); and by how much it changes, the error included.
    """
    s, c = LAYOUT.symbols, _contact()
    now = c.slide - c.law.centre
    dy = ca.vertcat(*[ca.dot(t, s["first"]) for t in _tangents()])
    y, opens = now + dy, s["regime"] == OPEN
    bound = ca.logic_or(s["regime"] >= STICKING, opens)
    at = contact.friction(now, _sided(c.of), c.law, bound)
    pull, swing = contact.pulled(now, dy, s["pull"], at, c.law)
    share = contact.share(pull, _sided(c.of), c.law.cap)
    eta = ca.sqrt(contact.squares(y, c.of)[1])
    largest = ca.mmax(s["mu"] * s["hardness"])
    excess = (eta - c.law.cap * c.law.r * (1.0 + contact.YIELD_TOLERANCE)) / largest
    touching = c.touching - ca.dot(s["normal"], s["first"])
    backs = ca.dot(_elastic(now) ** 2 * now, y) <= 0.0
    held = HELD * ca.if_else(at.multiplier > 0.0, contact.share(at.f, _sided(c.of), c.law.cap), 1.0)
    recent = ca.norm_2(_elastic(y) * dy) + largest * s["error"]
    regime = _next(y, eta, excess, touching, share < held, backs)
    swings = ca.logic_and(s["regime"] == SLIDING, swing > SWUNG)
    rows = {
        "y": y,
        "excess": excess,
        "touching": touching,
        "pull": pull / ca.sqrt(ca.fmax(share, 1.0)),
        "foreseen": s["stiff"] * _pressed(touching),
        "swing": swing,
        "regime": regime,
        "stale": ca.logic_or(regime != s["regime"], swings),
        "reach": contact.reach(y, c.of, c.law),
        "recent": recent,
    }
    return LAYOUT.function("point_yielding", rows)


def _pressed(touching: ca.SX) -> ca.SX:
    """Return the penetration that carries load: less than none in a regime of contact, which may be wrong."""
    regime = LAYOUT.symbols["regime"]
    return ca.if_else(regime >= SLIDING, touching, ca.if_else(regime == OPEN, 0.0, ca.fmax(0.0, touching)))


def _elastic(y: ca.SX) -> ca.SX:
    """Return H mu of (C2), shape (2,)."""
    of = _contact().of
    return of.mu.of(y) * of.hardness.of(y)


def _next(y: ca.SX, eta: ca.SX, excess: ca.SX, touching: ca.SX, held: ca.SX, backs: ca.SX) -> ca.SX:
    """Return the regime that follows where the law denies one by more than the error."""
    s, c = LAYOUT.symbols, _contact()
    error, regime = s["error"], s["regime"]
    sticking = ca.if_else(y[0] >= 0.0, STICKING, STICKING_BACK)
    side = ca.if_else(regime == STICKING_BACK, y[0], -y[0])  # how far it is on the other side
    limit = c.law.cap * c.law.r
    counts = ca.fabs(_elastic(y)[0] * y[0]) > TURNED * limit
    turned = ca.logic_and(ca.logic_and(side > error, counts), c.of.mu.forward != c.of.mu.backward)
    far = eta**2 > s["breaks"] * limit**2
    of_stuck = ca.if_else(turned, sticking, ca.if_else(ca.logic_or(far, excess > error), SLIDING, regime))
    rests = ca.logic_or(excess < -error, held)
    of_touching = ca.if_else(regime == SLIDING, ca.if_else(rests, sticking, SLIDING), of_stuck)
    of_open = ca.if_else(ca.logic_or(backs, excess <= error), sticking, SLIDING)
    free = ca.if_else(touching > 0.0, ca.if_else(excess > 0.0, SLIDING, sticking), OPEN)
    found = ca.if_else(touching < -error, OPEN, of_touching)
    found = ca.if_else(regime == OPEN, ca.if_else(touching > error, of_open, OPEN), found)
    return ca.if_else(s["stiffness"] > 0.0, ca.if_else(regime == FREE, free, found), OPEN)


def expected() -> ca.Function:
    """Return f of (C5), load and regime that a contact will have if it goes on as in the last two steps.

    X and `regime` are those of the start of the step, `first` is the motion that is expected; what lands is taken for
    pressed in by `error`.
    """
    s, c = LAYOUT.symbols, _contact()
    y = c.slide - c.law.centre + ca.vertcat(*[ca.dot(t, s["first"]) for t in _tangents()])
    at = contact.friction(y, c.of, c.law)
    trend = 2.0 * s["pull"] - s["pull_m"]
    share = contact.share(trend, c.of, c.law.cap)
    known, stuck = s["load_m"] > 0.0, s["regime"] >= STICKING
    lands = ca.logic_and(s["regime"] == OPEN, c.touching - ca.dot(s["normal"], s["first"]) > 0.0)
    lands = ca.logic_and(lands, s["stiffness"] > 0.0)
    lifts = ca.logic_and(known, 2.0 * s["load_n"] < s["load_m"])
    breaks = ca.logic_and(stuck, ca.logic_and(known, share > 1.0))
    turns = ca.logic_and(s["regime"] == SLIDING, ca.logic_and(at.multiplier > 0.0, ca.dot(y, s["pull"]) < 0.0))
    regime = ca.if_else(ca.logic_or(breaks, lands), SLIDING, s["regime"])
    regime = ca.if_else(ca.logic_and(s["regime"] >= SLIDING, lifts), OPEN, regime)
    pull = ca.if_else(breaks, trend / ca.sqrt(share), ca.if_else(ca.logic_or(turns, lands), at.f, s["pull"]))
    load = ca.if_else(lands, s["stiff"] * s["error"], s["load_n"])
    return LAYOUT.function("point_expected", {"pull": pull, "foreseen": load, "regime": regime})


def _slip() -> ca.SX:
    """Motion of the anchor (C4), shape (2,): zero where nothing touches, all of s where the place has no grip."""
    s, c = LAYOUT.symbols, _contact()
    y = c.slide - c.law.centre
    slip = y - contact.left_after_return(y, c.of, c.law)
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


def after() -> ca.Function:
    """Return the point's terms of the ledger, as in `LEDGER_TERMS`, and the state with which the next step begins."""
    s, slip, touches = LAYOUT.symbols, _slip(), LAYOUT.symbols["load_n"] > 0.0
    stored, friction = _friction_ledger(slip)
    parts = (friction, _normal_ledger(), inertia.ledger(s, s["first"]))
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
    return LAYOUT.function("point_after", {name: rows[name] for name in AFTER.sizes})


def momenta() -> ca.Function:
    """Return momentum (3), angular momentum about the origin (3) and mass times place (3)."""
    return LAYOUT.function("point_momenta", {"momenta": inertia.momenta(LAYOUT.symbols)})


def _normal_ledger() -> dict[str, ca.SX]:
    """Return penetration, loss by impact and numerical loss of the normal contact."""
    s, c = LAYOUT.symbols, _contact()
    depth = ca.fmax(0.0, -s["distance"])
    rise = s["stiffness"] / 2.0 * (depth**2 - s["depth_n"] ** 2)
    mean, first = (c.load * ca.dot(s["normal"], way) for way in (inertia.mean_motion(s), s["first"]))
    damped = (c.load - s["stiffness"] * depth) * (s["distance_n"] - s["distance"])
    impact = ca.if_else(s["lands"] != 0.0, -mean - rise, damped)
    return {"penetration": rise, "impact": impact, "numerical_loss": -first - rise - impact}


def _friction_ledger(slip: ca.SX) -> tuple[ca.SX, dict[str, ca.SX]]:
    """Return the anchor's energy at the end of the step, and friction's terms."""
    s, c = LAYOUT.symbols, _contact()
    touching = c.load > 0.0
    load, s_n = s["hold"] * c.load, s["slide_n"]
    ways = (inertia.motion(s), s["first"], inertia.mean_motion(s))
    moved, first, mean = (ca.vertcat(*[ca.dot(t, way) for t in _tangents()]) for way in ways)
    left = s_n + ca.if_else(touching, moved - slip, ca.SX.zeros(2))
    y = ca.SX.sym("y", 2)
    energy = contact.anchor_energy(y, c.of, s["yield_gauge"])

    def of(expression: ca.SX, at: ca.SX) -> ca.SX:
        return ca.substitute(expression, y, at)

    stored, stored_n = load * of(energy, left), load * of(energy, s_n)
    spring = load * of(ca.gradient(energy, y), left)
    at = contact.friction(c.slide - c.law.centre, c.of, c.law)
    force = load * at.f  # (C4) keeps it
    loss = load * s["cap"] * ca.sqrt(contact.squares(slip, c.of)[0])
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
