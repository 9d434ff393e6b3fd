"""Runs of the plant for the identification of a worm: steady waves with fitted maps, and steps and sines for lags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

import worm3d
from control.gaits import TravellingWave
from control.gaits.held import WAVE, HeldSchedule, HeldSteering, purely_turning
from control.gaits.steering import (
    BLEND,
    MECHANISMS,
    UNIT_STEERING,
    Correction,
    GaitParameters,
    Mechanism,
    PlannedWave,
    Schedule,
    SteeredWave,
    WaveGenerator,
)
from control.identification.identified import (
    MAX_STEERING,
    Design,
    Identified,
    Lags,
    Motion,
    Sample,
    SteeringMap,
    fit_map,
    lag,
    steady_motion,
)
from control.identification.strain_model import StrainModel
from control.identification.surrogate import Ranges
from scenes.language.errors import SceneError
from worm3d.values.arrays import FloatArray

DT = 0.01
"""Time step of the runs, the same as in the closed loop [s]."""
TIPPED = np.deg2rad(20.0)
"""Mean roll of the segments beyond which a worm no longer stands on its feet [rad]: at rest it tips at 31 degrees."""
BEFORE = 8
"""Waves before and after a step of the parameters."""
SHIFTS = (0.0, 1.0 / 3.0, 2.0 / 3.0)
"""Fractions of a wave at which the steps occur: the response depends on which feet stand at that moment."""
FREQUENCY = 0.875
"""Frequency of the wave for the measurement of lags by steps, in the middle of the map [Hz]."""
EXCITED = 60
"""Duration of the run for the fit of the strains [s]; the wave changes every second."""
SUFFICIENT_SHARE = 2.0 / 3.0
"""Share of the turn of an intact worm that a worm with one segment held still has to reach with the same hinge angles.
With segments 0, 2, 4 and 5 of the default worm held, the share is 0.87 or more. Separate hinge angles for these
segments reduce the turn and change the offset from a line by -0.0002 to 0.003 body lengths (seed 10)."""
WINDING = 0.1
"""Frequency of the sines of the steering for the measurement of the steering lag [Hz]."""
WINDING_WAVES = (0.6, 0.9, 1.1)
"""Frequencies of the waves in the runs with sines [Hz]."""

Gait = SteeredWave | TravellingWave
Drive = Gait | PlannedWave | Callable[[float], worm3d.Command]


class Subject(NamedTuple):
    """The subject of an identification: a worm, the friction of level ground, and the schedule of a wave."""

    worm: worm3d.Worm
    ground: worm3d.Friction
    schedule: Schedule


@dataclass(frozen=True)
class Steady:
    """Motion of a steady wave."""

    motion: Motion | None
    """Motion per wave; None if the run did not finish, or the worm has no heading."""
    slip: float
    """Sliding distance of the feet per wave, summed over all feet [body lengths]."""
    roll: float
    """Largest mean roll of the segments [rad]."""

    @property
    def tipped(self) -> bool:
        """Whether the worm does not stand on its feet."""
        return self.motion is None or not self.roll <= TIPPED


def steady(worm: worm3d.Worm, ground: worm3d.Friction, gait: Gait, waves: int, skipped: int) -> Steady:
    """Run waves with constant parameters on level ground, and evaluate the waves after the first `skipped`."""
    rows = round(gait.period / DT)
    run = _simulated(worm, ground, gait, waves * rows)
    if run.status is not worm3d.Status.DONE:
        return Steady(None, float("nan"), float("nan"))
    first = skipped * rows + 1
    roll = float(_roll(run)[first:].max())
    motion = replace(steady_motion(run.com, run.heading, rows, skipped, worm.length), roll=roll)
    return Steady(motion, float(run.slip[first:].sum()) / (waves - skipped) / worm.length, roll)


def identify(
    subject: Subject, design: Design, watch: Callable[[int], None] = lambda done: None, most_held: int = 12
) -> Identified:
    """Identify a worm on level ground; `watch` is called with the number of finished mechanisms.

    Steering with one segment held still is measured for at most `most_held` segments: the number of runs grows with
    the square of the number of segments.

    Raises
    ------
    SceneError
        The worm does not crawl on its feet, even with little steering.
    """
    maps: dict[Mechanism, SteeringMap] = {}
    lags: dict[Mechanism, Lags] = {}
    for done, mechanism in enumerate(MECHANISMS, start=1):
        maps[mechanism] = map_of(subject, design, mechanism)
        steering = maps[mechanism].ranges.steering / 2.0
        straight = lags[MECHANISMS[0]] if lags else None
        lags[mechanism] = measure_lags(subject, mechanism, steering, straight)
        watch(done)
    segments = subject.worm.segments
    known = range(segments if segments <= most_held else 0)
    held = tuple(held_steering(subject, design, segment) for segment in known)
    strain = strain_model(subject, maps["both"])
    return Identified(subject.schedule, MappingProxyType(maps), MappingProxyType(lags), held=held, strain=strain)


def map_of(subject: Subject, design: Design, mechanism: Mechanism, similar: SteeringMap | None = None) -> SteeringMap:
    """Return the map of one mechanism, or a corrected map of a similar worm; raises the errors of `identify`."""
    for attempt in range(4):
        greatest = MAX_STEERING[mechanism] * 0.7**attempt  # smaller while the worm tips
        ranges = design.ranges(greatest)
        fitted = samples(subject, design, design.parameters(mechanism, greatest))
        checks = fitted and samples(subject, design, check_parameters(ranges, mechanism))
        if fitted and checks:
            return fit_map(mechanism, ranges, fitted, checks, similar)
    raise SceneError(
        f"the worm tips over, folds or flattens even when it steers by {greatest:.3g} ({mechanism}) "
        "only; give it a wider stance (worm.chamber_offset_m), a lower body (worm.half_height_m) or stiffer springs"
    )


def samples(subject: Subject, design: Design, parameters: Sequence[GaitParameters]) -> list[Sample] | None:
    """Return the parameters and motions of waves; None if the worm tipped in a run."""
    worm, ground, schedule = subject
    stood = []
    for given in sorted(parameters, key=_risk):
        found = steady(worm, ground, SteeredWave(given, schedule), design.waves, design.skipped)
        if found.motion is None or found.tipped:
            return None
        stood.append(Sample(given, found.motion))
    return stood


def _risk(given: GaitParameters) -> float:
    """Return a number that is smaller for waves at which a worm tips sooner: strong waves with sharp steering."""
    return -given.amplitude * (abs(given.hinge) + abs(given.bias))


def held_steering(subject: Subject, design: Design, segment: int) -> HeldSteering | None:
    """Return how a worm steers while one segment is held still, (HS2).

    None if the worm needs no hinge angles other than an intact worm's, tips over, or cannot turn in this way.
    """
    worm, ground, schedule = subject

    def moved(wave: Schedule, hinge: float = WAVE.hinge) -> Motion | None:
        found = steady(worm, ground, SteeredWave(replace(WAVE, hinge=hinge), wave), design.waves, design.skipped)
        return None if found.tipped else found.motion

    def held(hinges: FloatArray) -> Schedule:
        return HeldSchedule(**asdict(schedule), segment=segment, hinges=hinges, backward=hinges)

    count = worm.segments - 1
    whole, usual = moved(schedule), moved(held(schedule.bend(np.array([[0.0], [np.pi / 2.0]]), worm.segments)))
    if whole is None or (usual is not None and usual.turn > SUFFICIENT_SHARE * whole.turn):
        return None
    single = [moved(held(np.eye(2 * count)[k].reshape(2, count))) for k in range(2 * count)]
    known = [(each.turn, each.drift) for each in single if each is not None]
    if len(known) < len(single):
        return None
    pattern = purely_turning(*np.array(known).T.reshape(2, 2, count))
    by_pattern, greatest = moved(held(pattern)), moved(held(pattern), UNIT_STEERING["both"][0])
    if by_pattern is None or greatest is None or not 0.0 < by_pattern.turn < greatest.turn:
        return None
    a, b = pattern.tolist()
    return HeldSteering((tuple(a), tuple(b)), by_pattern.turn)


def check_parameters(ranges: Ranges, mechanism: Mechanism, count: int = 12) -> list[GaitParameters]:
    """Return random parameters for runs that check a map, with whole steps in a period; the same in each call."""
    random = np.random.default_rng([7, len(mechanism)])
    amplitudes = random.uniform(*ranges.amplitude, count)
    periods = DT * np.round(1.0 / random.uniform(*ranges.frequency, count) / DT)
    steerings = random.uniform(-ranges.steering, ranges.steering, count)
    return [
        GaitParameters(float(a), float(1.0 / t)).steered(mechanism, float(s))
        for a, t, s in zip(amplitudes, periods, steerings, strict=True)
    ]


def measure_lags(subject: Subject, mechanism: Mechanism, steering: float, straight: Lags | None = None) -> Lags:
    """Measure how speed, turn rate and drift lag behind the gait parameters; `steering` is the amplitude of the sines.

    The lags of the speed are measured with a straight wave; `straight`, of another mechanism, already contains them.
    """
    winding = [_winding(subject, mechanism, steering, frequency) for frequency in WINDING_WAVES]
    behind, swings = zip(*winding, strict=True)
    turning = max(float(np.mean(behind)), 0.1)  # shorter lags make no difference over a wave
    rise, swing = np.polyfit(WINDING_WAVES, swings, 1).tolist()
    if straight is not None:
        return replace(straight, steering=turning, swing=swing, swing_rise=rise)
    slow, long = GaitParameters(0.2, FREQUENCY), GaitParameters(0.3, FREQUENCY)
    quick = GaitParameters(0.3, 1.2 * FREQUENCY)

    def mean_lag(begin: GaitParameters, end: GaitParameters) -> float:
        rates = [step_response(subject, begin, end, shift)[0] for shift in SHIFTS]
        # From mean to mean of two waves: the first rate after the step represents half a wave before it.
        return float(np.mean([lag(each, BEFORE - 1) - 0.5 for each in rates]))

    return Lags(mean_lag(slow, long), mean_lag(long, quick), turning, swing, rise)


def _winding(subject: Subject, mechanism: Mechanism, steering: float, frequency: float) -> tuple[float, float]:
    """Return the time constant T [s] of the turn rate's response to a sine of the applied steering, and the swing.

    T is computed from the phase of the response. A first-order response lags behind a sine of w rad/s by arctan(w T),
    and so does the applied steering behind the commanded steering with T = blend/f; the heading is the integral of the
    turn rate.
    """
    w = 2.0 * np.pi * WINDING
    wave, generator = GaitParameters(0.28, frequency), WaveGenerator(subject.schedule, subject.worm)
    plan = PlannedWave(lambda t: wave.steered(mechanism, steering * float(np.sin(w * t))), generator)
    run = _simulated(subject.worm, subject.ground, plan, round(3.0 / WINDING / DT))
    late = run.time >= 1.0 / WINDING  # two windings
    t, h = run.time[late][:-1], run.heading[late][:-1]
    waves = np.column_stack([np.sin(w * t), np.cos(w * t), np.ones_like(t), t])
    (sine, cosine, _, _), *_ = np.linalg.lstsq(waves, h, rcond=None)
    behind = np.arctan2(-sine, -cosine) - np.arctan(w * BLEND / frequency)  # the heading is -cos(w t - behind)
    return float(np.tan(behind) / w), _swing(run, round(1.0 / (frequency * DT)))


def _swing(run: worm3d.Result, rows: int) -> float:
    """Return D of (R1) [body lengths s] from a run with sines of the steering; a wave has about `rows` rows.

    D is the part of the speed to the left in phase with the turn acceleration, -w^2 times the heading's sine.
    """
    w = 2.0 * np.pi * WINDING
    t, x, y, h = (
        np.convolve(each, np.full(rows, 1.0 / rows), "valid") for each in (run.time, *run.com[:, :2].T, run.heading)
    )
    left = (np.gradient(y, DT) * np.cos(h) - np.gradient(x, DT) * np.sin(h)) / run.worm.length
    waves = np.column_stack([np.sin(w * t), np.cos(w * t), np.ones_like(t), t])[t >= 1.0 / WINDING]
    (sine, cosine, _, _), *_ = np.linalg.lstsq(waves, np.column_stack([h, left])[t >= 1.0 / WINDING], rcond=None)
    return float(-(sine[0] * sine[1] + cosine[0] * cosine[1]) / (w**2 * (sine[0] ** 2 + cosine[0] ** 2)))


def step_response(
    subject: Subject, begin: GaitParameters, end: GaitParameters, shift: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return speed [m/s] and turn rate [rad/s] from wave to wave, around a step of the parameters.

    The step comes after `BEFORE` waves and the fraction `shift` of a wave, and waves are counted from there. Place and
    heading are averaged over each wave, since a step changes how much a wave rocks them; rate k is from wave k to wave
    k + 1, so that number `BEFORE` - 1 spans the step.
    """
    generator = WaveGenerator(subject.schedule, subject.worm)
    phases: list[float] = []

    def plan(t: float) -> GaitParameters:
        phases.append(generator.waves)
        return begin if generator.waves < BEFORE + shift else end

    duration = (BEFORE + shift) / begin.frequency + (BEFORE + 1) / end.frequency
    run = _simulated(subject.worm, subject.ground, PlannedWave(plan, generator), round(duration / DT))
    # A command given at the beginning of a step takes effect at the end: entry k is the phase of row k's shape.
    times, waves = run.time[1 : len(phases)], np.array(phases)[1:]
    ends = np.interp(np.arange(2 * BEFORE + 1) + shift, waves, times)

    def mean(values: FloatArray) -> FloatArray:
        summed = np.concatenate([[0.0], np.cumsum(DT * (values[1:] + values[:-1]) / 2.0)])
        means: FloatArray = np.diff(np.interp(ends, run.time, summed)) / np.diff(ends)
        return means

    h, spans = mean(run.heading), np.diff((ends[1:] + ends[:-1]) / 2.0)
    step = np.diff(np.column_stack([mean(run.com[:, 0]), mean(run.com[:, 1])]), axis=0)
    along = (h[1:] + h[:-1]) / 2.0
    return (step[:, 0] * np.cos(along) + step[:, 1] * np.sin(along)) / spans, np.diff(h) / spans


