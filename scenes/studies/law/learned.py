"""Formulas of a learned segment law with the scales as numbers, from `worm3d.physics.segment_laws.learned`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from worm3d.physics.segment_laws.learned import Learned

Symbol = Any
"""A casadi.SX expression."""


@dataclass(frozen=True)
class Scales:
    """Numbers of a law other than the weights of the networks, (SL5) and (SL6)."""

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


def energy(scales: Scales, weights: Symbol, length: Symbol, contraction: Symbol) -> Symbol:
    """Return the energy U of a chamber, (SL5) [J]."""
    (spring,) = Learned.springs({**_inputs(scales), "energy": weights})
    return spring.energy(length, scales.rest_length * (1.0 - contraction))


def radius(scales: Scales, weights: Symbol, length: Symbol, contraction: Symbol) -> Symbol:
    """Return the outer radius R, (SL6) [m]."""
    commanded = scales.rest_length * (1.0 - contraction)
    return Learned.outline({**_inputs(scales), "radius": weights}, length, commanded)[1]


def _inputs(scales: Scales) -> dict[str, Any]:
    """Return the inputs of the law's methods other than weights, by name."""
    numbers = (scales.x_mid, scales.x_half, scales.y_mid, scales.y_half)
    columns = ca.DM([*numbers, scales.energy, scales.radius_mid, scales.radius])
    return {"k": scales.stiffness, "l0": scales.rest_length, "offset": 0.0, "tau": 0.0, "scales": columns}
