"""Turn and drift against the phase of the bending wave: where a wave turns the worm, and where it only shuffles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

import worm3d
from control.gaits.steering import MECHANISMS, GaitParameters, Mechanism, Schedule, SteeredWave
from scenes.commands.identify.runs import Steady, steady
from scenes.commands.identify.study import AMPLITUDE, PERIOD, SKIPPED, WAVES

STEERING: dict[Mechanism, float] = {"hinge": 0.06, "bias": 0.04}
PHASES_DEG = tuple(range(0, 180, 15))
"""Half a turn of them: the other half is the mirror image."""


@dataclass(frozen=True)
class Phases:
    """One bending wave with all phases ahead of the contraction."""

    mechanism: Mechanism
    steering_wavelength: float
    """Wavelength of the bending wave [body lengths]."""
    phase_deg: tuple[float, ...]
    """Phases at the wave's frequency [deg]."""
    turn_deg: tuple[float, ...]
    """Turn [deg a wave]."""
    drift_bl: tuple[float, ...]
    """Drift to the left [body lengths a wave]."""
    chosen_deg: float
    """Phase of the schedule [deg]."""

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return asdict(self)


def study(
    worm: worm3d.Worm, ground: worm3d.Friction, schedule: Schedule, watch: Callable[[int], None] = lambda done: None
) -> tuple[Phases, ...]:
    """Run every phase with the schedule's bending wave and with one as long as its contraction wave."""
    found: list[Phases] = []
    for mechanism in MECHANISMS:
        for wavelength in (schedule.steering_wavelength, schedule.wavelength):
            found.append(_phases(worm, ground, replace(schedule, steering_wavelength=wavelength), mechanism))
            watch(len(found))
    return tuple(found)


COUNT = 2 * len(MECHANISMS)
"""How many there are."""


def _phases(worm: worm3d.Worm, ground: worm3d.Friction, schedule: Schedule, mechanism: Mechanism) -> Phases:
    parameters = GaitParameters(AMPLITUDE, 1.0 / PERIOD).steered(mechanism, STEERING[mechanism])
    name, ahead = f"{mechanism}_phase", 2.0 * np.pi * schedule.lead / PERIOD
    turned: list[dict[str, Any]] = [{name: float(np.deg2rad(phase)) - ahead} for phase in PHASES_DEG]
    runs = steady(worm, ground, [SteeredWave(parameters, replace(schedule, **t)) for t in turned], WAVES, SKIPPED)
    turn, drift = _both_halves([_motion(run) for run in runs])
    chosen = float(np.rad2deg(getattr(schedule, name) + ahead))
    phase = tuple(float(p + half) for half in (0, 180) for p in PHASES_DEG)
    return Phases(mechanism, schedule.steering_wavelength, phase, turn, drift, chosen)


def _motion(run: Steady) -> tuple[float, float]:
    """Return turn [deg] and drift a wave; NaN for a worm that tipped."""
    if run.motion is None or run.tipped:
        return float("nan"), float("nan")
    return float(np.rad2deg(run.motion.turn)), run.motion.drift


def _both_halves(motions: list[tuple[float, float]]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    turn, drift = np.array(motions).T
    return tuple(map(float, [*turn, *-turn])), tuple(map(float, [*drift, *-drift]))
