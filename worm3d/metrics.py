"""Metrics of a run, as NOTATION.md defines them; its worm's heading, way and roll."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from worm3d.series import heading
from worm3d.values.arrays import FloatArray

if TYPE_CHECKING:
    from worm3d.result import Result
    from worm3d.worlds import World


NO_HEADING = "the body is vertical at the start: it has no heading"
SPARSE = "the rows of the result lie further apart than a period of the gait: record more of them"
SHORT_RUN = "the run is shorter than one period of the gait, over which the centre of mass is averaged"
NO_PERIOD = "the actuation has no `period` [s] over which the centre of mass could be averaged"
NOT_SETTLED = (
    "the worm was not brought to rest before the run: it touched nothing, moved, went on from an earlier run, or was "
    "to start as it was"
)
NO_STEP = "no step was finished"
NO_WAY = 1e-9
"""Distance that counts as rounding, as a fraction of the body length."""

ON_ITS_SIDE = float(np.deg2rad(35.0))
"""Roll from which a worm lies on its side [rad]; lying there the default worm has 45 degrees. Crawling it has at most 5
on the level and on slopes, 20 in the bend of a pipe, and for moments 18 on rubble and 30 in a tunnel."""

LASTING = 0.5
"""Time for which it has to, so that it does not merely rock [s]."""

GROUND = 0.5
"""Least cosine between a normal and up for which what is below is a ground: a pipe's wall beside the worm is none."""


def way(com: FloatArray, joints: FloatArray, world: World | None) -> FloatArray | None:
    """Return how far forward each centre of mass (T, 3) is, shape (T,) [m]; None for a vertical body.

    Forward is the heading of the joints (N+1, 3) in the world's tangent plane; in a pipe it is along the centre line,
    counted towards the head.
    """
    course = None if world is None else world.course(com, joints)
    if course is not None:
        return course
    azimuth = heading(joints[None])[0]
    if np.isnan(azimuth):
        return None
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    forward: FloatArray = level / np.linalg.norm(level) if world is None else world.forward(joints, level)
    return com @ forward


def distance(com: FloatArray, joints: FloatArray, world: World | None) -> float:
    """Return how far the centre of mass has come from the start, as `way` counts it [m]; NaN for a vertical body."""
    ends = way(com[[0, -1]], joints, world)
    return float("nan") if ends is None else float(ends[-1] - ends[0])


def averaged(com: FloatArray, window: int) -> FloatArray:
    """Return the mean of the centre of mass over `window` samples, shape (T - window + 1, 3) [m]."""
    total = np.cumsum(np.vstack([np.zeros((1, com.shape[1])), com]), axis=0)
    mean: FloatArray = (total[window:] - total[:-window]) / window
    return mean


def path_length(com: FloatArray, time: FloatArray, period: float) -> float:
    """Return the length of the path of the centre of mass, averaged over a period about each instant [m].

    A wave rocks the centre of mass; a mean over a period takes that out. From the first place to the mean over the
    first period, and from that over the last one to the last place, it is straight: nothing of the way is lost, and a
    shorter mean would rock. Between the instants the centre of mass moves on straight lines. A run shorter than a
    period has one mean, over all of it.

    Parameters
    ----------
    com : ndarray, shape (T, D)
        Centre of mass [m].
    time : ndarray, shape (T,)
        Ascending [s].
    period : float
        Time to average over [s].
    """
    if len(time) < 2:
        return 0.0
    half = 0.5 * min(period, float(time[-1] - time[0]))
    inner = time[(time > time[0] + half) & (time < time[-1] - half)]
    middle = np.concatenate([time[:1] + half, inner, time[-1:] - half])
    swept = (_integrals(com, time, middle + half) - _integrals(com, time, middle - half)) / (2.0 * half)
    path = np.vstack([com[:1], swept, com[-1:]])
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _integrals(values: FloatArray, time: FloatArray, t: FloatArray) -> FloatArray:
    """Return integrals from time[0] to each t, (K,), of straight lines through values, (T, D), at times, (K, D)."""
    step = np.diff(time)[:, None]
    up_to = np.vstack([np.zeros(values.shape[1]), np.cumsum(0.5 * step * (values[1:] + values[:-1]), axis=0)])
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(step) - 1)
    since = (t - time[k])[:, None]
    area: FloatArray = up_to[k] + since * (values[k] + 0.5 * since / step[k] * (values[k + 1] - values[k]))
    return area


