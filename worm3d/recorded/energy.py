"""The energy ledger of a run. Its terms are declared here; `worm3d.solver.ledger` computes them."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from worm3d.recorded.series import derived, documented, recorded
from worm3d.values.arrays import FloatArray
from worm3d.values.read_only import ReadOnly


def _term(meaning: str) -> Any:
    return recorded("time", "J", meaning)


@documented
@dataclass(frozen=True, eq=False)
class Energy(ReadOnly):
    """Energy ledger: the sum of each term over the steps since the previous row. The first row is 0."""

    work_contract: FloatArray = _term("work of the actuators")
    work_external: FloatArray = _term("work of external forces")
    load_change: FloatArray = _term("anchor energy changed by normal loads and turning tangents")
    kinetic: FloatArray = _term("change of kinetic energy")
    elastic: FloatArray = _term("change of elastic energy")
    potential: FloatArray = _term("change of potential energy of the weight")
    penetration: FloatArray = _term("change of energy of the normal contact")
    anchor: FloatArray = _term("change of energy of the friction's anchors")
    actuator: FloatArray = _term("change of energy kept within the actuators")
    friction_loss: FloatArray = _term("loss to friction")
    viscous_loss: FloatArray = _term("loss to Kelvin-Voigt damping, medium and friction's dampers")
    impact: FloatArray = _term("loss to impacts on the world")
    numerical_loss: FloatArray = _term("numerical loss of the integrator")
    actuator_loss: FloatArray = _term("loss within the actuators")
    hysteresis_loss: FloatArray = _term("loss to friction in the joints of the chambers")
    drag_loss: FloatArray = _term("part of the viscous loss: to the medium")
    work_contract_positive: FloatArray = _term("positive part of the work of all actuators together, step by step")
    work_contract_p11: FloatArray = _term("work F.dq of the contraction force, (P11)")
    work_friction_p13: FloatArray = _term("work F.dq of the friction force, (P13)")

    @derived("time", "J", "what comes in less what is stored or lost")
    def residual(self) -> FloatArray:
        """Return the energy supplied minus the energy stored or lost. It is zero up to Newton's residual."""
        return self.sum(SUPPLIED_ENERGY) - self.sum(STORED_ENERGY) - self.sum(LOST_ENERGY)

    @classmethod
    def of(cls, rows: FloatArray) -> Energy:
        """Return the ledger made of recorded rows, shape (T, 19)."""
        return cls(**dict(zip(TERMS, rows.T, strict=True)))

    def sum(self, names: tuple[str, ...]) -> FloatArray:
        """Return the sum of some terms, shape (T,) [J]."""
        total: FloatArray = np.sum([getattr(self, name) for name in names], axis=0)
        return total

    @cached_property
    def uses(self) -> dict[str, float]:
        """Energy that each use takes of the work of actuators and external forces, by name [J]. The sum is the work.

        The uses are friction on the world, friction in the joints of the chambers ("hysteresis"), "damping" (dampers of
        the material, of the medium and of friction, and all losses within the actuators), impacts, numerical loss, and
        the increase of stored energy from start to end ("gained": kinetic, elastic, potential, of contacts and
        actuators).
        """
        parts = {
            "friction": self.friction_loss,
            "hysteresis": self.hysteresis_loss,
            "damping": self.viscous_loss + self.actuator_loss,
            "impact": self.impact,
            "numerical": self.numerical_loss,
            "gained": self.sum(STORED_ENERGY) - self.load_change,
        }
        return {name: float(part.sum()) for name, part in parts.items()}

    @property
    def balance_error(self) -> float:
        """Absolute residual of the run, divided by the sum of the absolute terms; NaN if a term is NaN."""
        scale = sum(
            float(np.abs(getattr(self, name)).sum()) for name in (*SUPPLIED_ENERGY, *STORED_ENERGY, *LOST_ENERGY)
        )
        return 0.0 if scale == 0.0 else abs(float(self.residual.sum())) / scale


TERMS = tuple(each.name for each in fields(Energy))
"""Terms of the ledger, in the order of the solver's array "terms"."""

SUPPLIED_ENERGY, STORED_ENERGY, LOST_ENERGY = TERMS[:3], TERMS[3:9], TERMS[9:15]
"""Terms that balance: the energy supplied equals the energy stored plus the energy lost. The other terms of the ledger
are parts of these terms, or quantities that the paper defines."""
