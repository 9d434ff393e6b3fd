"""Formulas of a learned segment law, in CasADi symbols.

A segment consists of two equal chambers. With the length l_c of a chamber, its contraction a and the rest length l0,
the energy U of the chamber and the outer radius R are

    s = 1 - l_c/(l0 (1 - a)),   x = (l_c/l0 - x_mid)/x_half,   y = (a - y_mid)/y_half                  (L1)
    U = s^2 (k l0/4 + E N_U(x, y))                                                                     (L2)
    R = R_mid + R_scale N_R(x, y)                                                                      (L3)

U and its derivative with respect to l_c are 0 at the free length l0 (1 - a), whatever the weights are. N_U and N_R are
feed-forward networks with the activation v/sqrt(1 + v^2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca

Symbol = Any
"""A casadi.SX expression."""

ENERGY_SIZES = (2, 6, 6, 1)
"""Numbers of units in the layers of N_U, from the input to the output."""
RADIUS_SIZES = (2, 6, 1)
"""Numbers of units in the layers of N_R."""


@dataclass(frozen=True)
class Scales:
    """Numbers of a law other than the weights of the networks, (L1) to (L3)."""

    rest_length: float
    """Rest length l0 [m]."""
    stiffness: float
    """Stiffness k of both chambers together [N]."""
    x_mid: float
    x_half: float
    y_mid: float
    y_half: float
    energy: float
    """Scale E of the learned energy of a chamber [J]."""
    radius_mid: float
    """Radius R_mid [m]."""
    radius: float
    """Scale R_scale of the radius [m]."""


def weight_count(sizes: Sequence[int]) -> int:
    """Return the number of weights of a network with the given numbers of units."""
    return sum((fan_in + 1) * fan_out for fan_in, fan_out in pairwise(sizes))


def network(sizes: Sequence[int], weights: Symbol, inputs: Symbol) -> Symbol:
    """Return the output of a network. The weights are W1 row by row, b1, W2 row by row, b2, and so on."""
    values, used = inputs, 0
    for layer, (fan_in, fan_out) in enumerate(pairwise(sizes)):
        matrix = ca.reshape(weights[used : used + fan_in * fan_out], fan_in, fan_out).T
        used += fan_in * fan_out
        values = matrix @ values + weights[used : used + fan_out]
        used += fan_out
        if layer < len(sizes) - 2:
            values = values / ca.sqrt(1.0 + values**2)
    return values


def inputs(scales: Scales, length: Symbol, contraction: Symbol) -> Symbol:
    """Return x and y of (L1), shape (2,)."""
    x = (length / scales.rest_length - scales.x_mid) / scales.x_half
    return ca.vertcat(x, (contraction - scales.y_mid) / scales.y_half)


def energy(scales: Scales, weights: Symbol, length: Symbol, contraction: Symbol) -> Symbol:
    """Return the energy U of a chamber, (L2) [J]."""
    s = 1.0 - length / (scales.rest_length * (1.0 - contraction))
    learned = network(ENERGY_SIZES, weights, inputs(scales, length, contraction))
    return s**2 * (scales.stiffness * scales.rest_length / 4.0 + scales.energy * learned)


def radius(scales: Scales, weights: Symbol, length: Symbol, contraction: Symbol) -> Symbol:
    """Return the outer radius R, (L3) [m]."""
    learned = network(RADIUS_SIZES, weights, inputs(scales, length, contraction))
    return scales.radius_mid + scales.radius * learned
