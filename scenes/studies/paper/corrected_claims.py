"""The paper's claims, tested with the corrected worm in contact with the ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from planar.linkage import Friction, Run, simulate
from scenes.studies.paper.cases import CORRECTED_AMPLITUDE, PAPER_PERIODS_S, SEGMENTS, CorrectedRow, GroundKey, wave
from scenes.studies.paper.claims import Claim, by_period, by_segments, listed, verdict

TORSIONS = (1.0, 1e2, 1e4, 1e6)
"""Torsional stiffnesses in the test of Newton's method [J]. Table I has 1e4 J."""


def corrected_claims(runs: Mapping[GroundKey, Run], rows: Sequence[CorrectedRow]) -> list[Claim]:
    """Return the claims with their verdicts. This makes about six additional runs of the corrected worm."""
    contact = {(r.n, r.T_wave_s): r for r in rows if r.law == "anchored"}
    main = runs[6, 2.0, "anchored"]
    return [
        *segment_claims([contact[n, 2.0] for n in SEGMENTS]),
        *period_claims([contact[6, T] for T in PAPER_PERIODS_S]),
        _friction_claim(main),
        mechanism_claim(main),
        _wave_claim(main),
        _torsion_claim(main),
        _mass_claim(main),
    ]


def segment_claims(rows: Sequence[CorrectedRow]) -> list[Claim]:
    """Test the claims about the number of segments."""
    return [
        by_segments("the distance [m]", [r.distance_m for r in rows]),
        by_segments("the cumulative cost of transport [J/m], (P12)", [r.cumulative_cot_J_per_m for r in rows]),
        by_segments("the cost of transport W/(m g d)", [r.cost_of_transport for r in rows]),
    ]


def period_claims(rows: Sequence[CorrectedRow]) -> list[Claim]:
    """Test the claims about the wave period."""
    return [
        by_period("more work in a given time [J]", [r.work_contract_J for r in rows]),
        by_period("a higher cumulative cost of transport [J/m], (P12)", [r.cumulative_cot_J_per_m for r in rows]),
        by_period("a higher cost of transport W/(m g d)", [r.cost_of_transport for r in rows]),
    ]


def _friction_claim(main: Run) -> Claim:
    isotropic = simulate(main.worm, wave(6, 2.0, "retrograde"), friction=Friction(0.2, 0.2)).distance
    direct = simulate(main.worm, wave(6, 2.0), friction=Friction(0.2, 0.2)).distance
    return Claim(
        claim="friction propels the worm by anchoring it (rather than momentum transfer inside the body)",
        source="II.A",
        verdict=verdict(isotropic > 0.0 and isotropic > direct),
        evidence=f"with friction 0.20 both ways, so that only loads anchor, a wave from head to tail makes "
        f"{isotropic:+.4f} m, one from tail to head {direct:+.4f} m",
    )


def mechanism_claim(main: Run) -> Claim:
    """Test whether an active segment widens and shortens."""
    active, passive = main.contraction > 0.95 * CORRECTED_AMPLITUDE, main.contraction == 0.0
    height = np.linalg.norm(main.apexes[:, :, 1] - main.apexes[:, :, 0], axis=-1)
    shorter = main.length[active].mean() < main.length[passive].mean()
    wider = height[active].mean() > height[passive].mean()
    return Claim(
        claim="an active segment expands vertically and shortens horizontally",
        source="II.E",
        verdict=verdict(bool(shorter and wider)),
        evidence=f"near full activation {main.length[active].mean():.4f} m long and {height[active].mean():.4f} m "
        f"high, passive {main.length[passive].mean():.4f} m and {height[passive].mean():.4f} m",
    )


def _wave_claim(main: Run) -> Claim:
    back = simulate(main.worm, wave(6, 2.0, "retrograde"))
    return Claim(
        claim="a wave from the head to the tail propels the worm",
        source="III.C",
        verdict=verdict(back.distance > abs(main.distance)),
        evidence=f"head to tail {back.distance:.4f} m at a cost of transport of {back.cost_of_transport:.4g}; "
        f"tail to head, as the program has it, {main.distance:.4f} m",
    )


def _torsion_claim(main: Run) -> Claim:
    runs = [main if k == 1e4 else simulate(main.worm.with_changes(k_torsion=k), wave(6, 2.0)) for k in TORSIONS]
    iterations = [float(run.newton_iterations.mean()) for run in runs]
    halved = sum(run.halved_steps for run in runs)
    breaks = halved > 0 or any(run.status.diverged for run in runs) or max(iterations) > 2.0 * min(iterations)
    labels = [f"{k:g} J" for k in TORSIONS]
    return Claim(
        claim="an extremely high torsional stiffness destabilises Newton's method",
        source="IV.C",
        verdict=verdict(breaks),
        evidence=f"Newton iterations a step with k_torsion = {listed(labels, iterations)}; {halved} steps halved; "
        f"distances {listed(labels, [run.distance for run in runs])} [m]",
    )


def _mass_claim(main: Run) -> Claim:
    on_joints = simulate(main.worm.with_changes(apex_mass_fraction=0.0), wave(6, 2.0))
    return Claim(
        claim="concentrating the mass at the nodes leads to unstable, collapsed states",
        source="IV.C",
        verdict=verdict(on_joints.status.diverged),
        evidence=f"with all the mass on the joints: {on_joints.stop.sentence}, {on_joints.halved_steps} steps halved, "
        f"distance {on_joints.distance:.4f} m ({main.distance:.4f} m with half of it on the apexes)",
    )
