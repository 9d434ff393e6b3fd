"""Steering of a crawling worm: the wave that turns the worm, as a gait and at run time, driven by a controller.

The findings are of the default worm (level ground, default friction, amplitude 0.3 unless another is given):

**A plain bias or hinge does not steer.** `TravellingWave(bias=...)`, which contracts the left chambers more, in phase
with the crawl, (1) bends the body to the left on average, so that the worm crawls an arc to the left; (2) gives the
left feet the longer strokes, which turns the worm to the right like a tank; (3) makes the left chambers taller, which
rolls the worm over its right feet; (4) moves the centre of mass off the feet that carry it: beyond the half-width of
the stance, b = 0.03 m, the worm tips and stays on its side. At small bias (2) and (3) win, at large bias (1): the worm
turns by -9, 0, 15, 50 degrees a wave at a bias of 0.1, 0.2, 0.35, 0.5 (period 2 s). A static bend has effect (1) alone,
but tips the worm from 0.1 rad a joint on (wavelength 1); hinges in phase with the contraction tip the worm at 0.3 rad.

**A longer bending wave steers.** To turn on the spot, the head steps to one side and the tail to the other, each while
its feet are in the air; the body bends between the lifted feet and the standing feet. If bending and contraction have
the same wavelength, all feet step to the same side: at a wavelength of 0.7 and hinges of 0.08 rad the worm shuffles by
up to 0.024 m a wave and turns by 0.7 degrees at most, whatever the phase. A bending wave twice as long as the
contraction, with the same frequency and zero mean, turns the worm by 13 degrees with the same hinges. This wave also
keeps the worm upright (roll below 2 degrees) and adds some speed, whether hinges or unequal chambers produce the wave.
At a contraction wavelength of 0.7 the worm stands on two groups of feet for three quarters of the time (two fifths at
1), which leaves a margin against tipping.

**Phase.** Turn and shuffle both vary as the cosine of the phase, a quarter of a wave apart, so that there is a phase of
pure turning. This phase grows with the frequency f, since the bend lags the command; a constant time, `lead`,
compensates this growth within some 10 degrees from 0.5 to 1.25 Hz, at 94 % or more of the greatest turn. For these
frequencies and amplitudes of 0.15 to 0.4 the turn is odd, monotone and nearly linear up to hinges of 0.12 rad or a bias
of 0.06, except for a soft start below hinges of 0.02 rad, where feet still stick: 16 degrees a wave at 0.8 Hz and
hinges of 0.1 rad, 13 at a bias of 0.06.

**Staying upright.** No wave brings back a worm that lies on its side: controllers stay within these limits. Amplitudes
of 0.15 to 0.4, frequencies and steerings that are redrawn every 0.75 s for a minute roll the worm by less than 3
degrees. On a cross slope of 3 degrees hinges of -0.12 rad, held for ten waves, tip the worm.

With the wave's phase psi (a wave is 2 pi), x = (i + 1/2)/N, k = 2 pi / wavelength, k_s = 2 pi / steering_wavelength and
the sign - for a direct, + for a retrograde wave:

    contraction = A (min(1, max(0, g sin(k x +- psi))) + side bias sin(k_s x +- (psi + bias_phase + 2 pi f lead)))  (S1)
    hinge_j     = hinge sin(k_s x_j +- (psi + hinge_phase + 2 pi f lead)),   j = 1 ... N-1                  (S2)

clipped to the stroke, side = +1 left, -1 right, steepness g; joint j belongs to its headward segment j.

**Steep waves.** At g = 2, segments stay short, and carry load, for a third of the wave. The worm goes farther with the
same stroke: 0.175 in place of 0.095 body lengths a wave at amplitude 0.3 and 0.8 Hz. The same speed takes a smaller
stroke and half the work; damping dissipates nearly all of this work. With hinges of 0.12 rad a wave turns the worm by
16 in place of 20 degrees, on a way that is longer by two thirds: the worm follows bends less sharply. At 0.08 m/s and
0.8 Hz the work is 15 % more at g = 1.5 than at 2, 2 % less at 3, 6 % more at 4.

**Backwards.** A wave of negative amplitude A is the wave of amplitude -A, executed as if the tail were the head: half a
turn about the vertical puts segment i in the place of segment N-1-i, joint j in the place of joint N-j, and exchanges
left and right,

    c_iL -> c_{N-1-i,R},   c_iR -> c_{N-1-i,L},   hinge_j -> -hinge_{N-j}                                        (S3)

A worm that is the same from both ends, on friction that is the same forward and backward, then moves the same distance
backwards and turns the same way as with amplitude -A: (distance, turn, drift) -> (-distance, turn, -drift).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Literal, NamedTuple, get_args

import numpy as np

from control.gaits.gait import Body, BoundGait, Direction, require_amplitude
from worm3d import Command, Commands
from worm3d.values import arguments, time_steps
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.spelling import Spelled

Mechanism = Literal["hinge", "bias", "both"]
MECHANISMS: tuple[Mechanism, ...] = get_args(Mechanism)
Wave = Literal["sine", "steep"]
UNIT_STEERING: dict[Mechanism, tuple[float, float]] = {"hinge": (1.0, 0.0), "bias": (0.0, 1.0), "both": (0.14, 0.02)}
"""Hinge [rad] and bias for a steering of 1. With "both", the steering is a share of the greatest steering."""

LEFT_RIGHT = np.array([1.0, -1.0])
BLEND = 0.25
"""Default number of waves until a parameter has covered 63 % of a change."""
PACE = 0.5
"""Lower limit of the frequency in the rate of change of the parameters [Hz]. It allows waves of frequency 0 to stop and
restart."""


@dataclass(frozen=True)
class GaitParameters(Spelled):
    """Parameters of a wave, which a controller may change at any time.

    With the phases of a `Schedule`, positive bias and hinge turn the worm to the left.

    Raises
    ------
    ValueError
        A value is not finite, or out of range.
    """

    amplitude: float
    """Greatest contraction A of a chamber. It is negative for a backward wave (S3)."""
    frequency: float
    """Frequency f [Hz], above 0."""
    bias: float = 0.0
    """Steering by unequal chambers, a fraction of A."""
    hinge: float = 0.0
    """Steering by hinges [rad]."""

    def __post_init__(self) -> None:
        for name in ("amplitude", "bias", "hinge"):
            arguments.number(name, getattr(self, name))
        standing = "above 0; amplitude 0 stands still"
        arguments.number("frequency", self.frequency, "Hz", gt=0.0, allowed=standing)

    def steered(self, mechanism: Mechanism, steering: float) -> GaitParameters:
        """Return the same wave, steered by one mechanism only.

        The steering is a hinge [rad], a bias, or a share of both.
        """
        hinge, bias = UNIT_STEERING[mechanism]
        return GaitParameters(self.amplitude, self.frequency, bias=steering * bias, hinge=steering * hinge)

    def steering(self, mechanism: Mechanism) -> float:
        """Return the steering that makes `steered` give this wave, or the nearest wave by least squares."""
        hinge, bias = UNIT_STEERING[mechanism]
        return (self.hinge * hinge + self.bias * bias) / (hinge**2 + bias**2)

    def row(self) -> FloatArray:
        """Return amplitude, frequency, bias and hinge as an array, shape (4,)."""
        return np.array([self.amplitude, self.frequency, self.bias, self.hinge])


class Correction(NamedTuple):
    """Correction of the chamber commands, so that weak and slow chambers move like the others."""

    gain: FloatArray
    """Factor of the contraction of each chamber, shape (N, 2)."""
    ahead: FloatArray
    """Phase lead of the command to each chamber, shape (N, 2) [rad]."""


UNCORRECTED = Correction(np.ones((1, 2)), np.zeros((1, 1)))


@documented
@dataclass(frozen=True, kw_only=True)
class Schedule(Spelled):
    """Phases of the contraction and the bending of each segment within a wave, (S1) and (S2).

    The defaults steer the default worm.
    """

    wavelength: float = parameter(0.7, unit="body lengths", gt=0, meaning="wavelength of the contraction")
    steering_wavelength: float = parameter(1.4, unit="body lengths", gt=0, meaning="wavelength of the bending wave")
    bias_phase: float = parameter(
        float(np.deg2rad(105.0)), unit="rad", meaning="phase of bending by bias ahead of the contraction at f -> 0"
    )
    hinge_phase: float = parameter(
        float(np.deg2rad(90.0)), unit="rad", meaning="phase of bending by hinges ahead of the contraction at f -> 0"
    )
    lead: float = parameter(
        0.2, unit="s", meaning="time by which bending commands are further ahead, because bending lags the command"
    )
    steepness: float = parameter(1.0, ge=1, meaning="factor of the contraction's sine, which is cut at 1; 2 is fast")
    direction: Direction = parameter("retrograde", meaning="retrograde runs head to tail, direct tail to head")

    def __post_init__(self) -> None:
        check(self)

    def commands_at(
        self, phase: FloatArray, parameters: FloatArray, body: Body, correction: Correction | None = None
    ) -> Commands:
        """Return the commands at K phases psi (K,) [rad], (S1) and (S2).

        `parameters` contains amplitude, frequency [Hz], bias and hinge [rad] at each phase, shape (K, 4). Where the
        amplitude is negative, (S3) applies. `correction` scales the commands to the chambers and shifts their phases.
        """
        amplitude, frequency, bias, hinge = parameters.T[:, :, None]
        back, amplitude = amplitude < 0.0, np.abs(amplitude)
        psi, bending = phase[:, None, None], phase[:, None] + 2.0 * np.pi * self.lead * frequency
        gain, ahead = correction or UNCORRECTED
        if back.any():
            gain, ahead = (np.where(back[..., None], each[::-1, ::-1], each) for each in (gain, ahead))
        shift = ahead.swapaxes(-1, -2)
        wave = self.pulse(psi + shift, body.segments).swapaxes(1, 2)
        if bias.any():
            steered = self._wave(bending[:, None] + shift + self.bias_phase, self.steering_wavelength, body.segments)
            wave = wave + bias[..., None] * steered.swapaxes(1, 2) * LEFT_RIGHT
        chambers = (gain * (amplitude[..., None] * wave)).clip(*body.stroke)
        bend = hinge * self.bend(bending, body.segments)
        if back.any():
            chambers = np.where(back[..., None], chambers[:, ::-1, ::-1], chambers)
            bend = np.where(back, -bend[:, ::-1], bend)
        return Commands(chambers, bend, np.zeros_like(chambers))

    def pulse(self, phase: FloatArray, segments: int) -> FloatArray:
        """Return the contraction without steering, divided by the amplitude, at phases (..., 1) or (..., N) [rad]."""
        return (self.steepness * self._wave(phase, self.wavelength, segments)).clip(0.0, 1.0)

    def bend(self, ahead: FloatArray, segments: int) -> FloatArray:
        """Return the hinge angles of (S2) divided by the steering, shape (K, N - 1).

        `ahead` contains the phases psi + 2 pi f lead, shape (K, 1) [rad].
        """
        return self._wave(ahead + self.hinge_phase, self.steering_wavelength, segments)[:, 1:]

    def _wave(self, phase: FloatArray, wavelength: float, segments: int) -> FloatArray:
        x = (np.arange(segments) + 0.5) / segments
        sign = 1.0 if self.direction == "retrograde" else -1.0
        return np.sin(2.0 * np.pi * x / wavelength + sign * phase)


WAVE_SCHEDULES: Mapping[Wave, Schedule] = MappingProxyType({"sine": Schedule(), "steep": Schedule(steepness=2.0)})
"""Schedules of the default worm by the name used in scenes."""


@dataclass(frozen=True)
class SteeredWave(Spelled):
    """A wave with constant parameters, as a gait. Its amplitude grows from 0, as in a `WaveGenerator`."""

    parameters: GaitParameters
    schedule: Schedule = Schedule()
    blend: float = BLEND
    """Number of waves until the amplitude reaches 63 % of its final value."""

    def __post_init__(self) -> None:
        arguments.instance("parameters", self.parameters, GaitParameters, "a control.gaits.steering.GaitParameters")
        arguments.instance("schedule", self.schedule, Schedule, "a control.gaits.steering.Schedule")
        arguments.number("blend", self.blend, "waves", gt=0.0)

    @property
    def period(self) -> float:
        """Period of the wave [s]."""
        return 1.0 / self.parameters.frequency

    def bind(self, worm: Body) -> BoundGait:
        """Return the actuation of `worm`: time [s] -> `worm3d.Command`.

        Raises
        ------
        ValueError
            The amplitude exceeds the worm's stroke.
        """
        require_amplitude(abs(self.parameters.amplitude), worm.stroke)
        steps = partial(time_steps.require_period, name="the gait's period", period=self.period)
        return BoundGait(partial(self._commands, worm=worm), steps)

    def _commands(self, times: FloatArray, worm: Body) -> Commands:
        asked = self.parameters
        swell = 1.0 - np.exp(-asked.frequency / self.blend * times)
        parameters = asked.row() * np.column_stack([swell, np.ones_like(swell), swell, swell])
        return self.schedule.commands_at(2.0 * np.pi * asked.frequency * times, parameters, worm)


class WaveGenerator(Spelled):
    """Generator of a wave whose parameters may change at any time. The commands have no jumps.

    The `phase` psi [rad] follows psi' = 2 pi f. Each of the `parameters` p approaches its target with the rate (target
    - p) max(f, `PACE`) / blend. `parameters` is None before the first step, and a wave begins with amplitude 0. If the
    direction is reversed, (S3), the old wave decays while the new wave grows, and the commands are the sum of both. The
    `correction` of the chambers may be set at any time. It is None initially.

    Parameters
    ----------
    schedule : Schedule
    body : Body
    blend : float
        Number of waves until a parameter has covered 63 % of a change, above 0.
    """

    def __init__(self, schedule: Schedule, body: Body, blend: float = BLEND) -> None:
        arguments.number("blend", blend, "waves", gt=0.0)
        arguments.instance("schedule", schedule, Schedule, "a control.gaits.steering.Schedule")
        if not (hasattr(body, "segments") and hasattr(body, "stroke")):
            raise ValueError(f"body: got {type(body).__name__}, must be a worm3d.Worm")
        self.schedule, self.blend, self._body = schedule, blend, body
        self.reset()

    def reset(self) -> None:
        """Reset to the initial state."""
        self.phase = 0.0
        self.parameters: GaitParameters | None = None
        self._dying: FloatArray | None = None
        self.correction: Correction | None = None

    def step(self, dt: float, target: GaitParameters) -> Command:
        """Return the command `dt` [s] after the previous one, on the way to `target`."""
        given = self.steps((dt,), target)
        return Command(given.contraction[0], given.hinge[0])

    def steps(self, elapsed: Sequence[float], target: GaitParameters) -> Commands:
        """Return the commands after each of K further time steps [s], on the way to `target`."""
        goal, now = target.row(), self._begun(target)
        phases, rows, dying_rows = [], [], []
        for dt in elapsed:
            left_over = np.exp(-dt * max(now[1], PACE) / self.blend)
            moved = goal + (now - goal) * left_over
            self.phase += float(np.pi * (now[1] + moved[1]) * dt)
            now = moved
            phases.append(self.phase)
            rows.append(now)
            if self._dying is not None:
                self._dying = np.array([left_over, 1.0, 1.0, left_over]) * self._dying
                dying_rows.append(self._dying)
        self.parameters = GaitParameters(*now.tolist())
        given = self.schedule.commands_at(np.array(phases), np.array(rows), self._body, self.correction)
        if self._dying is None:
            return given
        other = self.schedule.commands_at(np.array(phases), np.array(dying_rows), self._body, self.correction)
        if np.abs(self._dying[[0, 3]]).max() < 1e-9:
            self._dying = None
        both = np.clip(given.contraction + other.contraction, *self._body.stroke)
        return Commands(both, given.hinge + other.hinge, given.force)

    def _begun(self, target: GaitParameters) -> FloatArray:
        """Return the present parameters of the wave in the target's direction. A wave in the other direction decays."""
        if self.parameters is None:
            self._dying = None
            return GaitParameters(0.0, target.frequency).row()
        now = self.parameters.row()
        if now[0] * target.amplitude >= 0.0:
            return now
        before, self._dying = self._dying, now
        return np.array([0.0, now[1], 0.0, 0.0]) if before is None else before

    @property
    def waves(self) -> float:
        """Number of waves since the start."""
        return self.phase / (2.0 * np.pi)


class PlannedWave:
    """A controller without measurements, whose wave follows a plan.

    The plan is a function of time [s] that returns `GaitParameters`.
    """

    def __init__(self, plan: Callable[[float], GaitParameters], generator: WaveGenerator) -> None:
        self._plan, self._generator = plan, generator
        self.reset()

    def reset(self) -> None:
        """Reset to the initial state."""
        self._generator.reset()
        self._time: float | None = None

    def step(self, t: float, _measurement: object) -> Command:
        """Return the command from time t [s] on."""
        dt = 0.0 if self._time is None else t - self._time
        self._time = t
        return self._generator.step(dt, self._plan(t))