def _along_the_ground(result: Result) -> FloatArray:
    """Return the centre of mass without its height over a plane: a worm that rises on its feet makes no way."""
    if result.world is None or not result.world.flat:
        return result.com
    normal = result.world.normal(result.joints[0].mean(axis=0), result.worm.length)
    return result.com - (result.com @ normal)[:, None] * normal


def _window(result: Result) -> int | None:
    if result.period is None or len(result.time) < 2:
        return None
    window = round(result.period / float(result.time[1] - result.time[0]))
    return window if 1 <= window < len(result.time) else None


def roll(result: Result, rows: slice = slice(None)) -> FloatArray:
    """Return by how much a worm is rolled to its left, the median of its segments, at rows of a result, (T,) [rad].

    NaN where it touches nothing, and where what it touches is no ground: a wall, or without gravity.
    """
    joints, directors = result.joints[rows], result.directors[rows]
    rolls, weight = np.full(len(joints), np.nan), float(np.linalg.norm(result.gravity))
    if result.world is None or weight == 0.0:
        return rolls
    middle = (joints[:, 1:] + joints[:, :-1]) / 2.0
    normal = _normals(result.world, middle, result.worm.length)
    load = result.normal_load[rows].sum(axis=(1, 2)) + result.joint_load[rows].sum(axis=1)
    seen = (load > 0.0) & (normal @ (-result.gravity / weight) > GROUND).all(axis=1)
    sine = (directors[seen] * normal[seen]).sum(axis=-1)
    rolls[seen] = -np.median(np.arcsin(np.clip(sine, -1.0, 1.0)), axis=1)
    return rolls


def on_its_side(result: Result) -> float | None:
    """Return the first time from which a worm lies on its side for half a second [s]; None if it never does."""
    if len(result.time) < 2:
        return None
    apart = float(result.time[1] - result.time[0])
    rows = slice(None, None, max(1, int(LASTING / (5.0 * apart))))
    time, lies = result.time[rows], np.abs(np.nan_to_num(roll(result, rows))) > ON_ITS_SIDE
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lies.astype(int), [0]])))
    for begin, end in edges.reshape(-1, 2):
        if time[end - 1] - time[begin] >= LASTING * (1.0 - 1e-9):
            return float(time[begin])
    return None


def _normals(world: World, places: FloatArray, length: float) -> FloatArray:
    """Return unit normals of the world at places (..., 3); zeros where there is none."""
    gradient = world.normal(places, length)
    size = np.linalg.norm(gradient, axis=-1, keepdims=True)
    known = np.isfinite(size) & (size > 0.5)
    normals: FloatArray = np.where(known, gradient / np.where(known, size, 1.0), 0.0)
    return normals


UNITS = {
    **{f"_{unit}": unit for unit in ("m", "s", "ms", "deg", "J", "N", "kg")},
    "_m_s": "m/s",
    "_J_per_m": "J/m",
    "_BL_per_period": "BL/period",
    "_bl": "BL",
}
"""Unit of a metric by the ending of its name, of which the longest counts; BL is a body length."""


ROUNDING = {"deg": 1e-9, "rad": 1e-11, "m": 1e-12, "m/s": 1e-12}
"""Magnitude below which a metric is rounding and written as 0, by its unit."""


def written(value: float, unit: str, digits: int = 6) -> str:
    """Return a metric as text, without its unit."""
    return f"{0.0 if abs(value) < ROUNDING.get(unit, 0.0) else value:.{digits}g}"


def named(metric: str) -> tuple[str, str]:
    """Return the name of a metric in words, and its unit: `mean_speed_m_s` is ("mean speed", "m/s")."""
    ending = max((ending for ending in UNITS if metric.endswith(ending)), key=len, default="")
    return metric.removesuffix(ending).replace("_", " "), UNITS.get(ending, "")


