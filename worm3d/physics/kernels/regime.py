"""Kernels that guess the present or next regime of a contact, together with its friction and load.

The guesses are heuristics. They affect the start and the number of iterations of Newton's method, but not the solution,
which depends only on the law in `worm3d.physics.contact`.
"""

from __future__ import annotations

import casadi as ca

from worm3d.physics import contact
from worm3d.physics.friction_laws import Coulomb
from worm3d.physics.kernels.point import (
    FREE,
    OPEN,
    POINT_LAYOUT,
    SLIDING,
    STICKING_BACK,
    STICKING_FORWARD,
    Contact,
    Law,
    contact_of,
    in_tangents,
    penetration,
    sided,
)

MAX_SWING = 3e-5
"""Square of the relative change of y above which the stiffness K of a sliding contact is computed again."""

STICK_SHARE = 0.25
"""Square of the ratio of the predicted force of a sliding contact to the law's force below which it sticks."""

SIDE_TOLERANCE = 1e-7
"""Displacement along the segment below which a stuck contact keeps its sticking regime, as a fraction of the yield
limit (both as gauges)."""


def near(law: Law = Coulomb) -> ca.Function:
    """Return 1 for a contact that is closed or closes to first order. `yielding` would not change other contacts."""
    s, c = POINT_LAYOUT.symbols, contact_of(law)
    touching = c.touching - ca.dot(s["normal"], s["first"])
    lands = ca.logic_and(s["stiffness"] > 0.0, touching > s["error"])
    return POINT_LAYOUT.function("point_near", {"near": ca.logic_or(s["regime"] != OPEN, lands)})


def yielding(law: Law = Coulomb) -> ca.Function:
    """Return the first-order prediction of a contact at X + "first": the rows "y" to "recent", 12 in all.

    y, predicted_friction : s - s* (2) [m], and f' (2) of (C5).
    excess : difference between eta and the yield limit, divided by the largest coefficient [m].
    touching : penetration -g - d*, negative if the point does not touch the world [m].
    foreseen : normal load [N].
    swing : square of the relative change of y.
    regime : next regime. It changes if the present regime contradicts the friction law by more than "error".
    stale : whether the stiffness K of the contact must be computed again.
    static_excess, recent : by how much eta exceeds the static limit, (C6), and the last change of this excess,
        including the error [m].
    """
    s, c = POINT_LAYOUT.symbols, contact_of(law)
    now, dy = c.y, in_tangents(s["first"])
    y, opens = now + dy, s["regime"] == OPEN
    bound = ca.logic_or(s["regime"] >= STICKING_FORWARD, opens)
    at = contact.friction(now, sided(c.of), c.step, bound)
    predicted, swing = contact.predicted_friction(now, dy, s["pull"], at)
    ahead = contact.friction(y, sided(c.of), c.step, bound).strength
    used = contact.utilisation_squared(predicted, sided(c.of), ahead)
    eta = ca.sqrt(contact.squares(y, c.of)[1])
    largest = ca.mmax(s["mu"] * s["hardness"])
    excess = (eta - c.step.limit_ratio * c.step.r * (1.0 + contact.YIELD_TOLERANCE)) / largest
    touching = c.touching - ca.dot(s["normal"], s["first"])
    backs = ca.dot(_elastic(now, c.of) ** 2 * now, y) <= 0.0
    held = STICK_SHARE * ca.if_else(
        at.multiplier > 0.0, contact.utilisation_squared(at.f, sided(c.of), at.strength), 1.0
    )
    recent = ca.norm_2(_elastic(y, c.of) * dy) + largest * s["error"]
    regime = _next(c, y, eta, excess, touching, used < held, backs)
    swings = ca.logic_and(s["regime"] == SLIDING, swing > MAX_SWING)
    rows = {
        "y": y,
        "excess": excess,
        "touching": touching,
        "predicted_friction": predicted / ca.sqrt(ca.fmax(used, 1.0)),
        "foreseen": s["stiff"] * penetration(touching),
        "swing": swing,
        "regime": regime,
        "stale": ca.logic_or(regime != s["regime"], swings),
        "static_excess": contact.static_excess(y, c.of, c.step),
        "recent": recent,
    }
    return POINT_LAYOUT.function("point_yielding", rows)


def _elastic(y: ca.SX, of: contact.Coefficients) -> ca.SX:
    """Return H mu of (C2), shape (2,)."""
    return of.mu.of(y) * of.hardness.of(y)


def _next(c: Contact, y: ca.SX, eta: ca.SX, excess: ca.SX, touching: ca.SX, held: ca.SX, backs: ca.SX) -> ca.SX:
    """Return the next regime. It changes if the present regime contradicts the friction law by more than the error."""
    s = POINT_LAYOUT.symbols
    error, regime = s["error"], s["regime"]
    sticking = ca.if_else(y[0] >= 0.0, STICKING_FORWARD, STICKING_BACK)
    side = ca.if_else(regime == STICKING_BACK, y[0], -y[0])  # distance on the other side
    limit = c.step.limit_ratio * c.step.r
    counts = ca.fabs(_elastic(y, c.of)[0] * y[0]) > SIDE_TOLERANCE * limit
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


def expected(law: Law = Coulomb) -> ca.Function:
    """Return f of (C5), load and regime of a contact that continues as in the last two steps.

    X and "regime" are the values at the start of the step, and "first" is the expected motion. A contact that lands is
    assumed to have the penetration "error".
    """
    s, c = POINT_LAYOUT.symbols, contact_of(law)
    y = c.y + in_tangents(s["first"])
    at = contact.friction(y, c.of, c.step)
    trend = 2.0 * s["pull"] - s["pull_m"]
    used = contact.utilisation_squared(trend, c.of, c.step.limit_ratio)
    known, stuck = s["load_m"] > 0.0, s["regime"] >= STICKING_FORWARD
    lands = ca.logic_and(s["regime"] == OPEN, c.touching - ca.dot(s["normal"], s["first"]) > 0.0)
    lands = ca.logic_and(lands, s["stiffness"] > 0.0)
    lifts = ca.logic_and(known, 2.0 * s["load_n"] < s["load_m"])
    breaks = ca.logic_and(stuck, ca.logic_and(known, used > 1.0))
    turns = ca.logic_and(s["regime"] == SLIDING, ca.logic_and(at.multiplier > 0.0, ca.dot(y, s["pull"]) < 0.0))
    regime = ca.if_else(ca.logic_or(breaks, lands), SLIDING, s["regime"])
    regime = ca.if_else(ca.logic_and(s["regime"] >= SLIDING, lifts), OPEN, regime)
    predicted = ca.if_else(breaks, trend / ca.sqrt(used), ca.if_else(ca.logic_or(turns, lands), at.f, s["pull"]))
    load = ca.if_else(lands, s["stiff"] * s["error"], s["load_n"])
    return POINT_LAYOUT.function(
        "point_expected", {"predicted_friction": predicted, "foreseen": load, "regime": regime}
    )
