"""The nine cases of the paper's Tables II and III, as runs of the published program and of the corrected worm.

The corrected worm runs on three kinds of ground: in contact with set-valued friction, in contact with the paper's
threshold friction (P10), and clamped, with its height prescribed as in the published program.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from control import gaits
from planar import linkage, published
from planar.linkage.simulate import Gait
from scenes.models.planar.linkage import cumulative_cost
from scenes.models.planar.merit import Travel, cost_of_transport

SEGMENTS = (3, 4, 5, 6, 7)
"""Numbers of segments in Table II, where the wave period is 2 s."""
PAPER_PERIODS_S = (1.0, 2.0, 3.0, 4.0, 5.0)
"""Wave periods in Table III [s], where the worm has six segments."""
Key = tuple[int, float]
"""Number of segments, wave period [s]."""

CORRECTED_AMPLITUDE = 0.2
"""Contraction of the corrected worm at activation 1."""

Ground = Literal["anchored", "threshold", "clamped"]
"""Ground of the corrected worm: "anchored" is contact with set-valued friction, "threshold" is contact with the paper's
friction (P10), and "clamped" has prescribed heights with loads by (P9) and friction by (P10)."""

GROUND_NAMES: dict[Ground, str] = {
    "anchored": "contact, set-valued friction",
    "threshold": "contact, threshold friction (P10)",
    "clamped": "clamped, (P9) and (P10)",
}

GroundKey = tuple[int, float, Ground]
"""Number of segments, wave period [s], ground."""


@dataclass(frozen=True)
class Row:
    """One row of Table II or III. The published program defines the distance, the work and the costs."""

    n: int
    T_wave_s: float
    reported_distance_m: float
    work_J: float
    total_cot_J_per_m: float
    true_displacement_m: float
    cumulative_cot_J_per_m: float


def published_keys() -> list[Key]:
    """Return the cases of both tables in their order. The case that is in both tables is returned once."""
    return list(dict.fromkeys([(n, 2.0) for n in SEGMENTS] + [(6, T) for T in PAPER_PERIODS_S]))


def published_run(key: Key) -> published.Run:
    """Run the published program for one case."""
    return published.simulate(n=key[0], T_wave=key[1])


def published_rows(runs: Mapping[Key, published.Run]) -> list[Row]:
    """Return the table rows of the runs."""
    return [
        Row(
            n=n,
            T_wave_s=T,
            reported_distance_m=run.reported_distance,
            work_J=run.work,
            total_cot_J_per_m=run.total_cot,
            true_displacement_m=run.true_displacement,
            cumulative_cot_J_per_m=float(run.cumulative_cot[-1]),
        )
        for (n, T), run in runs.items()
    ]


@dataclass(frozen=True)
class CorrectedRow:
    """One run of the corrected worm."""

    n: int
    T_wave_s: float
    ground: str
    """"contact" or "clamped"."""
    law: str
    """"anchored" or "threshold"."""
    distance_m: float
    work_contract_J: float
    """Net work of the actuators."""
    work_friction_J: float
    cost_of_transport: float | None
    """Net work over weight and distance; None if the worm did not move forward."""
    cumulative_cot_J_per_m: float
    """Sum of |F.dq / dx| over the steps, (P11) and (P12), as in the paper's plots."""
    speed_BL_per_wave: float | None
    newton_iterations_mean: float
    halved_steps: int
    sentence: str


def corrected_keys() -> list[GroundKey]:
    """Return the cases of the corrected worm: all nine cases "anchored", and those with six segments on each ground."""
    grounds: tuple[Ground, ...] = ("threshold", "clamped")
    return [
        *((n, T, "anchored") for n, T in published_keys()),
        *((6, T, ground) for ground in grounds for T in PAPER_PERIODS_S),
    ]


def corrected_run(key: GroundKey) -> linkage.Run:
    """Run the corrected worm of Table I for ten seconds with the paper's rectified wave."""
    n, T, ground = key
    return linkage.simulate(
        linkage.Linkage(segments=n),
        wave(n, T),
        ground="clamped" if ground == "clamped" else "contact",
        friction_law="threshold" if ground == "threshold" else "anchored",
    )


def wave(n: int, T: float, direction: gaits.Direction = "direct") -> Gait:
    """Return the paper's wave as a gait, a function from time [s] to the contractions of n segments."""
    pattern = gaits.TravellingWave(amplitude=CORRECTED_AMPLITUDE, period=T, direction=direction)
    return lambda t: pattern.amplitude * pattern.activation(t, n)


def corrected_rows(runs: Mapping[GroundKey, linkage.Run]) -> list[CorrectedRow]:
    """Return the results of the runs."""
    return [_row(key, result) for key, result in runs.items()]


def _row(key: GroundKey, result: linkage.Run) -> CorrectedRow:
    n, T, ground = key
    worm, work = result.worm, result.work_contract
    travel = Travel.of(result.com, result.time, T)
    weight = worm.total_mass * float(np.hypot(*result.gravity))
    return CorrectedRow(
        n=n,
        T_wave_s=T,
        ground="clamped" if ground == "clamped" else "contact",
        law="anchored" if ground == "anchored" else "threshold",
        distance_m=travel.distance,
        work_contract_J=work,
        work_friction_J=result.work_friction,
        cost_of_transport=cost_of_transport(work, weight, travel.distance),
        cumulative_cot_J_per_m=float(cumulative_cost(result.ledger.work_contract_p11, result.com[:, 0])[-1]),
        speed_BL_per_wave=None if travel.mean_speed is None else travel.mean_speed * T / worm.length,
        newton_iterations_mean=float(result.newton_iterations.mean()),
        halved_steps=result.halved_steps,
        sentence=result.stop.sentence,
    )


@dataclass(frozen=True)
class Overstatement:
    """Overestimates of the distance by two grounds, relative to the distance with set-valued friction.

    An overestimate is None if the distance with set-valued friction is not positive.
    """

    T_wave_s: float
    set_valued_distance_m: float
    threshold_percent: float | None
    clamped_percent: float | None


def overstatements(distance: Callable[[GroundKey], float]) -> list[Overstatement]:
    """Return the overestimates for six segments and each period. `distance` returns the distance of a run [m]."""

    def percent(T: float, ground: Ground) -> float | None:
        true = distance((6, T, "anchored"))
        return 100.0 * (distance((6, T, ground)) / true - 1.0) if true > 0.0 else None

    return [
        Overstatement(T, distance((6, T, "anchored")), percent(T, "threshold"), percent(T, "clamped"))
        for T in PAPER_PERIODS_S
    ]
