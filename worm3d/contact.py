"""Contact and friction of one point with a world, symbolic, each formula once.

A world gives the signed distance g(X) of a point (negative inside), its gradient n and its curvature H.

Normal load (C1): a stiff quadratic penalty with a damper that never pulls; d = max(0, -g), d_n that at t_n:

    N = (k + c/dt) max(0, -g - d*),   d* = (c/dt) d_n/(k + c/dt)

Gauge (C2): y = (y_x, y_l) is a displacement along the segment and to its left, in the tangent plane at the start of
the step; mu_x = mu_forward for y_x > 0 (towards the head), else mu_backward:

    rho(y) = sqrt((mu_x y_x)^2 + (mu_l y_l)^2)

Friction (C3), set-valued with anchors: s is the displacement from the anchor and y = s - s*; the potential is N h(y):

    h = rho^2/(2 r)  while rho <= cap r,   else cap (rho - cap r/2)
    1/r = 1/rho_b + D/dt,   s* = (D/dt) r s_n

rho_b, the breakaway displacement times mu, is one number, so that all contacts yield together whatever their load; D
puts a damper beside the anchor's spring, both capped together. cap is 1, and static_ratio while a contact is stuck.

Return (C4): after the step the anchor moves until the force is back on the yield surface: what is left of s is
s* + y min(1, cap r/rho(y)), and the anchor moves by the rest. Where mu = 0 it follows freely.

Newton (C5): f = grad h obeys m f = cap M^2 y with M = diag(mu_x, mu_l), m = max(cap r, rho). Where little slides, the
direction of y turns about within a step, and grad h, made linear, says little of what comes. Newton therefore takes f
for an unknown of its own that obeys the equation made linear; it leads to the same root and is as fast near to it:

    K = (cap M^2 - f z^T)/m,   f' = (cap M^2 (y + dy) - f (z.dy))/m,   z = M^2 y/rho  (0 where rho <= cap r)

f' is scaled back on to the yield surface (Chan, Golub, Mulet 1999, SIAM J. Sci. Comput. 20, 1964; Hintermueller,
Stadler 2006, SIAM J. Sci. Comput. 28, 1: the same functional, the total variation of a picture).
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

YIELD_TOLERANCE = 1e-9
"""Relative excess over the yield surface below which an anchor stays, lest rounding makes it creep."""

FREE_MOTION = 1e-3
"""In a direction without friction an anchor follows beyond this fraction of rho_b [m]."""


class Coefficients(NamedTuple):
    """Kinetic coefficients of one contact against motion towards the head, towards the tail and sideways."""

    forward: ca.SX
    backward: ca.SX
    lateral: ca.SX


class Law(NamedTuple):
    """What (C3) needs in a step: r, cap, and the displacement s* of the potential's centre, shape (2,)."""

    r: ca.SX
    cap: ca.SX
    centre: ca.SX


def pressing(distance: ca.SX, centre: ca.SX) -> ca.SX:
    """Return -g - d* of (C1) [m]; its positive part times k + c/dt is the normal load."""
    return -distance - centre


def directional(y: ca.SX, mu: Coefficients) -> ca.SX:
    """Return (mu_x, mu_l) of (C2) for a displacement, shape (2,)."""
    return ca.vertcat(ca.if_else(y[0] > 0.0, mu.forward, mu.backward), mu.lateral)


def gauge_squared(y: ca.SX, mu: Coefficients) -> ca.SX:
    """Return rho(y)^2 of (C2) [m^2]; unlike rho it is smooth at 0."""
    return ca.sumsqr(directional(y, mu) * y)


def friction_potential(y: ca.SX, mu: Coefficients, law: Law, sticks: ca.SX | float = 0.0) -> ca.SX:
    """Return h(y) of (C3): the potential per unit of normal load [m]; without a limit where `sticks` is not zero."""
    square = gauge_squared(y, mu)
    rho, limit = ca.sqrt(square), law.cap * law.r
    elastic = ca.logic_or(square <= limit**2, sticks)
    return ca.if_else(elastic, square / (2.0 * law.r), law.cap * (rho - 0.5 * limit))


def pulled(y: ca.SX, dy: ca.SX, force: ca.SX, mu: Coefficients, law: Law, sticks: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return K (2, 2) and f' (2) of (C5) for f and a step dy, and the square of the part of m by which y changes.

    f' is not scaled back yet.
    """
    of = directional(y, mu)
    rho, limit = ca.sqrt(gauge_squared(y, mu)), law.cap * law.r
    slides = ca.logic_and(rho > limit, ca.logic_not(sticks))
    per_m = 1.0 / ca.if_else(slides, rho, limit)
    z = ca.if_else(slides, of**2 * y * per_m, 0.0)
    K = (law.cap * ca.diag(of**2) - force @ z.T) * per_m
    beyond = (law.cap * of**2 * (y + dy) - force * ca.dot(z, dy)) * per_m
    return K, beyond, ca.sumsqr(of * dy) * per_m**2


def bounded(force: ca.SX, mu: Coefficients, cap: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return a force per unit of load scaled back on to the yield surface, and the square of its share of that."""
    square = directional(force, mu) ** 2
    of = ca.if_else(square > 0.0, force**2 / ca.if_else(square > 0.0, square, 1.0), 0.0)
    share = ca.sum1(of) / cap**2
    return force / ca.sqrt(ca.fmax(share, 1.0)), share


def left_after_return(y: ca.SX, mu: Coefficients, law: Law, yield_gauge: ca.SX) -> ca.SX:
    """Return what (C4) leaves of y, shape (2,) [m]; `yield_gauge` is rho_b."""
    rho, limit = ca.sqrt(gauge_squared(y, mu)), law.cap * law.r
    yields = rho > limit * (1.0 + YIELD_TOLERANCE)
    kept = ca.if_else(yields, limit / rho, 1.0) * y
    free = ca.logic_and(directional(y, mu) == 0.0, ca.fabs(y) > FREE_MOTION * yield_gauge)
    return ca.if_else(free, 0.0, kept)


def beyond(y: ca.SX, mu: Coefficients, law: Law) -> ca.SX:
    """Return the gauge of what (C4) takes away from y [m]."""
    rho, limit = ca.sqrt(gauge_squared(y, mu)), law.cap * law.r
    return ca.if_else(rho > limit * (1.0 + YIELD_TOLERANCE), rho - limit, 0.0)


def anchor_energy(s: ca.SX, mu: Coefficients, yield_gauge: ca.SX) -> ca.SX:
    """Return the energy of the anchor's spring per unit of normal load [m]."""
    return gauge_squared(s, mu) / (2.0 * yield_gauge)