class Summary(dict[str, float | str | None]):
    """Metrics by name; printed as a table with units."""

    def __repr__(self) -> str:
        rows = (self.row(name) for name in self)
        return "\n".join(f"{name:<34}{shown:>12} {unit}".rstrip() for name, shown, unit in rows)

    def row(self, name: str, digits: int = 6) -> tuple[str, str, str]:
        """Return a metric as name, value and unit to print."""
        value, (words, unit) = self[name], named(name)
        shown = "-" if value is None else value if isinstance(value, str) else written(value, unit, digits)
        return words, shown, unit


Metric = tuple[float | str | None, str]
"""A metric, and why it has no value if it is None."""


def metrics_of(result: Result) -> dict[str, Metric]:
    """Return the metrics of a run by name."""
    energy, uses, made = result.energy, result.energy.uses, result.distance
    work, weight = float(energy.work_contract.sum()), result.worm.mass * float(np.linalg.norm(result.gravity))
    dragged, steps = float(energy.drag_loss.sum()), len(result.newton_iterations)
    cost, no_cost = _cost(work, weight, made, result)
    turned = float(np.rad2deg(result.heading[-1] - result.heading[0]))
    factor = steps * result.dt / result.wall_s if steps and result.wall_s > 0.0 else None
    known: dict[str, float | str] = {
        "work_contract_positive_J": float(energy.work_contract_positive.sum()),
        "work_contract_p11_J": float(energy.work_contract_p11.sum()),
        "work_friction_p13_J": float(energy.work_friction_p13.sum()),
        "halved_steps": float(result.halved_steps),
        "work_external_J": float(energy.work_external.sum()),
        **{f"work_{name}_J": joules for name, joules in uses.items()},
        "work_damping_medium_J": dragged,
        "work_damping_material_J": uses["damping"] - dragged,
    }
    return {
        "status": (result.status.name.lower(), ""),
        "duration_s": (float(result.time[-1] - result.time[0]), ""),
        "distance_m": (None if np.isnan(made) else made, NO_HEADING),
        "path_length_m": _path_length(result),
        "mean_speed_m_s": _mean_speed(result),
        "heading_change_deg": (None if np.isnan(turned) else turned, "the body is vertical: it has no heading"),
        "work_contract_J": (work, ""),
        "work_friction_J": (uses["friction"], ""),
        "cost_of_transport": (cost, no_cost),
        "energy_balance_error": (energy.balance_error, ""),
        "newton_iterations_mean": (float(result.newton_iterations.mean()) if steps else None, NO_STEP),
        "real_time_factor": (factor, NO_STEP),
        **{name: (value, "") for name, value in known.items()},
        **{
            f"cost_of_transport_{name}": (None if cost is None else joules / (weight * made), no_cost)
            for name, joules in uses.items()
        },
        "settling_m": (result.settling, NOT_SETTLED),
    }


def _path_length(result: Result) -> Metric:
    if result.period is None or _sparse(result):
        return None, _no_mean(result)
    return path_length(_along_the_ground(result), result.time, result.period), ""


def _mean_speed(result: Result) -> Metric:
    window = _window(result)
    if window is None:
        return None, _no_mean(result)
    ends = way(averaged(result.com, window)[[0, -1]], result.joints[0], result.world)
    elapsed = float(result.time[-1] - result.time[window - 1])
    return None if ends is None else float(ends[-1] - ends[0]) / elapsed, NO_HEADING


def _cost(work: float, weight: float, way: float, result: Result) -> Metric:
    if work < -_rounding(result):
        return None, f"the net work of the contraction is negative ({work:.4g} J): the worm drove its actuators"
    if way <= NO_WAY * result.worm.length:
        return None, f"the worm made no way forward ({way:.4g} m)"
    if weight == 0.0 or np.isnan(way):
        return None, "the worm has no weight, or no heading at the start"
    return max(0.0, work) / (weight * way), ""


def _no_mean(result: Result) -> str:
    if result.period is None:
        return NO_PERIOD
    return SPARSE if _sparse(result) else SHORT_RUN


def _sparse(result: Result) -> bool:
    return len(result.time) > 1 and bool(result.time[1] - result.time[0] > 2.0 * (result.period or np.inf))


def _rounding(result: Result) -> float:
    """Return the work that may be rounding alone [J]."""
    stored = float(np.sum(result.worm.k_spring)) * result.worm.l0  # the scale of the springs' energy
    return 1e-12 * float(np.abs(result.energy.work_contract).sum()) + 1e-15 * stored
