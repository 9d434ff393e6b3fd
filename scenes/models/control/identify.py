"""Identification of a worm by simulated runs.

Runs with steady waves give the map from the parameters of the gait to the motion. Runs with steps and sines of the
parameters give the lags of the motion.
"""

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
"""If the mean roll of the segments exceeds this angle, the worm counts as tipped over [rad]. A worm at rest tips over
at 31 degrees."""
BEFORE = 8
"""Number of waves before and after a step of the parameters."""
SHIFTS = (0.0, 1.0 / 3.0, 2.0 / 3.0)
"""The parameters step at these phases of the wave. The response depends on the feet that stand on the ground at the
step; therefore it is averaged over these phases."""
FREQUENCY = 0.875
"""Frequency of the wave in the runs with steps [Hz]. It is in the middle of the range of the map."""
EXCITED = 60
"""Duration of the run for fitting the strain model [s]. The parameters of the wave change every second."""
SUFFICIENT_SHARE = 2.0 / 3.0
"""Smallest sufficient turn of a worm with one segment held still, as a fraction of the turn of an intact worm.

If the usual hinge angles reach it, no other hinge angles are sought for this segment. For segments 0, 2, 4 and 5 of the
default worm the usual hinge angles give 0.87 or more. Other hinge angles for these segments would reduce the turn, and
change the distance from a line by -0.0002 to 0.003 body lengths (seed 10). The strain model is fitted to at least the
same fraction of a run.
"""
WINDING = 0.1
"""Frequency of the sine of the steering, in the runs for the lag of the turn rate [Hz]."""
WINDING_WAVES = (0.6, 0.9, 1.1)
"""Frequencies of the gait in the runs with a sine of the steering [Hz]."""

Gait = SteeredWave | TravellingWave
Drive = Gait | PlannedWave | Callable[[float], worm3d.Command]


class Subject(NamedTuple):
    """What is identified: a worm on level ground with the given friction, and the schedule of its wave."""

    worm: worm3d.Worm
    ground: worm3d.Friction
    schedule: Schedule


@dataclass(frozen=True)
class Steady:
    """Motion of a worm with a wave whose parameters are constant."""

    motion: Motion | None
    """Motion per wave, or None if the run did not finish."""
    slip: float
    """Sliding distance of the feet per wave, summed over all feet [body lengths]."""
    roll: float
    """Largest mean roll of the segments [rad]."""

    @property
    def tipped(self) -> bool:
        """Whether the worm does not stand on its feet."""
        return self.motion is None or not self.roll <= TIPPED


