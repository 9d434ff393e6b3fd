"""Path, predicted path, obstacles and desired speed of a run with a controller, for pages and films."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from scenes.models.base import Rows
from scenes.models.control.schema import ControlScene
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray
from worm3d.values.named import is_own

if TYPE_CHECKING:
    from control.loop import Decision
    from control.tracking.paths import Path
    from control.tracking.references import Reference
    from worm3d.running.live import Horizon


def beside(scene: ControlScene, record: Record, rows: Rows) -> dict[str, Any]:
    """Return what is drawn in addition to the worm, as arguments of `worm3d.results.pictures.arrays`.

    These are the period, the desired path, the obstacles, and, at the stored instants `rows`, the predicted path and
    the desired speed. Arguments that a run does not have are left out.
    """
    from scenes.models.control.record import path_points
    from scenes.models.control.reference import speed_of  # imports the solvers

    lines: dict[str, Any] = {
        "period": period(record),
        "reference_speed": np.asarray(speed_of(scene.reference)(record["time"][rows])),
    }
    path = path_seen(record, scene)
    if path is not None:
        lines["reference"] = _raised(path_points(path, record["com"][:, :2]), record, scene)
        obstacles = reference_seen(record, scene).obstacles
        lines["obstacles"] = [_raised(each.outline(), record, scene) for each in obstacles]
    if "horizon" in record:
        lines["horizon"] = _raised(_horizons(record)[rows], record, scene)
    return lines


def path_seen(record: Record, scene: ControlScene) -> Path | None:
    """Return the path of a stored run, or None without a path.

    A user's own path is read from the record, so that the user's module is not imported.
    """
    from scenes.models.control.record import stored_path
    from scenes.models.control.reference import path_of

    return stored_path(record) if is_own(scene.reference.kind) else path_of(scene)


def reference_seen(record: Record, scene: ControlScene) -> Reference:
    """Return the task of the worm in a stored run, with the path of `path_seen`."""
    from scenes.models.control.reference import reference_along

    return reference_along(scene, path_seen(record, scene))


def period(record: Record) -> float | None:
    """Return the mean commanded period of the gait [s], or None if the controller commanded no wave."""
    waves = float(record["waves"][-1] - record["waves"][0])
    return float(record["time"][-1] - record["time"][0]) / waves if waves > 0.0 else None


def _horizons(record: Record) -> FloatArray:
    """Return, for each stored instant, the path that the latest decision predicted.

    If the decision has no prediction, all points of the path are the position of the worm.
    """
    ways, time = record["horizon"], record["time"]
    latest = np.clip(np.searchsorted(record["decision_time"], time + 1e-9) - 1, 0, len(ways) - 1)
    at = ways[latest]
    here = np.broadcast_to(record["com"][:, None, :2], at.shape)
    return np.where(np.isfinite(at), at, here)


def horizon_of(decisions: Callable[[], Sequence[Decision]], scene: ControlScene) -> Horizon:
    """Return a function that returns the latest predicted path of a live run, at the given time [s].

    The function returns None if the latest decision has no prediction. `decisions` returns all decisions so far.
    """

    def horizon(time: float, com: FloatArray) -> FloatArray | None:
        latest = next((each for each in reversed(decisions()) if each.time <= time + 1e-9), None)
        way = None if latest is None else latest.horizon
        return None if way is None or not np.isfinite(way).all() else in_space(way, float(com[2]), scene)

    return horizon


def _raised(places: FloatArray, record: Record, scene: ControlScene) -> FloatArray:
    return in_space(places, float(record["com"][:, 2].mean()), scene)


def in_space(places: FloatArray, height: float, scene: ControlScene) -> FloatArray:
    """Return points of the plan view, shape (..., 2) [m], as points in space, shape (..., 3) [m].

    In a world with a plane, the points are 4 mm above the plane. In other worlds they are at the given height.
    """
    world = scene.world
    if world.kind != "plane":
        heights = np.full(places.shape[:-1], height)
    else:
        azimuth = math.radians(world.heading_deg)
        ascent = places @ np.array([math.cos(azimuth), math.sin(azimuth)])
        heights = 0.004 + math.tan(math.radians(world.slope_deg)) * ascent
    return np.concatenate([places, heights[..., None]], axis=-1)
