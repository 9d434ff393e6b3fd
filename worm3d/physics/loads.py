"""Loads that a worm carries (`worm3d.physics.load`). The tether, which it drags, is in `worm3d.physics.tether`.

Payload. A mass M on the joint at x has the potential of a mass point, with span and x_hat of the integrator
(`worm3d.physics.kernels.inertia`),

    M/(2 span^2) |x - x_hat|^2 - M g.x                                                                  (X1)

The mass, centre of mass, momentum and cost of transport of the worm do not include the payload.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from worm3d.physics.load import HEAD, LOADS, Load, LoadStep
from worm3d.physics.part import Symbols
from worm3d.physics.tether import Tether
from worm3d.values.parameters import documented, parameter

__all__ = ["LOADS", "Load", "LoadStep", "Payload", "Tether"]


@documented
@dataclass(frozen=True, eq=False, kw_only=True)
class Payload(Load, name="payload"):
    """A mass on a joint, (X1), with weight and inertia. The mass is not part of the worm's mass."""

    mass: float = parameter(0.02, "mass of the payload", "kg", ge=0)
    joint: int = parameter(HEAD, "joint that carries it, from 0, the tail, to N; -1 is the head", ge=HEAD)

    @property
    def at(self) -> int:
        """Joint on which the load acts."""
        return self.joint

    @property
    def mass_carried(self) -> float:
        """Mass that moves with the joint [kg]."""
        return self.mass

    @classmethod
    def respond(cls, s: Symbols) -> LoadStep:
        """Return the potential (X1), and the changes of kinetic and potential energy."""
        import casadi as ca  # parameters do not need casadi

        from worm3d.physics.kernels import inertia

        own: dict[str, Any] = {**s, "weight": s["mass"] * s["gravity"]}
        own |= {"x_hat": inertia.coasting(own), "inertia": inertia.stiffness(own)}
        potential = own["inertia"] / 2.0 * ca.sumsqr(s["x"] - own["x_hat"]) - ca.dot(own["weight"], s["x"])
        terms = inertia.ledger(own, inertia.motion(own))
        del terms["numerical_loss"]
        return LoadStep(potential, terms)
