"""What schedules do on the plant: turn, speed, slip and roll over the steering, with soft and stiff yaw joints."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import takewhile
from typing import Any

import numpy as np

import worm3d
from control.gaits import TravellingWave
from control.gaits.steering import MECHANISMS, GaitParameters, Mechanism, Schedule, SteeredWave
from control.identification.identified import Motion
from scenes.commands.identify.runs import Steady, steady

AMPLITUDE, PERIOD = 0.3, 1.25
"""Of all waves; period in s."""
WAVES, SKIPPED = 9, 5
STEERINGS: dict[Mechanism, tuple[float, ...]] = {
    "hinge": (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.2, 0.25, 0.3),
    "bias": (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3),
}
"""To the left; to the right is the mirror image."""
YAW_FACTORS = {"soft yaw joints (k_yaw / 10)": 0.1, "its own yaw joints": 1.0, "stiff yaw joints (k_yaw x 10)": 10.0}
IN_STEP = "the default wave, bent in step with its contraction"
GOAL_DEG = 10.0
"""A wave; what a schedule should reach."""

Gait = SteeredWave | TravellingWave


@dataclass(frozen=True)
class Point:
    """One run: steering, and what a wave does."""

    steering: float
    turn_deg: float
    speed_bl_s: float
    drift_bl_s: float
    slip_bl: float
    roll_deg: float
    tipped: bool


@dataclass(frozen=True)
class Curve:
    """One schedule on one worm."""

    mechanism: Mechanism
    name: str
    points: tuple[Point, ...]
    """Runs in the order of the steering."""

    @property
    def standing(self) -> tuple[Point, ...]:
        """The points from no steering on as long as the worm stands on its feet."""
        return tuple(takewhile(lambda point: not point.tipped, self.points))

    @property
    def useful(self) -> tuple[Point, ...]:
        """The points from no steering on as long as the worm stands on its feet and turns more and more to the left."""
        found = [self.points[0]]
        for point in self.points[1:]:
            if point.tipped or not point.turn_deg > found[-1].turn_deg:
                break
            found.append(point)
        return tuple(found)

    @property
    def speed_kept(self) -> float | None:
        """Share of the straight worm's speed at `GOAL_DEG` a wave; None if that is not reached."""
        points = self.useful
        if points[-1].turn_deg < GOAL_DEG:
            return None
        speed = np.interp(GOAL_DEG, [p.turn_deg for p in points], [p.speed_bl_s for p in points])
        return float(speed) / points[0].speed_bl_s

    def as_dict(self) -> dict[str, Any]:
        """Return the curve as JSON can hold it."""
        return {"mechanism": self.mechanism, "name": self.name, "points": [asdict(point) for point in self.points]}


def study(
    worm: worm3d.Worm, ground: worm3d.Friction, schedule: Schedule, watch: Callable[[int], None] = lambda done: None
) -> tuple[Curve, ...]:
    """Run all curves; `watch` is called with the number of finished ones."""
    curves = []
    for mechanism, name, body, gaits in _plans(worm, schedule):
        points = zip(STEERINGS[mechanism], steady(body, ground, gaits, WAVES, SKIPPED), strict=True)
        curves.append(Curve(mechanism, name, tuple(_point(s, found) for s, found in points)))
        watch(len(curves))
    return tuple(curves)


CURVES = len(MECHANISMS) * (1 + len(YAW_FACTORS))
"""How many there are."""


def _plans(worm: worm3d.Worm, schedule: Schedule) -> Iterator[tuple[Mechanism, str, worm3d.Worm, list[Gait]]]:
    for mechanism in MECHANISMS:
        steerings = STEERINGS[mechanism]
        wave = TravellingWave(amplitude=AMPLITUDE, period=PERIOD)
        yield mechanism, IN_STEP, worm, [replace(wave, **{mechanism: s}) for s in steerings]  # type: ignore[arg-type]
        straight = GaitParameters(AMPLITUDE, 1.0 / PERIOD)
        steered: list[Gait] = [SteeredWave(straight.steered(mechanism, s), schedule) for s in steerings]
        for name, factor in YAW_FACTORS.items():
            yield mechanism, name, replace(worm, k_yaw=np.asarray(worm.k_yaw) * factor), steered


def _point(steering: float, found: Steady) -> Point:
    nothing = float("nan")
    motion = found.motion or Motion(nothing, nothing, nothing)
    return Point(
        steering,
        turn_deg=float(np.rad2deg(motion.turn)),
        speed_bl_s=motion.distance / PERIOD,
        drift_bl_s=motion.drift / PERIOD,
        slip_bl=found.slip,
        roll_deg=float(np.rad2deg(found.roll)),
        tipped=found.tipped,
    )
