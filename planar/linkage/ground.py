"""Contact of the apexes with the ground, and Coulomb friction with anchors.

Normal contact is a stiff quadratic penalty on the penetration d = max(0, -z), with a damper that never pulls:

    N = (k + c/dt) max(0, d - d*),   d* = (c/dt) d_n / (k + c/dt)                   (G1)

Friction ties a touching apex to an anchor, a point on the ground, as with a spring. s is the displacement of the apex
from its anchor along the ground, positive towards the head, and y = s - s* (s* is defined below). With mu = mu_forward
for y > 0 and mu_backward for y < 0, the potential of friction is N h(y):

    h = mu y^2/(2 b)  while |y| <= b,   else mu (|y| - b/2),   b = r/max(mu, mu_0)     (G2)

The terms 1/r = 1/rho_b + D/dt and s* = (D/dt) r s_n come from a damper parallel to the anchor's spring. The sum of the
two forces is at most N mu. rho_b is the displacement at which a contact breaks away, times its mu. rho_b is the same
number for all contacts, and the displacement does not depend on the normal load. Contacts with mu below mu_0 =
`Ground.least`, including mu = 0, break away at the same displacement as with mu_0; otherwise their anchors would stay
far behind. If the apex slides in a step, the anchor moves after the step until the friction is at its limit again:

    s_e = s* + y min(1, b/|y|),   the anchor moves by s - s_e                        (G3)

The limit of friction is cap N mu, where cap = static_ratio while the contact is stuck and cap = 1 otherwise. The
stiffness of the contact is the same in both cases.

A step is solved first with cap = static_ratio for all contacts that are stuck at the start of the step. Then all stuck
contacts whose friction has reached the limit in the solution,

    |y| > cap b (1 - 1e-9),                                                           (G4)

break away together. They get cap = 1, and the step is solved again from the start. This repeats until no further
contact reaches the limit. A contact that has broken away does not stick again in the same step; therefore the
repetition ends.
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
"""Penetration of an apex under the weight of one segment, as a fraction of the segment length."""

BREAKAWAY = 1e-5
"""Breakaway displacement of the contact with the smallest coefficient, as a fraction of the segment length."""

SMALLEST_COEFFICIENT = 0.01
"""Coefficients below this fraction of the largest coefficient, including 0, do not set the breakaway displacement.
Otherwise the other contacts would become so stiff that rounding errors would be visible."""

LEAST_BESIDE_SMALL = 0.1
"""If a coefficient is below the fraction `SMALLEST_COEFFICIENT`, mu_0 is at most this fraction of the largest
coefficient. `worm3d` uses the same value."""

TANGENTIAL_DAMPING_RATIO = 40.0
"""Damping ratio of the contact with the smallest coefficient and the mass that it carries; other contacts are damped
more.

Since the limit of friction applies to the sum of spring and damper, the damper changes the motion only by micrometres
and for milliseconds. With a damping ratio of 1, a contact under a suddenly applied load overshoots and breaks away too
early. With a large damping ratio the contact carries the full load almost at once, as a rigid contact would. The
distance that a worm crawls does not depend on the damping ratio.
"""

WEIGHTLESS = 0.075
"""Weight that scales the contacts of a worm without gravity, as a fraction of the mean stiffness of the springs.
`worm3d` uses the same value."""

LIMIT_TOLERANCE = 1e-9
"""Relative tolerance of the limit of friction.

A contact breaks away if its friction is closer to the limit than this tolerance (G4). An anchor moves only if the
friction exceeds the limit by more than this tolerance, so that rounding does not make the anchor creep. A given regime
agrees with the law if it violates the law by no more than this tolerance.
"""


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
    static_ratio: float = parameter(1.2, "static over kinetic coefficient, for the anchored law of friction", ge=1)

    def __post_init__(self) -> None:
        check(self)

    def coefficients(self, segments: int) -> tuple[FloatArray, FloatArray]:
        """Return the forward and the backward coefficients of the segments, each of shape (N,)."""
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
        """Return the constants, scaled to the weight of a worm under `natural_gravity`."""
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
            # The contact carries the mass N/g. Critical damping is D mu^2 = 2 sqrt((mu^2/rho_b) (1/g)) per unit of N.
            gauge_damping=TANGENTIAL_DAMPING_RATIO * 2.0 / (mu * float(np.sqrt(yield_gauge * g))),
            static_ratio=float(friction.static_ratio),
        )


def natural_gravity(worm: Linkage, gravity: float) -> float:
    """Return the acceleration that scales the contacts [m/s^2].

    The result is `gravity`. If `gravity` is 0, it is the acceleration that gives the worm the weight of `WEIGHTLESS`.
    """
    return gravity if gravity > 0.0 else WEIGHTLESS * float(np.mean(worm.k_spring)) / worm.total_mass
