"""Short runs of the plant: steady waves, and steps of the gait parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import worm3d
from control.gaits import TravellingWave
from control.gaits.steering import BLEND, GaitParameters, Mechanism, PlannedWave, Schedule, SteeredWave, WaveGenerator
from control.identification.identified import Lags, Motion, Sample, lag, steady_motion
from worm3d.values.arrays import FloatArray

DT = 0.01
"""Time step of the runs, that of the closed loop [s]."""
TIPPED = np.deg2rad(20.0)
"""Mean roll of the segments beyond which a worm no longer stands on its feet: at rest it tips at 31 degrees."""
BEFORE, AFTER = 8, 8
"""Waves before and after a step of the parameters."""
SHIFTS = (0.0, 1.0 / 3.0, 2.0 / 3.0)
"""Parts of a wave at which the steps come: what follows depends on which feet stand just then."""
FREQUENCY = 0.875
"""Of the wave whose steps give the lags, in the middle of the map [Hz]."""

LEAST_LAG = 0.1
"""Of the steering beyond that of the generator [s]; shorter ones make no difference over a wave."""
WINDING = 0.1
"""Frequency of the sines of the steering that give its lag [Hz]."""
WINDING_WAVES = (0.6, 0.9, 1.1)
"""Frequencies of the waves that wind so [Hz]."""


@dataclass(frozen=True)
class Steady:
    """What a steady wave does."""

    motion: Motion | None
    """Motion a wave; None where the run did not end, or has no heading."""
    slip: float
    """Way that the feet slide a wave, summed over them [body lengths]."""
    roll: float
    """Greatest mean roll of the segments [rad]."""

    @property
    def tipped(self) -> bool:
        """Whether the worm does not stand on its feet."""
        return self.motion is None or not self.roll <= TIPPED


def steady(
    worm: worm3d.Worm,
    ground: worm3d.Friction,
    gaits: Sequence[SteeredWave | TravellingWave],
    waves: int,
    skipped: int,
) -> list[Steady]:
    """Run waves of constant parameters on level ground, and measure those after the first `skipped`."""
    return [_steady(worm, ground, gait, waves, skipped) for gait in gaits]


def _steady(
    worm: worm3d.Worm, ground: worm3d.Friction, gait: SteeredWave | TravellingWave, waves: int, skipped: int
) -> Steady:
    rows = round(gait.period / DT)
    run = worm3d.simulate(worm, worm3d.Plane(), ground, actuation=gait, duration=waves * rows * DT, dt=DT)
    if run.status is not worm3d.Status.DONE:
        return Steady(None, float("nan"), float("nan"))
    first = skipped * rows + 1
    motion = steady_motion(run.com, run.heading, rows, skipped, worm.length)
    roll = float(np.abs(np.arcsin(np.clip(run.directors[first:, :, 2], -1.0, 1.0)).mean(axis=1)).max())
    return Steady(motion, float(run.slip[first:].sum()) / (waves - skipped) / worm.length, roll)


def samples(found: Sequence[Steady], parameters: Sequence[GaitParameters]) -> list[Sample] | None:
    """Return the motions with their parameters; None if the worm tipped in one of the runs."""
    pairs = [(given, each.motion) for given, each in zip(parameters, found, strict=True) if not each.tipped]
    if len(pairs) < len(found):
        return None
    return [Sample(given, motion) for given, motion in pairs if motion is not None]


def measure_lags(
    worm: worm3d.Worm, ground: worm3d.Friction, schedule: Schedule, mechanism: Mechanism, steering: float
) -> Lags:
    """Measure how long speed and turn rate lag behind a step of the gait parameters.

    Parameters
    ----------
    worm : worm3d.Worm
    ground : worm3d.Friction
    schedule : Schedule
    mechanism : str
    steering : float
        The amplitude of the sines that it winds by.
    """
    slow, long = GaitParameters(0.2, FREQUENCY), GaitParameters(0.3, FREQUENCY)
    quick = GaitParameters(0.3, 1.2 * FREQUENCY)
    winding = [winding_lag(worm, ground, schedule, mechanism, steering, frequency) for frequency in WINDING_WAVES]

    def mean_lag(begin: GaitParameters, end: GaitParameters, quantity: int) -> float:
        rates = [step_response(worm, ground, schedule, begin, end, shift)[quantity] for shift in SHIFTS]
        # From mean to mean of two waves: the first rate after the step stands for half a wave before it.
        return float(np.mean([lag(each, BEFORE - 1) - 0.5 for each in rates]))

    return Lags(
        amplitude=mean_lag(slow, long, 0),
        frequency=mean_lag(long, quick, 0),
        steering=max(float(np.mean(winding)), LEAST_LAG),
    )


def winding_lag(
    worm: worm3d.Worm,
    ground: worm3d.Friction,
    schedule: Schedule,
    mechanism: Mechanism,
    steering: float,
    frequency: float,
) -> float:
    """Return the time constant T [s] by which the turn rate follows a sine of the steering in force, from its phase.

    A first-order response lags behind a sine of w rad/s by arctan(w T), the steering in force likewise behind that
    asked for with T = blend/f; the heading is the integral of the turn rate.
    """
    w = 2.0 * np.pi * WINDING
    wave, generator = GaitParameters(0.28, frequency), WaveGenerator(schedule, worm)
    plan = PlannedWave(lambda t: wave.steered(mechanism, steering * float(np.sin(w * t))), generator)
    run = worm3d.simulate(worm, worm3d.Plane(), ground, actuation=plan, duration=3.0 / WINDING, dt=DT)
    late = run.time >= 1.0 / WINDING  # two windings
    t, h = run.time[late][:-1], run.heading[late][:-1]
    waves = np.column_stack([np.sin(w * t), np.cos(w * t), np.ones_like(t), t])
    (sine, cosine, _, _), *_ = np.linalg.lstsq(waves, h, rcond=None)
    behind = np.arctan2(-sine, -cosine) - np.arctan(w * BLEND / frequency)  # the heading is -cos(w t - behind)
    return float(np.tan(behind) / w)


def step_response(
    worm: worm3d.Worm,
    ground: worm3d.Friction,
    schedule: Schedule,
    begin: GaitParameters,
    end: GaitParameters,
    shift: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return speed [m/s] and turn rate [rad/s] from wave to wave, around a step of the parameters.

    The step comes after `BEFORE` waves and the part `shift` of one, and waves are counted from there. Place and heading
    are averaged over each, since a step changes by how much a wave rocks them; rate k is from wave k to wave k + 1, so
    that number `BEFORE` - 1 spans the step.
    """
    generator = WaveGenerator(schedule, worm)
    phases: list[float] = []

    def plan(t: float) -> GaitParameters:
        phases.append(generator.waves)
        return begin if generator.waves < BEFORE + shift else end

    duration = (BEFORE + shift) / begin.frequency + (AFTER + 1) / end.frequency
    steps = round(duration / DT)
    run = worm3d.simulate(
        worm, worm3d.Plane(), ground, actuation=PlannedWave(plan, generator), duration=steps * DT, dt=DT
    )
    return _wave_rates(run, np.array(phases), shift)


def _wave_rates(run: worm3d.Result, phases: FloatArray, shift: float) -> tuple[FloatArray, FloatArray]:
    # A command given at the beginning of a step is in force at its end: entry k is the phase of row k's shape.
    times, waves = run.time[1 : len(phases)], phases[1:]
    ends = np.interp(np.arange(BEFORE + AFTER + 1) + shift, waves, times)

    def mean(values: FloatArray) -> FloatArray:
        parts = DT * (values[1:] + values[:-1]) / 2.0
        summed = np.concatenate([[0.0], np.cumsum(parts)])
        means: FloatArray = np.diff(np.interp(ends, run.time, summed)) / np.diff(ends)
        return means

    h, spans = mean(run.heading), np.diff((ends[1:] + ends[:-1]) / 2.0)
    step = np.diff(np.column_stack([mean(run.com[:, 0]), mean(run.com[:, 1])]), axis=0)
    along = (h[1:] + h[:-1]) / 2.0
    return (step[:, 0] * np.cos(along) + step[:, 1] * np.sin(along)) / spans, np.diff(h) / spans
