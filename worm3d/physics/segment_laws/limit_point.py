"""The limit point of a rhombus: the weight that flattens the chambers of a segment."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from worm3d.physics import elements
from worm3d.physics.body import Body
from worm3d.values.arrays import FloatArray

LIMIT_ANGLES = 65
"""Number of angles in each of the five rounds of the search for the limit point. Each round searches between the
neighbours of the best angle of the round before. The angle is accurate to 1e-7. The weight is accurate to 1e-14 because
the weight has its maximum at this angle."""


def limit_points(worm: Body, contraction: float) -> FloatArray:
    """Return the weight that flattens each segment, shape (N,) [N].

    The joints of a segment are at a height h above its lower apexes, and carry a vertical load w. Such a segment of
    length l is in equilibrium if dE/dl = w dh/dl, where E is the energy of both chambers with the given `contraction`.
    The largest w with a solution of this equation is the limit point. Under a larger load the segment collapses.
    """
    shapes = zip(np.asarray(worm.k_spring), np.asarray(worm.k_apex), worm.link_length, strict=True)
    return np.array([_limit_point(k, k_apex, a, worm.l0, contraction) for k, k_apex, a in shapes])


@cache
def _limit_point(k: float, k_apex: float, a: float, l0: float, contraction: float) -> float:
    commanded = l0 * (1.0 - contraction)
    low, high = float(elements.hinge_angle(ca.SX(a), ca.SX(commanded))), np.pi
    for _ in range(5):
        place = np.linspace(low, high, LIMIT_ANGLES)
        carried = _carried()(place[None], k, k_apex, a, l0, commanded).full()[0]
        best = int(np.argmax(carried))
        low, high = place[max(best - 1, 0)], place[min(best + 1, LIMIT_ANGLES - 1)]
    return float(carried[best])


@cache
def _carried() -> ca.Function:
    """Return a function that returns the weight in equilibrium at given apex angles.

    The arguments of the function are the angles, k, k_apex, link, rest length and commanded length. The angle is used
    instead of the length because the weight is a regular function of the angle up to the flat chamber.
    """
    angle, k, k_apex, a, l0, commanded = given = [ca.SX.sym("x") for _ in range(6)]
    length, height = 2.0 * a * ca.sin(angle / 2.0), a * ca.cos(angle / 2.0)
    turning = elements.hinge_energy(k_apex, angle, elements.hinge_angle(a, l0))
    energy = elements.chamber_energy(k, l0, length, commanded) + turning
    weight = -2.0 * ca.gradient(energy, angle) / ca.gradient(height, angle)
    return ca.Function("weight", given, [weight]).map(LIMIT_ANGLES)
