"""Strain energy densities of rubber and of fibres, as CasADi expressions of the right Cauchy-Green tensor C.

Rubber keeps its volume. The density depends on the isochoric tensor C' = det(C)^(-1/3) C, so that the pressure-like
multiplier q alone carries the change of volume J = sqrt(det C):

    W(C) + q (J - 1) - q^2 / (2 bulk)                                                                  (FM1)

An infinite bulk modulus gives J = 1 exactly. With the invariants I1 = tr C' and I2 = tr C'^-1 the densities are

    neo-Hookean   W = mu/2 (I1 - 3)                                                                    (FM2)
    Yeoh          W = sum over i of c_i (I1 - 3)^i,  i = 1, 2, 3                                       (FM3)
    Ogden         W = sum over i of mu_i/alpha_i (tr C'^(alpha_i/2) - 3)                               (FM4)

The trace of (FM4) is the sum of the powers alpha_i of the principal stretches. Principal stretches have no finite
derivatives where two of them are equal. `power_trace` therefore uses the invariants. For 0 < r < 1

    x^r = sin(pi r)/pi * integral over t from -1 to 1 of 2 x (1 - t)^(r-1) (1 + t)^(-r) / ((1 - t) + x (1 + t))   (FM5)

by Gauss-Jacobi quadrature, and the trace of each rational term is a ratio of polynomials in I1 and I2.

A family of fibres with the unit direction a0 in the body at rest has the stretch lambda = sqrt(a0 . C a0). The energy
of a metre of one fibre at rest is

    w = k/2 (lambda - 1)^2,                                                                            (FM6)

or zero for lambda < 1 if the fibres carry tension only. A square metre of wall has w times the fibres per metre.

Sources: Holzapfel, Nonlinear Solid Mechanics (2000), chapter 6; Yeoh, Rubber Chem. Technol. 66:754 (1993); Ogden, Proc.
R. Soc. A 326:565 (1972); (FM5) is the integral of Hale, Higham, Trefethen, SIAM J. Numer. Anal. 46:2505 (2008),
equation 1.1, with the substitution x = (1 - t)/(1 + t).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from scipy.special import roots_jacobi

from worm3d.values import arguments
from worm3d.values.parameters import check, documented, parameter

POWER_NODES = 16
"""Number of quadrature nodes of (FM5). The relative error is below 1e-9 for principal stretches from 0.35 to 2.8. Half
as many nodes give 2e-5 there, twice as many give 1e-13 at twice the cost."""
GREATEST_EXPONENT = 10.0
"""Largest size of an Ogden exponent. Published rubbers have exponents of at most 6 or so; larger exponents amplify the
rounding errors of (FM5)."""
TENSION_ONSET = 5e-3
"""Range of strain over which the stiffness of fibres in tension grows from zero to its full value. Half of the range is
the strain that fibres lose. With a fifth of the range, Newton's method fails in some states of the shipped barrel that
folds; twice the range saves no steps."""


@documented
@dataclass(frozen=True, kw_only=True)
class Rubber:
    """Base of the rubbers: the constraint of volume (FM1)."""

    bulk_modulus_Pa: float = parameter(
        math.inf, "bulk modulus; infinite for exact incompressibility", "Pa", gt=0.0, infinite=True, left_out="infinite"
    )

    def __post_init__(self) -> None:
        check(self)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest [Pa]."""
        raise NotImplementedError

    def isochoric(self, I1: Any, I2: Any) -> Any:
        """Return the density W as a function of the isochoric invariants [J/m^3]."""
        raise NotImplementedError

    def density(self, C: Any) -> Any:
        """Return the strain energy density of a body at rest without the constraint [J/m^3].

        Parameters
        ----------
        C : casadi.SX or casadi.DM, shape (3, 3)
            Right Cauchy-Green tensor, symmetric and positive definite.
        """
        volume = ca.det(C)
        trace = ca.trace(C)
        minors = (trace**2 - ca.sumsqr(C)) / 2.0  # the second invariant of C
        return self.isochoric(trace * volume ** (-1.0 / 3.0), minors * volume ** (-2.0 / 3.0))

    def constraint(self, J: Any, q: Any) -> Any:
        """Return the term of the multiplier in (FM1) [J/m^3]. J: change of volume, q: multiplier [Pa]."""
        return q * (J - 1.0) - q**2 / (2.0 * self.bulk_modulus_Pa)