def steady(worm: worm3d.Worm, ground: worm3d.Friction, gait: Gait, waves: int, skipped: int) -> Steady:
    """Simulate `waves` waves with constant parameters on level ground, and evaluate all but the first `skipped`."""
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
    """Identify a worm on level ground.

    Parameters
    ----------
    subject, design
        The worm, and the parameters of the runs.
    watch : callable
        Function that is called with the number of finished mechanisms of steering.
    most_held : int
        Steering with one segment held still is measured for worms with at most this number of segments. For longer
        worms it is left out, since the number of runs grows with the square of the number of segments.

    Raises
    ------
    SceneError
        If the worm tips over even with little steering.
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
    """Return the map of one mechanism; if a map of a similar worm is given, this map is corrected.

    If the stroke is less than the greatest amplitude of the design, all amplitudes are scaled to end at the stroke.

    The errors are the same as in `identify`, and also SceneError if the worm's stroke is too small for the waves.
    """
    least, stroke = min(design.amplitudes), subject.worm.stroke[1]
    if stroke < least:
        raise SceneError(
            f"the stroke of its chambers is {stroke:.4g}, must be at least {least:g}, the contraction of the smallest "
            "wave of a map; choose controller.map = 'default', or a worm with a larger stroke"
        )
    design = replace(design, amplitudes=tuple(stroke_share(subject.worm) * each for each in design.amplitudes))
    for attempt in range(4):
        greatest = MAX_STEERING[mechanism] * 0.7**attempt  # smaller after each attempt where the worm tips over
        ranges = design.ranges(greatest)
        fitted = samples(subject, design, design.parameters(mechanism, greatest))
        checks = fitted and samples(subject, design, check_parameters(ranges, mechanism))
        if fitted and checks:
            return fit_map(mechanism, ranges, fitted, checks, similar)
    raise SceneError(
        f"the worm tips over, folds or flattens even when it steers by {greatest:.3g} ({mechanism}) "
        "only; give it a wider stance (worm.chamber_offset_m), a lower body (worm.half_height_m) or stiffer springs"
    )


def stroke_share(worm: worm3d.Worm) -> float:
    """Return the factor of all amplitudes: 1, or less if the greatest amplitude of a map exceeds the stroke."""
    return min(1.0, worm.stroke[1] / max(Design.amplitudes))


def samples(subject: Subject, design: Design, parameters: Sequence[GaitParameters]) -> list[Sample] | None:
    """Return the motions for the given parameters, or None if the worm tips over in one of the runs."""
    worm, ground, schedule = subject
    stood = []
    for given in sorted(parameters, key=_risk):
        found = steady(worm, ground, SteeredWave(given, schedule), design.waves, design.skipped)
        if found.motion is None or found.tipped:
            return None
        stood.append(Sample(given, found.motion))
    return stood


def _risk(given: GaitParameters) -> float:
    """Return a sort key for waves. The waves that tip a worm over most easily come first.

    These are waves with a large amplitude and sharp steering. If the worm tips over, the other runs are not needed.
    """
    return -given.amplitude * (abs(given.hinge) + abs(given.bias))


def held_steering(subject: Subject, design: Design, segment: int) -> HeldSteering | None:
    """Return how a worm steers while one segment is held still, (HS2) in `control.identification`.

    Return None if the hinge angles of an intact worm suffice, if the worm tips over, or if it cannot turn.
    """
    worm, ground, schedule = subject

    def moved(wave: Schedule, hinge: float = WAVE.hinge) -> Motion | None:
        given = replace(WAVE, amplitude=min(WAVE.amplitude, worm.stroke[1]), hinge=hinge)
        found = steady(worm, ground, SteeredWave(given, wave), design.waves, design.skipped)
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
    """Return random parameters of waves for runs that check a map.

    Each period is a whole number of time steps. The parameters are the same in every call.
    """
    random = np.random.default_rng([7, len(mechanism)])
    amplitudes = random.uniform(*ranges.amplitude, count)
    periods = DT * np.round(1.0 / random.uniform(*ranges.frequency, count) / DT)
    steerings = random.uniform(-ranges.steering, ranges.steering, count)
    return [
        GaitParameters(float(a), float(1.0 / t)).steered(mechanism, float(s))
        for a, t, s in zip(amplitudes, periods, steerings, strict=True)
    ]


def measure_lags(subject: Subject, mechanism: Mechanism, steering: float, straight: Lags | None = None) -> Lags:
    """Measure how speed, turn rate and drift lag behind the parameters of the gait.

    `steering` is the amplitude of the sine of the steering. The lags of the speed are measured without steering, so
    that they are the same for every mechanism. They are taken from `straight`, the lags of another mechanism, if given.
    """
    winding = [_winding(subject, mechanism, steering, frequency) for frequency in WINDING_WAVES]
    behind, swings = zip(*winding, strict=True)
    turning = max(float(np.mean(behind)), 0.1)  # shorter lags make no difference over a wave
    rise, swing = np.polyfit(WINDING_WAVES, swings, 1).tolist()
    if straight is not None:
        return replace(straight, steering=turning, swing=swing, swing_rise=rise)
    small, large = 0.2 * stroke_share(subject.worm), 0.3 * stroke_share(subject.worm)
    slow, long = GaitParameters(small, FREQUENCY), GaitParameters(large, FREQUENCY)
    quick = GaitParameters(large, 1.2 * FREQUENCY)

    def mean_lag(begin: GaitParameters, end: GaitParameters) -> float:
        rates = [step_response(subject, begin, end, shift)[0] for shift in SHIFTS]
        # A rate is the change between the means over two successive waves, and is therefore half a wave late.
        return float(np.mean([lag(each, BEFORE - 1) - 0.5 for each in rates]))

    return Lags(mean_lag(slow, long), mean_lag(long, quick), turning, swing, rise)


def _winding(subject: Subject, mechanism: Mechanism, steering: float, frequency: float) -> tuple[float, float]:
    """Return the time constant T [s] of the turn rate, and the swing (`_swing`).

    Both are measured in a run with a sine of the steering. T is computed from the phase of the heading, the integral of
    the turn rate. A first-order response with the time constant T lags behind a sine of w rad/s by arctan(w T). The
    applied steering lags behind the commanded steering with the known time constant BLEND / f, which is subtracted.
    """
    w, amplitude = 2.0 * np.pi * WINDING, 0.28 * stroke_share(subject.worm)
    wave, generator = GaitParameters(amplitude, frequency), WaveGenerator(subject.schedule, subject.worm)
    plan = PlannedWave(lambda t: wave.steered(mechanism, steering * float(np.sin(w * t))), generator)
    run = _simulated(subject.worm, subject.ground, plan, round(3.0 / WINDING / DT))
    late = run.time >= 1.0 / WINDING  # two windings
    t, h = run.time[late][:-1], run.heading[late][:-1]
    waves = np.column_stack([np.sin(w * t), np.cos(w * t), np.ones_like(t), t])
    (sine, cosine, _, _), *_ = np.linalg.lstsq(waves, h, rcond=None)
    behind = np.arctan2(-sine, -cosine) - np.arctan(w * BLEND / frequency)  # the heading is -cos(w t - behind)
    return float(np.tan(behind) / w), _swing(run, round(1.0 / (frequency * DT)))


def _swing(run: worm3d.Result, rows: int) -> float:
    """Return D of (R1) in `control.identification` [body lengths s] from a run with a sine of the steering.

    D is the part of the speed to the left that is in phase with the angular acceleration. The angular acceleration is
    -w^2 times the sine of the heading. A wave has about `rows` rows of the run.
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
    """Return the speed [m/s] and the turn rate [rad/s] of each wave before and after a step of the parameters.

    The parameters step after `BEFORE` + `shift` waves. Position and heading oscillate within a wave, and the step
    changes their amplitude; therefore they are averaged over each wave first. Rate k is the change from the mean of
    wave k to the mean of wave k + 1, so that the step occurs within rate `BEFORE` - 1.
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
    """Return a model of the strains of a worm without faults, or None if the worm tips over too early or cannot stand.

    The model is fitted to a run with random parameters of the wave from the ranges of a map. In the second half of the
    run, the commands to the chambers differ in amplitude and phase, so that the fit can separate the effect of the
    command to a chamber from the effect of the command to the opposite chamber. If the worm tips over, only the part of
    the run before is used.
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
