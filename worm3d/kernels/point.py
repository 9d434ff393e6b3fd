"""Kernels of a contact point: inertia, weight, normal contact and friction, and what follows after a step.

The world has been evaluated already: distance g, its gradient n and curvature H at X are inputs.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import casadi as ca

from worm3d import contact
from worm3d.kernels.layout import Layout

LAYOUT = Layout(
    {
        "x": 3,
        "distance": 1,
        "normal": 3,
        "curvature": 6,  # xx, xy, xz, yy, yz, zz of the distance's Hessian
        "grip": 1,  # the world's multiplier of friction at X
        "x_hat": 3,
        "inertia": 1,  # m/(beta dt)^2 [N/m]
        "weight": 3,  # m g [N]
        "stiffness": 1,  # k [N/m], 0 without contact
        "damping": 1,  # c [N s/m]
        "dt": 1,
        "depth_n": 1,
        "tangent": 6,  # along and to the left, frozen at the start of the step
        "slide_n": 2,  # displacement from the anchor at the start of the step, in these tangents
        "anchor": 3,
        "mu": 3,  # forward, backward, lateral
        "hold": 1,  # the multiplier at the start of the step
        "yield_gauge": 1,  # rho_b [m]
        "gauge_damping": 1,  # D [s/m]
        "cap": 1,
        "load": 1,  # normal load for friction while it is not coupled
        "pull": 2,  # f of (C5), friction per unit of normal load, along and to the left
        "foreseen": 1,  # normal load, as the last step of Newton foresaw it
        "regime": 1,  # FREE, or what the contact is taken for, whatever X says
        "error": 1,  # of what is foreseen [m]
        "breaks": 1,  # square of the share of the yield limit beyond which what sticks slides, whatever the error
        "pull_m": 2,  # pull and load a step before the last
        "load_m": 1,
        "coupled": 1,  # 1: friction takes the normal load of X itself
        "load_n": 1,
        "motion": 3,  # X - X_n
        "first": 3,  # (dX/dq) dq
        "distance_n": 1,
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
    stiff: ca.SX
    """k + c/dt [N/m]."""
    pressed: ca.SX
    """Penetration that carries load [m]."""
    touching: ca.SX
    """Penetration, negative where nothing touches [m]."""
    load: ca.SX
    mu: contact.Coefficients
    law: contact.Law
    slide: ca.SX
    """Displacement from the anchor, shape (2,)."""


@cache
def _contact() -> _Contact:
    s = LAYOUT.symbols
    stiff = s["stiffness"] + s["damping"] / s["dt"]
    centre = ca.if_else(stiff > 0.0, s["damping"] / s["dt"] * s["depth_n"] / stiff, 0.0)
    touching = contact.pressing(s["distance"], centre)
    pressed = _pressed(touching)
    viscous = s["gauge_damping"] / s["dt"]
    r = 1.0 / (1.0 / s["yield_gauge"] + viscous)
    law = contact.Law(r, s["cap"], viscous * r * s["slide_n"])
    away = s["x"] - s["anchor"]
    slide = ca.vertcat(*[ca.dot(t, away) for t in _tangents()])
    return _Contact(stiff, pressed, touching, stiff * pressed, contact.Coefficients(*ca.vertsplit(s["mu"])), law, slide)


def _tangents() -> tuple[ca.SX, ca.SX]:
    return LAYOUT.symbols["tangent"][0:3], LAYOUT.symbols["tangent"][3:6]


def _curvature() -> ca.SX:
    xx, xy, xz, yy, yz, zz = ca.vertsplit(LAYOUT.symbols["curvature"])
    return ca.vertcat(ca.horzcat(xx, xy, xz), ca.horzcat(xy, yy, yz), ca.horzcat(xz, yz, zz))


def force() -> ca.Function:
    """Return the gradient f (3) of a point's potential, its Hessian K (9, row by row), the potential and the load.

    With `coupled` f is the true residual and K its unsymmetric derivative; the potential then means nothing. Behind f
    stands what it is with the forces that were foreseen (3), for the second derivatives of the points.
    """
    s, c = LAYOUT.symbols, _contact()
    away, T = s["x"] - s["x_hat"], ca.horzcat(*_tangents())
    y = ca.SX.sym("y", 2)
    potential = contact.friction_potential(y, _sided(c.mu), c.law, s["regime"] >= STICKING)
    curve, slope = ca.hessian(potential, y)
    h, h_y, h_yy = (ca.substitute(each, y, c.slide - c.law.centre) for each in (potential, slope, curve))
    own, _, _ = contact.pulled(
        c.slide - c.law.centre, ca.SX.zeros(2), s["pull"], _sided(c.mu), c.law, s["regime"] >= STICKING
    )
    mixed = ca.logic_and(s["coupled"] != 0.0, s["regime"] != FREE)
    load = ca.if_else(ca.logic_and(mixed, s["regime"] != OPEN), s["foreseen"], c.load)
    pull, h_yy = ca.if_else(mixed, s["pull"], h_y), ca.if_else(mixed, own, h_yy)
    grip, held = (s["hold"] * ca.if_else(s["coupled"] != 0.0, each, s["load"]) for each in (c.load, load))
    still = s["inertia"] * away - s["weight"]
    f = still - c.load * s["normal"] + grip * (T @ h_y)
    f_ahead = still - load * s["normal"] + held * (T @ pull)
    rising = ca.if_else(ca.logic_or(c.pressed > 0.0, s["regime"] >= SLIDING), c.stiff, 0.0)
    K = s["inertia"] * ca.SX.eye(3) + rising * s["normal"] @ s["normal"].T - load * _curvature()
    K += ca.fmax(held, 0.0) * (T @ h_yy @ T.T) - s["coupled"] * s["hold"] * rising * (T @ pull) @ s["normal"].T
    phi = s["inertia"] / 2.0 * ca.sumsqr(away) - ca.dot(s["weight"], s["x"]) + c.load * c.pressed / 2.0 + grip * h
    outputs = {"f": f, "f_ahead": f_ahead, "K": ca.vec(K.T), "phi": phi, "load": c.load}
    return LAYOUT.function("point_force", outputs)


def _sided(mu: contact.Coefficients) -> contact.Coefficients:
    """Return the coefficients of a regime: where a contact sticks, the same for both directions along the segment."""
    regime = LAYOUT.symbols["regime"]
    forward = ca.if_else(regime == STICKING_BACK, mu.backward, mu.forward)
    return contact.Coefficients(forward, ca.if_else(regime == STICKING, mu.forward, mu.backward), mu.lateral)


def tangents() -> ca.Function:
    """Return the tangents (6) at X, along the segment, projected, and to its left, and the displacement in them (2)."""
    s = LAYOUT.symbols
    n, t = s["normal"], s["segment_tangent"]
    along, upward = (each - ca.dot(each, n) * n for each in (t, ca.cross(t, s["segment_director"])))
    along = ca.if_else(ca.norm_2(along) < ALONG_NORMAL, upward, along)
    along /= ca.norm_2(along)
    left = ca.cross(n, along)
    slide = [ca.dot(each, s["x"] - s["anchor"]) for each in (along, left)]
    return LAYOUT.function("point_tangents", {"tangent": [along, left], "slide_n": slide})


SWUNG = 0.01
"""Square of the change of y, as a fraction of itself, after which the Jacobian of a contact that slides is useless."""

HELD = 0.25
"""Square of the share of the yield limit below which the force of what slides is foreseen where it sticks."""

TURNED = 1e-7
"""Fraction of the yield limit up to which it does not count on which side of 0 the force of a stuck contact is."""


def yielding() -> ca.Function:
    """Return what a contact does at X + `first`, to first order, in metres.

    y = s - s* (2); by how much it is beyond the yield limit, for the largest coefficient; the penetration -g - d*
    (negative where nothing touches); f' (2) of (C5) and the normal load; the square of the fraction of itself, or of
    the yield limit, by which y changes; the regime that follows where the law denies one by more than `error`; and
    whether a Jacobian of before is out of date: with another regime, or where y changes by much.
    """
    s, c = LAYOUT.symbols, _contact()
    now = c.slide - c.law.centre
    dy = ca.vertcat(*[ca.dot(t, s["first"]) for t in _tangents()])
    y, opens = now + dy, s["regime"] == OPEN
    bound = ca.logic_or(s["regime"] >= STICKING, opens)
    _, pull, swing = contact.pulled(now, dy, s["pull"], _sided(c.mu), c.law, bound)
    pull, share = contact.bounded(pull, _sided(c.mu), c.law.cap)
    rho = ca.sqrt(contact.gauge_squared(y, c.mu))
    largest = ca.fmax(ca.mmax(s["mu"]), 1e-30)  # without friction nothing yields
    excess = (rho - c.law.cap * c.law.r * (1.0 + contact.YIELD_TOLERANCE)) / largest
    touching = c.touching - ca.dot(s["normal"], s["first"])
    backs = ca.dot(contact.directional(now, c.mu) ** 2 * now, y) <= 0.0
    regime = _next(y, excess, touching, share, backs)
    swings = ca.logic_and(s["regime"] == SLIDING, swing > SWUNG)
    rows = {
        "y": y,
        "excess": excess,
        "touching": touching,
        "pull": pull,
        "foreseen": c.stiff * _pressed(touching),
        "swing": swing,
        "regime": regime,
        "stale": ca.logic_or(regime != s["regime"], swings),
    }
    return LAYOUT.function("point_yielding", rows)


def _pressed(touching: ca.SX) -> ca.SX:
    """Return the penetration that carries load: less than none in a regime of contact, which may be wrong."""
    regime = LAYOUT.symbols["regime"]
    return ca.if_else(regime >= SLIDING, touching, ca.if_else(regime == OPEN, 0.0, ca.fmax(0.0, touching)))


def _next(y: ca.SX, excess: ca.SX, touching: ca.SX, share: ca.SX, backs: ca.SX) -> ca.SX:
    """Return the regime that follows where the law denies one by more than the error."""
    s, c = LAYOUT.symbols, _contact()
    error, regime = s["error"], s["regime"]
    sticking = ca.if_else(y[0] >= 0.0, STICKING, STICKING_BACK)
    side = ca.if_else(regime == STICKING_BACK, y[0], -y[0])  # how far it is on the other side
    counts = ca.fabs(contact.directional(y, c.mu)[0] * y[0]) > TURNED * c.law.cap * c.law.r
    turned = ca.logic_and(ca.logic_and(side > error, counts), c.mu.forward != c.mu.backward)
    far = contact.gauge_squared(y, c.mu) > s["breaks"] * (c.law.cap * c.law.r) ** 2
    of_stuck = ca.if_else(turned, sticking, ca.if_else(ca.logic_or(far, excess > error), SLIDING, regime))
    rests = ca.logic_or(excess < -error, share < HELD)
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
    rho, limit = ca.sqrt(contact.gauge_squared(y, c.mu)), c.law.cap * c.law.r
    against = c.law.cap * contact.directional(y, c.mu) ** 2 * y / ca.fmax(rho, limit)
    trend, share = contact.bounded(2.0 * s["pull"] - s["pull_m"], c.mu, c.law.cap)
    known, stuck = s["load_m"] > 0.0, s["regime"] >= STICKING
    lands = ca.logic_and(s["regime"] == OPEN, c.touching - ca.dot(s["normal"], s["first"]) > 0.0)
    lands = ca.logic_and(lands, s["stiffness"] > 0.0)
    lifts = ca.logic_and(known, 2.0 * s["load_n"] < s["load_m"])
    breaks = ca.logic_and(stuck, ca.logic_and(known, share > 1.0))
    turns = ca.logic_and(s["regime"] == SLIDING, ca.logic_and(rho > limit, ca.dot(y, s["pull"]) < 0.0))
    regime = ca.if_else(ca.logic_or(breaks, lands), SLIDING, s["regime"])
    regime = ca.if_else(ca.logic_and(s["regime"] >= SLIDING, lifts), OPEN, regime)
    pull = ca.if_else(breaks, trend, ca.if_else(ca.logic_or(turns, lands), against, s["pull"]))
    load = ca.if_else(lands, c.stiff * s["error"], s["load_n"])
    return LAYOUT.function("point_expected", {"pull": pull, "foreseen": load, "regime": regime})


def slip() -> ca.Function:
    """Return the slip of the anchor (2) at X."""
    return LAYOUT.function("point_slip", {"slip": _slip()})


@cache
def _slip() -> ca.SX:
    """Motion of the anchor (C4), shape (2,): zero where nothing touches, all of s where the place has no grip."""
    s, c = LAYOUT.symbols, _contact()
    y = c.slide - c.law.centre
    slip = y - contact.left_after_return(y, c.mu, c.law, s["yield_gauge"])
    return ca.if_else(c.load > 0.0, ca.if_else(s["hold"] > 0.0, slip, c.slide), ca.SX.zeros(2))


LEDGER_TERMS = (
    "load_change",
    "penetration",
    "anchor",
    "friction_loss",
    "viscous_loss",
    "numerical_loss",
    "work_friction_p13",
)


def after() -> ca.Function:
    """Return slip (2), the anchor's stored energy and the point's terms of the ledger, as in `LEDGER_TERMS`."""
    slip = _slip()
    stored, friction = _friction_ledger(slip)
    terms = friction + _normal_ledger()
    return LAYOUT.function("point_after", {"slip": slip, "stored": stored, "terms": terms})


def _normal_ledger() -> ca.SX:
    """Penetration, viscous and numerical loss of the normal contact, for the whole list of terms."""
    s, c = LAYOUT.symbols, _contact()
    depth = ca.fmax(0.0, -s["distance"])
    closing = s["distance"] - s["distance_n"]
    rise = s["stiffness"] / 2.0 * (depth**2 - s["depth_n"] ** 2)
    spring = s["stiffness"] * depth
    viscous = -(c.load - spring) * closing
    numerical = -rise - spring * closing - c.load * (ca.dot(s["normal"], s["first"]) - closing)
    return ca.vertcat(0.0, rise, 0.0, 0.0, viscous, numerical, 0.0)


def _friction_ledger(slip: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the anchor's energy at the end of the step, and friction's terms."""
    s, c = LAYOUT.symbols, _contact()
    touching = c.load > 0.0
    load, s_n = s["hold"] * c.load, s["slide_n"]
    moved, first = (ca.vertcat(*[ca.dot(t, s[name]) for t in _tangents()]) for name in ("motion", "first"))
    left = s_n + ca.if_else(touching, moved - slip, ca.SX.zeros(2))
    y = ca.SX.sym("y", 2)

    def of(expression: ca.SX, at: ca.SX) -> ca.SX:
        return ca.substitute(expression, y, at)

    energy = contact.anchor_energy(y, c.mu, s["yield_gauge"])
    stored, stored_n = load * of(energy, left), load * of(energy, s_n)
    spring = load * of(ca.gradient(energy, y), left)
    slope = ca.gradient(contact.friction_potential(y, c.mu, c.law), y)
    force = load * of(slope, left - c.law.centre)
    loss = load * s["cap"] * ca.sqrt(contact.gauge_squared(slip, c.mu))
    load_change = stored_n - s["stored_n"]
    stretch = left - s_n
    numerical = ca.dot(spring, stretch) - (stored - stored_n) + ca.dot(force, first - moved)
    numerical += ca.dot(force, slip) - loss
    viscous = ca.dot(force - spring, stretch)
    terms = ca.vertcat(
        load_change, 0.0, stored - stored_n + load_change, loss, viscous, numerical, -ca.dot(force, moved)
    )
    return stored, terms