@documented
@dataclass(frozen=True, kw_only=True)
class NeoHookean(Rubber):
    """Neo-Hookean rubber, (FM2)."""

    shear_modulus_Pa: float = parameter(meaning="shear modulus mu", unit="Pa", gt=0.0)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest [Pa]."""
        return self.shear_modulus_Pa

    def isochoric(self, I1: Any, I2: Any) -> Any:
        """Return (FM2) [J/m^3]."""
        return self.shear_modulus_Pa / 2.0 * (I1 - 3.0)


@documented
@dataclass(frozen=True, kw_only=True)
class Yeoh(Rubber):
    """Yeoh rubber, (FM3). The shear modulus at rest is 2 c1."""

    c1_Pa: float = parameter(meaning="first coefficient, half of the shear modulus", unit="Pa", gt=0.0)
    c2_Pa: float = parameter(0.0, "second coefficient; slightly negative for softening rubber", "Pa")
    c3_Pa: float = parameter(0.0, "third coefficient, which stiffens the rubber at large strain", "Pa", ge=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        # dW/dI1 = c1 + 2 c2 x + 3 c3 x^2 must stay positive for every x = I1 - 3 >= 0.
        if self.c2_Pa < 0.0 and self.c2_Pa**2 >= 3.0 * self.c1_Pa * self.c3_Pa:
            lowest = -math.sqrt(3.0 * self.c1_Pa * self.c3_Pa)
            raise ValueError(
                f"c2_Pa: got {self.c2_Pa!r} Pa, must be above -sqrt(3 c1 c3) = {lowest:g} Pa, where the rubber "
                "loses its stiffness; raise c2_Pa or c3_Pa"
            )

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest [Pa]."""
        return 2.0 * self.c1_Pa

    def isochoric(self, I1: Any, I2: Any) -> Any:
        """Return (FM3) [J/m^3]."""
        x = I1 - 3.0
        return x * (self.c1_Pa + x * (self.c2_Pa + x * self.c3_Pa))


