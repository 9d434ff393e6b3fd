"""Contributions of a spring and a damper on a strain s to the energy ledger of a step, symbolic.

In the residual of a step times dq, each strain contributes force times (ds/dq) dq, the first-order change of s, which
is called `first` here.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca


def slope(energy: Callable[[ca.SX], ca.SX], at: ca.SX) -> ca.SX:
    """Return dE/ds at a strain."""
    s = ca.SX.sym("s")
    return ca.substitute(ca.gradient(energy(s), s), s, at)


def spring(energy: Callable[[ca.SX], ca.SX], s: ca.SX, s_n: ca.SX, first: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the change of energy from s_n to s, and the numerical loss dE/ds `first` - change [J]."""
    change = energy(s) - energy(s_n)
    return change, slope(energy, s) * first - change


def trapezoid(before: ca.SX, after: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the work of a changing command, and the numerical loss of applying the change before the motion [J].

    Parameters
    ----------
    before, after : SX
        Change of energy by the command, at the strain before and after the step.
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
        s - s_hat and beta dt; the quotient is the integrator's rate.
    dt : SX
        Time step [s].
    first : SX
        First-order change of the strain.
    """
    rate = moved / span
    return c * rate**2 * dt, c * rate * (first - rate * dt)
