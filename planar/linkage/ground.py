"""Contact of the apexes with the ground, and set-valued friction with anchors.

Normal contact is a stiff quadratic penalty on the penetration d = max(0, -z), with a damper that never pulls:

    N = (k + c/dt) max(0, d - d*),   d* = (c/dt) d_n / (k + c/dt)                   (G1)

Friction keeps an anchor per touching apex; s is the displacement from the anchor along the ground, positive towards the
head, and y = s - s*. With mu = mu_forward for y > 0 and mu_backward for y < 0, the potential of friction is N h(y):

    h = mu y^2/(2 b)  while |y| <= b,   else mu (|y| - b/2),   b = r/max(mu, mu_0)     (G2)

1/r = 1/rho_b + D/dt and s* = (D/dt) r s_n put a damper beside the anchor's spring, both capped together by N mu.
rho_b, the breakaway displacement times mu, is one number for all contacts, so that all contacts yield together for any
load. The exception is mu below mu_0 = `Ground.least`, including mu = 0: such contacts yield as with mu_0, since the
anchor would otherwise be dragged far behind. After the step the anchor moves until the force is back on the yield
surface:

    s_e = s* + y min(1, b/|y|),   the anchor moves by s - s_e                        (G3)

While a contact is stuck, the cap is N x static_ratio instead of N, with the same stiffness.

Breakaway (G4): the step is solved with cap = static_ratio for all contacts that are stuck at the start of the step. All
of these contacts whose friction reaches the limit in the solution,

    |y| > cap b (1 - 1e-9),

break away together: they get cap = 1, and the step is solved again from the start. This repeats until no contact
reaches the limit. A contact that has broken away does not stick again in the same step, so that the repetition ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planar.linkage.worm import Linkage
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.read_only import ReadOnly

RESTING_PENETRATION = 1e-5
"""Penetration under the mean load, as a fraction of the segment length."""

BREAKAWAY = 1e-5
"""Yield displacement of the contact with the smallest coefficient, as a fraction of the segment length."""

SMALLEST_COEFFICIENT = 0.01
"""Coefficients below this fraction of the largest, including 0, do not set the breakaway displacement: other contacts
would become so stiff that rounding shows."""

LEAST_BESIDE_SMALL = 0.1
"""Greatest fraction of the largest coefficient that sets the breakaway displacement if a coefficient is smaller than
`SMALLEST_COEFFICIENT`; the same as in `worm3d`."""

TANGENTIAL_DAMPING_RATIO = 40.0
"""Damping ratio of the contact with the smallest coefficient and its mass; other contacts are damped more.

The damper shares the cap with the spring, so that the effects are only micrometres and milliseconds. With too little
damping (1) a suddenly applied load overshoots and breaks loose early; with more damping the contact carries the full
load sooner, and a rigid contact carries the full load at once. The distance that a worm crawls does not depend on the
damping ratio.
"""

WEIGHTLESS = 0.075
"""Substitute for the weight of a weightless worm, as a fraction of the mean stiffness of the springs; the same as in
`worm3d`."""

LIMIT_TOLERANCE = 1e-9
"""Relative distance to a limit of friction below which a contact breaks away (G4), an anchor stays, so that rounding
causes no creep, and a given regime agrees with the law."""


@documented
@dataclass(frozen=True, eq=False)
class Friction(ReadOnly):
    """Directional Coulomb friction."""

    forward: float | FloatArray = parameter(
        0.03,
        "kinetic coefficient against motion towards the head",
        ge=0,
        le=arguments.MAX_MAGNITUDE,
        each="segment",
        aka=("mu_forward",),
    )
    backward: float | FloatArray = parameter(
        0.20,
        "kinetic coefficient against motion towards the tail",
        ge=0,
        le=arguments.MAX_MAGNITUDE,
        each="segment",
        aka=("mu_backward",),
    )
    static_ratio: float = parameter(1.2, "static over kinetic coefficient, anchored", ge=1)

    def __post_init__(self) -> None:
        check(self)

    def coefficients(self, segments: int) -> tuple[FloatArray, FloatArray]:
        """Return forward and backward coefficients of each segment, each of shape (N,)."""
        for name in ("forward", "backward"):
            arguments.require_count(name, getattr(self, name), segments)
        forward, backward = (
            np.ascontiguousarray(np.broadcast_to(np.asarray(mu), (segments,))) for mu in (self.forward, self.backward)
        )
        return forward, backward


class Ground(NamedTuple):
    """Constants of the contact law for one worm on one ground."""

    stiffness: float
    """k of (G1) [N/m]; 0 means no ground."""
    damping: float
    """c of (G1) [N s/m]."""
    mu_forward: FloatArray
    """Kinetic coefficient against motion of each segment towards the head, shape (N,)."""
    mu_backward: FloatArray
    """Kinetic coefficient against motion of each segment towards the tail, shape (N,)."""
    least: float
    """mu_0 of (G2)."""
    yield_gauge: float
    """rho_b of (G2) [m]."""
    gauge_damping: float
    """D of (G2) [s/m]."""
    static_ratio: float = 1.0
    """Static over kinetic coefficient."""

    @classmethod
    def none(cls, segments: int) -> Ground:
        """Return the constants of a worm that touches nothing."""
        frictionless = np.zeros(segments)
        return cls(0.0, 0.0, frictionless, frictionless, 1.0, 1.0, 0.0)

    @classmethod
    def of(cls, worm: Linkage, friction: Friction, gravity: float) -> Ground:
        """Return the constants scaled to a worm's weight, or to `natural_gravity` without one."""
        g = natural_gravity(worm, gravity)
        share = worm.total_mass / worm.segments
        stiffness = share * g / (RESTING_PENETRATION * worm.l0)
        forward, backward = friction.coefficients(worm.segments)
        both = np.concatenate([forward, backward])
        largest = float(both.max())
        small = both < SMALLEST_COEFFICIENT * largest
        mu = float(both[~small].min()) if largest > 0.0 else 1.0
        if small.any():
            mu = min(mu, LEAST_BESIDE_SMALL * largest)
        yield_gauge = mu * BREAKAWAY * worm.l0
        return cls(
            stiffness=stiffness,
            damping=2.0 * float(np.sqrt(stiffness * share)),
            mu_forward=forward,
            mu_backward=backward,
            least=mu,
            yield_gauge=yield_gauge,
            # The mass held is N/g: critical is D mu^2 = 2 sqrt((mu^2/rho_b) (1/g)) per unit of N.
            gauge_damping=TANGENTIAL_DAMPING_RATIO * 2.0 / (mu * float(np.sqrt(yield_gauge * g))),
            static_ratio=float(friction.static_ratio),
        )


def natural_gravity(worm: Linkage, gravity: float) -> float:
    """Return the acceleration that scales the contacts [m/s^2]: gravity, or from `WEIGHTLESS` if gravity is 0."""
    return gravity if gravity > 0.0 else WEIGHTLESS * float(np.mean(worm.k_spring)) / worm.total_mass