@documented
@dataclass(frozen=True, kw_only=True)
class Ogden(Rubber):
    """Ogden rubber, (FM4). The shear modulus at rest is half of the sum of mu_i alpha_i.

    Attributes
    ----------
    moduli_Pa : tuple of float
        Moduli mu_i [Pa]. Each has the sign of its exponent.
    exponents : tuple of float
        Exponents alpha_i.
    """

    moduli_Pa: tuple[float, ...]
    exponents: tuple[float, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("moduli_Pa", "exponents"):
            values = arguments.array(name, getattr(self, name), ("M",))
            object.__setattr__(self, name, tuple(values.tolist()))
        if len(self.moduli_Pa) != len(self.exponents):
            raise ValueError(
                f"exponents: got {len(self.exponents)} exponents, must be as many as moduli_Pa, {len(self.moduli_Pa)}"
            )
        for modulus, exponent in zip(self.moduli_Pa, self.exponents, strict=True):
            _require_term(modulus, exponent)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest [Pa]."""
        return sum(mu * alpha for mu, alpha in zip(self.moduli_Pa, self.exponents, strict=True)) / 2.0

    def isochoric(self, I1: Any, I2: Any) -> Any:
        """Return (FM4) [J/m^3]."""
        terms = zip(self.moduli_Pa, self.exponents, strict=True)
        return sum(mu / alpha * (power_trace(I1, I2, alpha / 2.0) - 3.0) for mu, alpha in terms)


def _require_term(modulus: float, exponent: float) -> None:
    if not 0.0 < abs(exponent) <= GREATEST_EXPONENT:
        raise ValueError(
            f"exponents: got {exponent!r}, must be in [-{GREATEST_EXPONENT:g}, {GREATEST_EXPONENT:g}] and not 0"
        )
    if modulus * exponent <= 0.0:
        raise ValueError(
            f"moduli_Pa: got {modulus!r} Pa with the exponent {exponent!r}, must have the sign of the exponent; "
            "otherwise strain releases energy"
        )


RUBBERS: Mapping[str, type[Rubber]] = MappingProxyType({"neo-Hookean": NeoHookean, "Yeoh": Yeoh, "Ogden": Ogden})
"""Rubbers by the name that a description uses."""


@documented
@dataclass(frozen=True, kw_only=True)
class Fibres:
    """A family of fibres in the wall, (FM6).

    Fibres at an angle between 0 and 90 degrees are helical; half of them wind the other way, so that the wall does not
    twist. Fibres do not end within the wall: where the radius is smaller, fibres of an angle below 90 degrees are
    closer to each other.
    """

    stiffness_N: float = parameter(
        meaning="force of one fibre per strain, Young's modulus times cross-section", unit="N", gt=0.0
    )
    per_m: float = parameter(
        meaning="fibres per metre across the fibres, at the middle of the segment", unit="1/m", gt=0.0
    )
    angle_deg: float = parameter(
        0.0, "angle between fibres and meridian; 0 is meridional, 90 is hoop", "deg", ge=0.0, le=90.0
    )
    tension_only: bool = parameter(True, "whether fibres carry no compression, as threads that buckle")

    def __post_init__(self) -> None:
        check(self)

    def area_energy(self, C: Any, meridian: Any, hoop: Any, narrowing: Any = 1.0) -> Any:
        """Return the energy of the fibres in a square metre of wall at rest [J/m^2].

        Parameters
        ----------
        C : casadi.SX or casadi.DM, shape (3, 3)
            Right Cauchy-Green tensor.
        meridian, hoop : casadi.SX or casadi.DM, shape (3, 1)
            Unit vectors in the wall of the body at rest, along the meridian and around the axis.
        narrowing : casadi.SX or float
            Radius of the wall at rest, divided by the radius at the middle of the segment.
        """
        angle = math.radians(self.angle_deg)
        along, across = math.cos(angle) * meridian, math.sin(angle) * hoop
        mean = (self.energy(C, along + across) + self.energy(C, along - across)) / 2.0
        return self.per_m * mean / (narrowing if self.angle_deg < 90.0 else 1.0)

    def energy(self, C: Any, direction: Any) -> Any:
        """Return the energy of a metre of one fibre at rest, (FM6) [J/m]. direction: unit vector a0, shape (3, 1)."""
        strain = ca.sqrt(ca.bilin(C, direction, direction)) - 1.0
        if not self.tension_only:
            return self.stiffness_N / 2.0 * strain**2
        # The stiffness grows linearly over the width w: k e^3/(6 w), then k (e^2/2 - e w/2 + w^2/6).
        w = TENSION_ONSET
        begun = ca.fmin(ca.fmax(strain, 0.0), w)
        return self.stiffness_N * (begun**3 / (6.0 * w) + strain * ca.fmax(strain - w, 0.0) / 2.0)


def power_trace(I1: Any, I2: Any, power: float) -> Any:
    """Return tr C^p for a tensor with det C = 1, from its invariants.

    Parameters
    ----------
    I1, I2 : casadi.SX or casadi.DM
        Traces of C and of its inverse.
    power : float
        Exponent p, other than 0.
    """
    if power < 0.0:
        return power_trace(I2, I1, -power)  # the inverse has the same invariants, in the other order
    whole = math.floor(power)
    rest = power - whole
    if rest == 0.0:
        return _continued((3.0, I1, I1**2 - 2.0 * I2), I1, I2, whole)
    with np.errstate(all="ignore"):  # scipy divides by zero in an entry that it then replaces
        nodes, weights = roots_jacobi(POWER_NODES, rest - 1.0, -rest)
    weights = weights / weights.sum()  # exact at C = I
    return sum(2.0 * w * _resolvent(I1, I2, 1.0 - t, 1.0 + t, whole + 1) for t, w in zip(nodes, weights, strict=True))


def _resolvent(I1: Any, I2: Any, a: float, b: float, power: int) -> Any:
    """Return tr(C^n (a I + b C)^-1) for det C = 1."""
    det = a**3 + a**2 * b * I1 + a * b**2 * I2 + b**3
    first = (
        (3.0 * a**2 + 2.0 * a * b * I1 + b**2 * I2) / det,
        (a**2 * I1 + 2.0 * a * b * I2 + 3.0 * b**2) / det,
        (a**2 * (I1**2 - 2.0 * I2) + a * b * (I1 * I2 - 3.0) + b**2 * I1) / det,
    )
    return _continued(first, I1, I2, power)


def _continued(first: tuple[Any, Any, Any], I1: Any, I2: Any, power: int) -> Any:
    """Return the term `power` of a sequence of traces tr(C^n A), by the theorem of Cayley and Hamilton."""
    terms = [*first]
    while len(terms) <= power:
        terms.append(I1 * terms[-1] - I2 * terms[-2] + terms[-3])
    return terms[power]
