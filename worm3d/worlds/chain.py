"""Nearest point of a chain of straight pieces and circular arcs, symbolic, each formula once.

Piece k has the frame p, t, n at its beginning (a point, the tangent and the normal towards the centre, if it bends)
and the curvature kappa; X, Y, Z are the coordinates of a point x in it (Z along t x n, 0 in a plane). With

    w = sqrt((kappa X)^2 + (1 - kappa Y)^2)                                                                   (W1)

the line's nearest point, as far as the circle goes on, lies at

    s = atan2(kappa X, 1 - kappa Y)/kappa   along it (X where kappa = 0),                                      (W2)
    delta = (kappa (X^2 + Y^2) - 2 Y)/(1 + w),   d^2 = delta^2 + Z^2                                           (W3)

where delta is how much farther than the piece x lies from the centre, and -Y where kappa = 0: nothing cancels and no
case is told apart. Tangent and outward normal there, in the frame:

    T = ((1 - kappa Y) t + kappa X n)/w,   O = (kappa X t - (1 - kappa Y) n)/w                                (W4)

A chain without kinks and without ends has its nearest point where x lies in the normal plane, so only pieces between
whose end planes x lies come into question: X_k >= 0 and X_{k+1} < 0. Among them the smallest d counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

FAR = 1e30
"""Square of the distance of a piece that does not come into question [m^2]."""


class Local(NamedTuple):
    """Coordinates of a point in the frame of a piece, and the piece's curvature."""

    X: ca.SX
    Y: ca.SX
    Z: ca.SX
    kappa: ca.SX


def stretch(c: Local) -> ca.SX:
    """Return w of (W1): the distance from the bend's axis as a multiple of the bend's radius."""
    return ca.sqrt((c.kappa * c.X) ** 2 + (1.0 - c.kappa * c.Y) ** 2)


def excess(c: Local) -> ca.SX:
    """Return delta of (W3) [m]."""
    return (c.kappa * (c.X**2 + c.Y**2) - 2.0 * c.Y) / (1.0 + stretch(c))


def way(c: Local) -> ca.SX:
    """Return s of (W2) [m]."""
    bent = c.kappa != 0.0
    angle = ca.atan2(c.kappa * c.X, 1.0 - c.kappa * c.Y)
    return ca.if_else(bent, angle / ca.if_else(bent, c.kappa, 1.0), c.X)


def tangent_and_outward(c: Local, t: ca.SX, n: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return T and O of (W4)."""
    w = stretch(c)
    ahead, aside = (1.0 - c.kappa * c.Y) / w, c.kappa * c.X / w
    return ahead * t + aside * n, aside * t - ahead * n


def nearest(locals_: Sequence[Local], pieces: Sequence[ca.SX]) -> ca.SX:
    """Return the row of `pieces` (parameters, all of one length) on which the nearest point lies."""
    best, chosen = ca.SX(FAR), pieces[0]
    for k, c in enumerate(locals_):
        square = excess(c) ** 2 + c.Z**2
        if k > 0:
            square = ca.if_else(c.X >= 0.0, square, FAR)
        if k + 1 < len(locals_):
            square = ca.if_else(locals_[k + 1].X < 0.0, square, FAR)
        if k > 0:
            closer = square < best
            chosen = ca.if_else(closer, pieces[k], chosen)
            best = ca.if_else(closer, square, best)
        else:
            best = square
    return chosen
