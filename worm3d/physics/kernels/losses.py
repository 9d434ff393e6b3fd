"""Terms of the energy ledger of a step for a spring and a damper that act on a strain s, in CasADi symbols.

The ledger multiplies the residual of a step by dq, the change of the coordinates. Each strain contributes its force
times (ds/dq) dq. This first-order change of s is the argument `first` of the functions below.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca


def slope(energy: Callable[[ca.SX], ca.SX], at: ca.SX) -> ca.SX:
    """Return dE/ds at a strain."""
    s = ca.SX.sym("s")
    return ca.substitute(ca.gradient(energy(s), s), s, at)


def spring(energy: Callable[[ca.SX], ca.SX], s: ca.SX, s_n: ca.SX, first: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the change of energy from s_n to s, and the numerical loss (dE/ds) `first` - change [J]."""
    change = energy(s) - energy(s_n)
    return change, slope(energy, s) * first - change


def trapezoid(before: ca.SX, after: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the work of a changing command, and the numerical loss if the command changes before the motion [J].

    Parameters
    ----------
    before, after : SX
        Change of energy due to the command, at the strain before and after the step.
    """
    work = (before + after) / 2.0
    return work, work - before


def damper(c: ca.SX, moved: ca.SX, span: ca.SX, dt: ca.SX, first: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the viscous loss c rate^2 dt and the numerical loss of a damper [J].

    Parameters
    ----------
    c : SX
        Damping: force over rate of strain.
    moved, span : SX
        s - s_hat and beta dt. The quotient is the rate of strain according to the integrator.
    dt : SX
        Time step [s].
    first : SX
        First-order change of the strain.
    """
    rate = moved / span
    return c * rate**2 * dt, c * rate * (first - rate * dt)
