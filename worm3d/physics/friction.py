"""Coefficients of friction, and the constants of the contact law (`worm3d.physics.contact`) for a given worm."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from worm3d.physics.friction_laws import Coulomb, law_of
from worm3d.physics.part import Numbers
from worm3d.physics.worm import Worm
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.read_only import ReadOnly

RESTING_PENETRATION = 1e-5
"""Penetration of a contact under the mean load, as a fraction of the segment length."""

BREAKAWAY = 1e-5
"""Breakaway displacement of the contact with the smallest coefficient, as a fraction of the segment length."""

SMALLEST_COEFFICIENT = 0.01
"""Smallest coefficient that may set the breakaway displacement, as a fraction of the largest coefficient.

A smaller coefficient would make the other contacts so stiff that rounding errors become visible. Contacts with smaller
coefficients get a larger hardness H instead, so that they yield at the same displacement.
"""

LEAST_BESIDE_SMALL = 0.1
"""Upper limit of the coefficient that sets the breakaway displacement if some coefficients are below
`SMALLEST_COEFFICIENT`, as a fraction of the largest coefficient.

A contact that glides almost freely in one direction creeps at right angles to this direction, in every step, by about
the displacement at which it yields.
"""

NEGLIGIBLE = 1e-13
"""Coefficient that replaces all smaller coefficients, including 0, as a fraction of the largest coefficient.

Its force changes a velocity in a step by less than the rounding of positions, and the law needs no exception for 0.
"""

TINY = 1e-30
"""Coefficient that replaces 0 if all coefficients are 0."""

TANGENTIAL_DAMPING_RATIO = 40.0
"""Damping ratio of the contact with the smallest coefficient and the mass that it holds. Contacts with larger
coefficients have a larger damping ratio.

The limit of friction applies to the sum of the forces of damper and spring, so that damping affects only displacements
of micrometres and times of milliseconds. With 1 instead of 40, a suddenly applied load overshoots and breaks loose too
early. With more damping, the contact carries the full load sooner; a rigid contact would carry it at once. The distance
that a worm crawls does not depend on the damping.
"""

WEIGHTLESS = 0.075
"""Weight that is assumed for the contacts of a worm without weight, as a fraction of the mean stiffness of its springs.

This is about the weight of the default worm. Only spring forces press a worm without weight on its world. With half or
twice this value, contacts penetrate twice or half as far.
"""

_RANGE: dict[str, Any] = {"ge": 0, "le": 1e6, "each": "segment"}


@documented
@dataclass(frozen=True, eq=False)
class Friction(ReadOnly):
    """Directional friction with sticking. `law` computes the force from the coefficients; the default is Coulomb's law.

    `law` is a `worm3d.FrictionLaw`, the name of a law, or a dictionary {"name": ..., **parameters}.

    Raises
    ------
    ValueError
        A value that is not finite or out of range.
    """

    forward: Numbers = parameter(
        0.03, "kinetic coefficient against motion towards the head", aka=("mu_forward",), **_RANGE
    )
    backward: Numbers = parameter(
        0.20, "kinetic coefficient against motion towards the tail", aka=("mu_backward",), **_RANGE
    )
    lateral: Numbers = parameter(
        0.20, "kinetic coefficient against motion sideways", aka=("mu_lateral", "sideways"), **_RANGE
    )
    static_ratio: float = parameter(1.2, "static over kinetic coefficient", ge=1)
    contact_stiffness: Numbers | None = parameter(
        None,
        "normal stiffness of one contact point, for a skin that yields under its load",
        "N/m",
        gt=0,
        each="segment",
        left_out="stiff: the mean load presses a point in by 1e-5 of the segment length",
    )
    law: Any = field(default_factory=Coulomb)

    def __post_init__(self) -> None:
        check(self)
        object.__setattr__(self, "law", law_of(self.law))

    def coefficients(self, segments: int) -> FloatArray:
        """Return forward, backward and lateral coefficients of each segment, shape (3, N).

        Raises
        ------
        ValueError
            An array without exactly one value per segment.
        """
        given = {name: getattr(self, name) for name in ("forward", "backward", "lateral")}
        return np.array([arguments.array(name, value, (segments,), fill=True) for name, value in given.items()])


@dataclass(frozen=True)
class ContactConstants:
    """Constants of the contact law for a given worm and friction.

    Attributes
    ----------
    stiffness, damping : ndarray, shape (N,)
        k [N/m] and c [N s/m] of one contact point of each segment, (C1).
    yield_gauge : float
        rho_b of (C3) [m].
    gauge_damping : float
        D of (C3) [s/m].
    mu : ndarray, shape (3, N)
        Forward, backward and lateral coefficient of each segment.
    hardness : ndarray, shape (3, N)
        H of (C2) for each coefficient.
    """

    stiffness: FloatArray
    damping: FloatArray
    yield_gauge: float
    gauge_damping: float
    mu: FloatArray
    hardness: FloatArray

    @classmethod
    def of(cls, worm: Worm, friction: Friction, gravity: float) -> ContactConstants:
        """Return the constants scaled to a worm's weight; for a worm without weight, `natural_gravity` is used.

        Left and right apexes below a segment share the load, so that each apex has half of the segment's stiffness.
        """
        g = natural_gravity(worm, gravity)
        share = worm.mass / (2 * worm.segments)
        stiff = share * g / (RESTING_PENETRATION * worm.l0)
        given = stiff if friction.contact_stiffness is None else friction.contact_stiffness
        stiffness = arguments.array("contact_stiffness", given, (worm.segments,), fill=True)
        mu = friction.coefficients(worm.segments)
        acting = mu[: 2 if worm.flat else 3]
        mu = np.maximum(mu, max(NEGLIGIBLE * float(acting.max()), TINY))
        least = _least(acting)
        yield_gauge = least * BREAKAWAY * worm.l0
        return cls(
            stiffness=stiffness,
            damping=2.0 * np.sqrt(stiffness * share),
            yield_gauge=yield_gauge,
            # The mass held is N/g. Critical damping is D mu^2 = 2 sqrt((mu^2/rho_b) (1/g)) per unit of N.
            gauge_damping=TANGENTIAL_DAMPING_RATIO * 2.0 / (least * float(np.sqrt(yield_gauge * g))),
            mu=mu,
            hardness=np.maximum(1.0, least / mu),
        )


def natural_gravity(worm: Worm, gravity: float) -> float:
    """Return the acceleration to which contacts are scaled [m/s^2]: gravity if not 0, otherwise from `WEIGHTLESS`."""
    return gravity if gravity > 0.0 else WEIGHTLESS * float(np.mean(worm.k_spring)) / worm.mass


def natural_time(worm: Worm, gravity: float) -> float:
    """Return the time in which the worm falls by half of its length [s].

    Contacts are scaled to the weight and the segment length, so that their time constants are proportional to this
    time. For a worm without weight, these time constants are proportional to its periods of vibration
    (`natural_gravity`).
    """
    return float(np.sqrt(worm.length / natural_gravity(worm, gravity)))


def _least(mu: FloatArray) -> float:
    """Return the coefficient that sets the breakaway displacement. Contacts with smaller coefficients get H > 1."""
    largest = float(mu.max())
    if largest <= TINY:
        return 1.0
    small = mu < SMALLEST_COEFFICIENT * largest
    return min(float(mu[~small].min()), LEAST_BESIDE_SMALL * largest if small.any() else np.inf)
