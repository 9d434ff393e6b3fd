"""Contact and friction of one point with a world, symbolic, each formula once.

A world gives the signed distance g(X) of a point (negative inside), its gradient n and its curvature.

Normal load (C1). The contact is a stiff linear spring (a quadratic penalty) with a damper, and never pulls. With the
penetration d = max(0, -g), d_n = d(t_n), stiffness k and damping c,

    N = (k + c/dt) max(0, -g - d*),   d* = (c/dt) d_n/(k + c/dt)

Gauges (C2) are norms that weight each direction with its coefficient. y = (y_x, y_l) is a displacement along the
segment and to its left, in the tangent plane at the start of the step. mu_x is mu_forward for y_x > 0 (towards the
head), otherwise mu_backward.

    rho(y) = sqrt((mu_x y_x)^2 + (mu_l y_l)^2),   eta(y) = sqrt((e_x y_x)^2 + (e_l y_l)^2),   e = H mu >= mu

The hardness H is 1, except where mu is so small that a contact would have to move far before yielding.

Friction (C3) is set-valued, with anchors: a contact is tied by a spring to an anchor, which moves only when the contact
slides. s is the displacement from the anchor, and y = s - s*. The force per unit of capacity is f; in Coulomb's law,
the capacity is the normal load.

    f_i = mu_i e_i y_i/P_i,   P_i = r + H_i lambda,   lambda = rho max(0, 1/c_0 - r/eta)
    1/r = 1/rho_b + D/dt,   s* = (D/dt) r s_n

f is linear in y while eta <= c_0 r. Far beyond, f = c_0 M^2 y/rho with M = diag(mu_x, mu_l), which is Coulomb's law
with maximum dissipation on an ellipse. f never leaves this ellipse, because f_i/(c_0 mu_i) is a harmonic mean of the
components e_i y_i/eta and mu_i y_i/rho of two unit vectors. Where H = 1, f is the gradient of Huber's potential

    h = c_0^2 lambda + r/2 sum_i (mu_i y_i/P_i)^2

Where H is not 1, f is not the gradient of a potential; the fallback (`worm3d.solver.descent`) therefore uses H = 1
everywhere. The limit mu_x -> 0 is regular: the force along x vanishes, the anchor follows the contact along x, and
lateral friction still holds.

rho_b is the breakaway displacement times e. It is a single number, so that all contacts yield together at any load. D
is the constant of a damper parallel to the anchor's spring. c_0 (`Step.limit_ratio`) bounds the total force of spring
and damper per unit of capacity. It is static_ratio while a contact is stuck, and otherwise 1.

Return (C4): after the step the anchor moves until y is back on the surface eta = c_0 r. s becomes s* + y
min(1, c_0 r/eta), and the anchor moves by the change of s.

Newton (C5): f obeys P f = M E y with E = diag(e_x, e_l). In a contact that slides little, the direction of y changes
much within a step, and a linearised f is a poor prediction. Newton's method therefore treats f as a separate unknown
that obeys the linearised equation. The root is the same, and the convergence near the root is equally fast. With the
stiffness K and the prediction f' for a change dy,

    K = (M E - H f z^T)/P,   f' = (M E (y + dy) - H f (z.dy))/P,   z = grad lambda

f' is then scaled back to the yield surface. (Chan, Golub, Mulet 1999, SIAM J. Sci. Comput. 20, 1964; Hintermueller,
Stadler 2006, SIAM J. Sci. Comput. 28, 1, use this method for the same functional, the total variation of an image.)

Breakaway (C6): the step is solved with c_0 = static_ratio for all contacts that stuck at the start of the step. Of
these, all contacts that yield in the solution, or almost yield,

    eta > c_0 r (1 - 1e-9),

break away together: their c_0 becomes 1, and the step is solved again from the start. This is repeated until no further
contact yields. A contact that breaks away keeps the kinetic limit until the step ends, even if Newton's method assigns
it a sticking regime again; therefore the repetition ends. The static limit holds again in the next step if the anchor
did not slip. The tolerance 1e-9 exceeds rounding, so that contacts with equal forces behave alike. Neither the order of
the contacts nor the sequence of iterates affects the solution.

Other laws (`worm3d.physics.friction_laws`) have a capacity C(N) in place of N (C7). Where a contact slides, these laws
add rho (1/c - 1/c_0) to lambda of Coulomb's law, and the strength c = c_0 + Psi'(c_0 lambda/dt) replaces c_0 (C8).
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from worm3d.physics.friction_laws import FrictionLaw
from worm3d.physics.part import Symbols

YIELD_TOLERANCE = 1e-9
"""Relative tolerance of the yield surface. An anchor stays if the relative excess over this surface is smaller, since
rounding would otherwise make anchors creep. A contact breaks away from this relative distance below the static limit,
(C6)."""


class Directions(NamedTuple):
    """Values of a contact for motion towards the head, towards the tail and sideways."""

    forward: ca.SX
    backward: ca.SX
    lateral: ca.SX

    def of(self, y: ca.SX) -> ca.SX:
        """Return the values along the segment and sideways for a displacement y of shape (2,)."""
        return ca.vertcat(ca.if_else(y[0] > 0.0, self.forward, self.backward), self.lateral)


class Coefficients(NamedTuple):
    """Kinetic coefficients of one contact, above 0, and the hardness H of (C2)."""

    mu: Directions
    hardness: Directions


class Step(NamedTuple):
    """Constants of (C3) in a step, the law of friction, and the parameters of the law."""

    r: ca.SX
    """Compliance r of the anchor's spring and damper: gauge of y per unit of f [m]."""
    limit_ratio: ca.SX
    """Limit c_0 of f: static_ratio while the contact is stuck, otherwise 1."""
    centre: ca.SX
    """s*, shape (2,) [m]."""
    dt: ca.SX
    """Time step [s]."""
    law: type[FrictionLaw]
    parameters: Symbols

    def capacity(self, load: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return C(N) of (C7) [N] and its slope."""
        N = ca.SX.sym("N")
        of = self.law.capacity(N, self.parameters)
        return ca.substitute(of, N, load), ca.substitute(ca.gradient(of, N), N, load)

    def strength(self, slip: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return c of (C8) for a slip with the gauge `slip` [m], its slope [1/m], and dt Psi, the excess loss [m]."""
        w = ca.SX.sym("w")
        excess = self.law.excess(w, self.parameters)
        hardening, slope = ca.gradient(excess, w), ca.gradient(ca.gradient(excess, w), w)
        rate = slip / self.dt
        beyond, slope, excess = (ca.substitute(each, w, rate) for each in (hardening, slope, excess))
        return self.limit_ratio + beyond, slope / self.dt, excess * self.dt


class Friction(NamedTuple):
    """Terms of (C3) at a displacement y; vectors have the shape (2,)."""

    mu: ca.SX
    e: ca.SX
    hardness: ca.SX
    per_P: ca.SX
    multiplier: ca.SX
    """lambda of (C3) [m]."""
    slope: ca.SX
    """Gradient of lambda."""
    f: ca.SX
    """f, friction per unit of capacity."""
    strength: ca.SX
    """c of (C8)."""
    potential: ca.SX
    """h per unit of capacity [m]; valid where the hardness is 1."""


def squares(y: ca.SX, of: Coefficients) -> tuple[ca.SX, ca.SX]:
    """Return rho^2 and eta^2 of (C2) [m^2]. The squares are smooth at 0, unlike rho and eta."""
    mu_y = of.mu.of(y) * y
    return ca.sumsqr(mu_y), ca.sumsqr(of.hardness.of(y) * mu_y)


def friction(y: ca.SX, of: Coefficients, step: Step, sticks: ca.SX | float = 0.0) -> Friction:
    """Return the friction at y, (C3) and (C8). If `sticks` is not 0, the contact sticks at any displacement."""
    mu, hardness = of.mu.of(y), of.hardness.of(y)
    rho, eta = (ca.sqrt(square) for square in squares(y, of))
    slides = ca.logic_and(eta > step.limit_ratio * step.r, ca.logic_not(sticks))
    per_eta = 1.0 / ca.if_else(slides, eta, 1.0)
    beyond = 1.0 / step.limit_ratio - step.r * per_eta
    coulomb = ca.if_else(slides, rho * beyond, 0.0)  # lambda of Coulomb's law: rho(slip) = c_0 lambda
    strength, hardening, excess = step.strength(step.limit_ratio * coulomb)
    gain = 1.0 / strength - 1.0 / step.limit_ratio
    multiplier = coulomb + ca.if_else(slides, rho * gain, 0.0)
    per_P, e = 1.0 / (step.r + hardness * multiplier), hardness * mu
    slope = mu**2 * y * beyond / rho + e**2 * y * (step.r * rho * per_eta**3)
    slope = slope * (1.0 - rho * step.limit_ratio * hardening / strength**2) + mu**2 * y * gain / rho
    slope = ca.if_else(slides, slope, 0.0)
    f = mu * e * y * per_P
    elastic = 0.5 * step.r * ca.dot(f, y * per_P) * (step.limit_ratio / strength) ** 2
    potential = step.limit_ratio**2 * coulomb + elastic + excess
    return Friction(mu, e, hardness, per_P, multiplier, slope, f, strength, potential)


def stiffness(at: Friction, force: ca.SX) -> ca.SX:
    """Return K of (C5), shape (2, 2), for f = `force`."""
    return ca.diag(at.mu * at.e * at.per_P) - (at.hardness * at.per_P * force) @ at.slope.T


def predicted_friction(y: ca.SX, dy: ca.SX, force: ca.SX, at: Friction) -> tuple[ca.SX, ca.SX]:
    """Return f' of (C5), shape (2,), for f = `force` and a step dy, and the square of the change of y relative to P.

    f' is not yet scaled back to the yield surface.
    """
    ahead = at.mu * at.e * (y + dy) - at.hardness * force * ca.dot(at.slope, dy)
    return ahead * at.per_P, ca.sumsqr(at.e * dy * at.per_P) / at.strength**2


def utilisation_squared(force: ca.SX, of: Coefficients, strength: ca.SX) -> ca.SX:
    """Return the square of the ratio of a force to the limit in its direction, both per unit of capacity."""
    return ca.sumsqr(force / of.mu.of(force)) / strength**2


def _returned_share(y: ca.SX, of: Coefficients, step: Step) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return whether y yields, eta^2 of (C2), and the share of y that remains if y yields, (C4)."""
    _, square = squares(y, of)
    limit = step.limit_ratio * step.r
    return square > (limit * (1.0 + YIELD_TOLERANCE)) ** 2, square, limit / ca.sqrt(square)


def left_after_return(y: ca.SX, of: Coefficients, step: Step) -> ca.SX:
    """Return y after the return (C4), shape (2,) [m]."""
    yields, _, share = _returned_share(y, of, step)
    return ca.if_else(yields, share, 1.0) * y


def return_stiffness(y: ca.SX, of: Coefficients, step: Step) -> ca.SX:
    """Return the derivative of `left_after_return` with respect to y, shape (2, 2)."""
    yields, square, share = _returned_share(y, of, step)
    e = of.mu.of(y) * of.hardness.of(y)
    return ca.if_else(yields, share * (ca.SX.eye(2) - y @ (e**2 * y).T / square), ca.SX.eye(2))


def static_excess(y: ca.SX, of: Coefficients, step: Step) -> ca.SX:
    """Return by how much eta(y) exceeds the limit at which a stuck contact breaks away, (C6) [m]."""
    return ca.sqrt(squares(y, of)[1]) - step.limit_ratio * step.r * (1.0 - YIELD_TOLERANCE)


def anchor_energy(s: ca.SX, of: Coefficients, yield_gauge: ca.SX) -> ca.SX:
    """Return the energy of the anchor's spring per unit of normal load [m]; `yield_gauge` is rho_b."""
    return ca.dot(of.hardness.of(s), (of.mu.of(s) * s) ** 2) / (2.0 * yield_gauge)
