"""The runs behind the paper's Tables II and III, and the rows that they give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from planar import published
from planar.published import Run

SEGMENTS = (3, 4, 5, 6, 7)
"""Segment counts of Table II, at a period of 2 s."""

PERIODS = (1.0, 2.0, 3.0, 4.0, 5.0)
"""Wave periods of Table III [s], with six segments."""

Key = tuple[int, float]
"""Number of segments, wave period [s]."""


@dataclass(frozen=True)
class Row:
    """One row of the tables, as the published program counts."""

    n: int
    T_wave_s: float
    reported_distance_m: float
    work_J: float
    total_cot_J_per_m: float
    true_displacement_m: float
    cumulative_cot_J_per_m: float

    def as_dict(self) -> dict[str, float]:
        """Return the row with its field names as keys."""
        return asdict(self)


def keys() -> list[Key]:
    """Return the runs of both tables, each once, in the order of the tables."""
    return list(dict.fromkeys([(n, 2.0) for n in SEGMENTS] + [(6, T) for T in PERIODS]))


def simulate(key: Key) -> Run:
    """Run the published program for one row."""
    return published.simulate(n=key[0], T_wave=key[1])


def rows(runs: Mapping[Key, Run]) -> list[Row]:
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
