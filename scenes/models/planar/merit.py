"""Figures of merit of both planar models, reasons for missing values, and the movie of a record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from scenes.models.base import MOVIE_S, Movie
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray
from worm3d.values.period_means import path_length

if TYPE_CHECKING:
    from planar import linkage, published

NO_STEP = "no step was finished"


@dataclass(frozen=True)
class Travel:
    """Distance and speed of the centre of mass."""

    distance: float
    """Displacement along x [m]."""
    path_length: float | None
    mean_speed: float | None
    """Path [m] and speed [m/s] of the centre of mass along x. The position is averaged over a period first, since it
    oscillates within a period. Both are None for a run without a step, and the speed is also None for a run shorter
    than a period."""

    @classmethod
    def of(cls, com: FloatArray, time: FloatArray, period: float) -> Travel:
        """Return the travel of a centre of mass.

        `com` has the shape (T, 2) [m], and `time`, which is evenly spaced, the shape (T,) [s].
        """
        distance = float(com[-1, 0] - com[0, 0])
        if len(time) < 2:
            return cls(distance, None, None)
        path = path_length(com[:, :1], time, period)
        if len(time) <= (window := round(period / (time[1] - time[0]))):
            return cls(distance, path, None)
        first, last = com[:window, 0].mean(), com[-window:, 0].mean()
        speed = float((last - first) / (time[-1] - time[window - 1]))
        return cls(distance, path, speed)


def common(
    run: published.Run | linkage.Run, travel: Travel, works: tuple[float, float], weight: float, balance_error: float
) -> dict[str, float | None]:
    """Return the entries of the summary that both planar models have.

    `works` are the work of the contraction and the work of friction [J], and `weight` is the weight of the worm [N].
    """
    work, friction = works
    return {
        "duration_s": float(run.time[-1]),
        "distance_m": travel.distance,
        "path_length_m": travel.path_length,
        "mean_speed_m_s": travel.mean_speed,
        "heading_change_deg": 0.0,  # a planar worm cannot turn
        "work_contract_J": work,
        "work_friction_J": friction,
        "cost_of_transport": cost_of_transport(work, weight, travel.distance),
        "energy_balance_error": balance_error,
        "newton_iterations_mean": float(run.newton_iterations.mean()) if len(run.newton_iterations) else None,
    }


def movie(record: Record, names: tuple[str, str, str], activation: FloatArray) -> Movie:
    """Return the movie of a record.

    `names` are the variables of the joints, the top apexes and the bottom apexes. `activation` has the shape (T, N).
    """
    from planar import animation

    shown = record["time"] <= MOVIE_S
    main, top, bottom = (record[name][shown] for name in names)
    ground = float(record["ground"]) if "ground" in record else None
    return animation.Movie(record["time"][shown], main, top, bottom, activation[shown], ground)


def cost_of_transport(work: float, weight: float, distance: float) -> float | None:
    """Return the cost of transport W / (m g d).

    Return None if the worm has no weight, did not move forward, or did negative work W.
    """
    return work / (weight * distance) if work >= 0.0 and weight * distance > 0.0 else None


def no_cost_because(work: float | None, distance: float | None, supplier: str) -> str:
    """Return why there is no cost of transport; `supplier` says where the energy comes from if the work is negative."""
    if work is not None and work < 0:
        return f"the net work of the contraction is negative ({work:.4g} J): {supplier}"
    if distance is not None and distance <= 0:
        return f"the worm did not move forward ({distance:.4g} m)"
    return "the worm has no weight, or its state overflowed"
