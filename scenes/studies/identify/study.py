"""Runs that measure the effect of steering on a simulated worm.

Curves give turn, speed, slip and roll over the steering. Runs over the phase give turn and drift over the phase between
the wave that bends the worm and the wave of contraction. A schedule (`control.gaits.steering.Schedule`) sets the form
of both waves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any

import numpy as np

import worm3d
from control.gaits import TravellingWave
from control.gaits.steering import GaitParameters, Mechanism, Schedule, SteeredWave
from control.identification.identified import Motion
from scenes.models.control.identify import Gait, Steady, Subject, steady

WAVE_AMPLITUDE, WAVE_PERIOD_S = 0.3, 1.25
"""Amplitude, at most the stroke, and period [s] of all waves."""
WAVES = (9, 5)
"""Number of waves of a run, and number of its first waves, which are left out because they are not steady."""
CURVE_STEERINGS: dict[Mechanism, tuple[float, ...]] = {
    "hinge": (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.2, 0.25, 0.3),
    "bias": (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3),
}
"""Tested values of the steering of each mechanism: hinge angle [rad] or bias, to the left. Steering to the
right gives the mirror image."""
YAW_FACTORS = {"soft yaw joints (k_yaw / 10)": 0.1, "its own yaw joints": 1.0, "stiff yaw joints (k_yaw x 10)": 10.0}
"""Factors of the stiffness of the yaw joints, by the name of the curve."""
IN_STEP = "the default wave, bent in step with its contraction"
CURVES = len(CURVE_STEERINGS) * (1 + len(YAW_FACTORS))
"""Number of curves: for each mechanism one in step with the contraction, and one for each factor."""
GOAL_DEG = 10.0
"""Speeds are compared at this turn per wave [deg]."""

STEERING: dict[Mechanism, float] = {"hinge": 0.06, "bias": 0.04}
"""Steering in the runs over the phase."""
PHASES_DEG = tuple(range(0, 180, 15))
"""Phases in the first half of the circle [deg]. The second half gives the mirror image."""
PHASE_STUDIES = 2 * len(CURVE_STEERINGS)
"""Number of bending waves in the runs over the phase."""


@dataclass(frozen=True)
class Point:
    """Result of one run."""

    steering: float
    turn_deg: float
    """Turn to the left [deg per wave]."""
    speed_bl_s: float
    """Speed [body lengths/s]."""
    drift_bl_s: float
    """Sideways speed to the left [body lengths/s]."""
    slip_bl: float
    """Slip of all feet [body lengths per wave]."""
    roll_deg: float
    """Roll angle [deg]."""
    tipped: bool
    """Whether the worm tips over."""


@dataclass(frozen=True)
class Curve:
    """Runs of one worm with increasing steering."""

    mechanism: Mechanism
    name: str
    points: tuple[Point, ...]
    """Results of the runs; the first run has no steering."""

    @property
    def standing(self) -> tuple[Point, ...]:
        """The points before the first point where the worm tips over."""
        return tuple(takewhile(lambda point: not point.tipped, self.points))

    @property
    def useful(self) -> tuple[Point, ...]:
        """The first points of the curve, up to the point where the worm tips over or the turn stops increasing."""
        found = [self.points[0]]
        for point in self.points[1:]:
            if point.tipped or not point.turn_deg > found[-1].turn_deg:
                break
            found.append(point)
        return tuple(found)

    @property
    def speed_kept(self) -> float | None:
        """Speed at a turn of `GOAL_DEG`, as a fraction of the speed without steering; None if it is not reached."""
        points = self.useful
        if points[-1].turn_deg < GOAL_DEG:
            return None
        speed = np.interp(GOAL_DEG, [p.turn_deg for p in points], [p.speed_bl_s for p in points])
        return float(speed) / points[0].speed_bl_s


@dataclass(frozen=True)
class Phases:
    """Turn and drift of one bending wave over its phase lead before the contraction."""

    mechanism: Mechanism
    steering_wavelength: float
    """Wavelength of the bending wave [body lengths]."""
    phase_deg: tuple[float, ...]
    """Phase leads [deg]."""
    turn_deg: tuple[float, ...]
    """Turn [deg a wave]."""
    drift_bl: tuple[float, ...]
    """Drift to the left [body lengths a wave]."""
    chosen_deg: float
    """Phase lead that the schedule uses [deg]."""


def curves(subject: Subject, watch: Callable[[int], None] = lambda done: None) -> tuple[Curve, ...]:
    """Run all curves; `watch` is called with the number of finished curves."""
    found: list[Curve] = []
    for mechanism, name, body, gaits in _plans(subject.worm, subject.schedule):
        runs = zip(CURVE_STEERINGS[mechanism], gaits, strict=True)
        points = tuple(_point(s, steady(body, subject.ground, gait, *WAVES)) for s, gait in runs)
        found.append(Curve(mechanism, name, points))
        watch(len(found))
    return tuple(found)


def _plans(worm: worm3d.Worm, schedule: Schedule) -> Iterator[tuple[Mechanism, str, worm3d.Worm, list[Gait]]]:
    for mechanism in CURVE_STEERINGS:
        steerings = CURVE_STEERINGS[mechanism]
        wave = TravellingWave(amplitude=min(WAVE_AMPLITUDE, worm.stroke[1]), period=WAVE_PERIOD_S)
        yield mechanism, IN_STEP, worm, [replace(wave, **{mechanism: s}) for s in steerings]  # type: ignore[arg-type]
        straight = GaitParameters(wave.amplitude, 1.0 / WAVE_PERIOD_S)
        steered: list[Gait] = [SteeredWave(straight.steered(mechanism, s), schedule) for s in steerings]
        for name, factor in YAW_FACTORS.items():
            yield mechanism, name, replace(worm, k_yaw=np.asarray(worm.k_yaw) * factor), steered


def _point(steering: float, found: Steady) -> Point:
    nothing = float("nan")
    motion = found.motion or Motion(nothing, nothing, nothing)
    return Point(
        steering,
        turn_deg=float(np.rad2deg(motion.turn)),
        speed_bl_s=motion.distance / WAVE_PERIOD_S,
        drift_bl_s=motion.drift / WAVE_PERIOD_S,
        slip_bl=found.slip,
        roll_deg=float(np.rad2deg(found.roll)),
        tipped=found.tipped,
    )


def phases(subject: Subject, watch: Callable[[int], None] = lambda done: None) -> tuple[Phases, ...]:
    """Run all phases for two bending waves: with the schedule's wavelength, and with that of the contraction.

    `watch` is called with the number of finished bending waves.
    """
    found: list[Phases] = []
    worm, ground, schedule = subject
    for mechanism in CURVE_STEERINGS:
        for wavelength in (schedule.steering_wavelength, schedule.wavelength):
            found.append(_phases(worm, ground, replace(schedule, steering_wavelength=wavelength), mechanism))
            watch(len(found))
    return tuple(found)


def _phases(worm: worm3d.Worm, ground: worm3d.Friction, schedule: Schedule, mechanism: Mechanism) -> Phases:
    straight = GaitParameters(min(WAVE_AMPLITUDE, worm.stroke[1]), 1.0 / WAVE_PERIOD_S)
    parameters = straight.steered(mechanism, STEERING[mechanism])
    name, ahead = f"{mechanism}_phase", 2.0 * np.pi * schedule.lead / WAVE_PERIOD_S
    turned: list[dict[str, Any]] = [{name: float(np.deg2rad(phase)) - ahead} for phase in PHASES_DEG]
    waves = [SteeredWave(parameters, replace(schedule, **phase)) for phase in turned]
    runs = [steady(worm, ground, wave, *WAVES) for wave in waves]
    stood = [None if run.tipped else run.motion for run in runs]
    motions = [(np.nan, np.nan) if each is None else (np.rad2deg(each.turn), each.drift) for each in stood]
    turn, drift = np.array(motions).T
    return Phases(
        mechanism,
        schedule.steering_wavelength,
        phase_deg=tuple(float(phase + half) for half in (0, 180) for phase in PHASES_DEG),
        turn_deg=tuple(map(float, [*turn, *-turn])),
        drift_bl=tuple(map(float, [*drift, *-drift])),
        chosen_deg=float(np.rad2deg(getattr(schedule, name) + ahead)),
    )