def strain_model(subject: Subject, found: SteeringMap) -> StrainModel | None:
    """Return the strains of a healthy worm, fitted to a run with wave parameters all over the ranges of a map.

    In the second half of the run, each chamber gets a larger or smaller command, earlier or later, so that the fit can
    separate the effect of the chamber's own command from the effect of the opposite chamber's command. The fit ends at
    the time when the worm tips. There is no fit for a worm that tips early or cannot stand.
    """
    (worm, ground, schedule), ranges = subject, found.ranges
    random, count, generator = np.random.default_rng(0), EXCITED, WaveGenerator(schedule, worm)
    # At most half the steering of the map, since a worm with unequal chambers tips sooner.
    places = random.uniform([0.0, 0.0, -0.5], [1.0, 1.0, 0.5], (count, 3))
    given = ranges.bounds[0] * (1.0 - places) + ranges.bounds[1] * places
    given[:, 2] = places[:, 2] * ranges.steering
    waves = [GaitParameters(a, f).steered(found.mechanism, s) for a, f, s in given.tolist()]
    shape, told = (count, worm.segments, 2), []
    unequal = [*map(Correction, random.uniform(0.8, 1.15, shape), random.uniform(-0.2, 0.2, shape))]
    for k in range(round(EXCITED / DT)):
        now = min(int(k * DT), count - 1)
        generator.correction = unequal[now] if 2 * now >= count else None
        told.append(generator.step(DT, waves[now]))
    try:
        run = _simulated(worm, ground, lambda t: told[min(round(t / DT), len(told) - 1)], len(told))
    except ValueError:
        return None
    stands = np.append(_roll(run) <= TIPPED, False)
    rows = slice(0, min(int(np.argmin(stands)), len(told)))
    if rows.stop < SUFFICIENT_SHARE * len(told):
        return None
    contraction, hinge = (np.array([getattr(each, name) for each in told[rows]]) for name in ("contraction", "hinge"))
    return StrainModel.fit(run.time[rows], contraction, hinge, run.chamber_strain[rows])


def _roll(run: worm3d.Result) -> FloatArray:
    """Return the magnitude of the mean roll of the segments at each instant [rad]."""
    return np.asarray(np.abs(np.arcsin(np.clip(run.directors[:, :, 2], -1.0, 1.0)).mean(axis=1)))


def _simulated(worm: worm3d.Worm, ground: worm3d.Friction, gait: Drive, steps: int) -> worm3d.Result:
    return worm3d.simulate(worm, worm3d.Plane(), ground, actuation=gait, duration=steps * DT, dt=DT)
