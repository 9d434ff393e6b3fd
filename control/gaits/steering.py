"""Steering: how a crawling worm is made to turn, and the wave that a controller drives.

What was found on the default worm (level ground, default friction, contraction amplitude 0.3):

**Why a plain bias or hinge does not steer.** `TravellingWave(bias=...)` contracts the left chambers more in the same
phase as the crawl. That does four things at once. (1) On average the body bends to the left, and a bent body crawls
along an arc to the left. (2) The left feet make the longer strokes, like the faster side of a tank, which turns the
worm to the right. (3) A chamber that is shorter is also taller, so that the stronger side lifts its segments and rolls
the worm over the feet of the other side. (4) The centre of mass of a bent body lies beside the few feet that carry it:
where that is more than the half-width b = 0.03 m of the stance, the worm tips and goes on lying on its side, rolled by
45 degrees. At small bias (2) and (3) win, at large bias (1): -9, 0, 15, 50 degrees a wave at bias 0.1, 0.2, 0.35, 0.5
(period 2 s). A static bend works by (1) alone but tips the worm (at wavelength 1 from 0.1 rad a joint on), and hinges
in phase with the contraction tip it at 0.3 rad.

**What steers.** To turn on the spot the head has to step to one side and the tail to the other, each while its feet
are in the air. A foot steps sideways by the bending of the body between it and the feet that stand. If bending and
contraction have the same wavelength, every segment bends in the same phase of its step and all feet step to the same
side: at wavelengths of 0.7 and hinges of 0.08 rad the worm shuffles sideways by up to 0.024 m a wave and does not turn
(0.7 degrees at most, whatever the phase). So the phase between the two waves has to drift from head to tail. A bending
wave of the same frequency, without mean and twice as long as the contraction wave, turns the worm by 13 degrees at the
same hinges, keeps its centre of mass over its feet (roll below 2 degrees) and adds some speed. The wave stands on two
groups of feet for three quarters of the time at a contraction wavelength of 0.7 (two fifths at 1), which leaves room
before the worm tips. The same bending wave turns it whether hinges or unequal chambers make it.

**Its phase.** Turn and sideways motion both go with the cosine of the phase, a quarter of a wave apart: there is a
phase of pure turning (and one of pure shuffling). It grows with the frequency f because the bend lags behind its
command (soft chambers, friction, inertia); a constant time, `lead`, holds it from 0.5 to 1.25 Hz to some 10 degrees at
amplitude 0.3, at 94 % or more of the greatest turn. Over these frequencies and amplitudes of 0.15 to 0.4 the turn a
wave is odd, monotone and nearly linear (but for a soft start below hinges of 0.02 rad, where the feet still stick) up
to hinges of 0.12 rad or a bias of 0.06: 16 degrees a wave at amplitude 0.3, 0.8 Hz and hinges of 0.1 rad, 13 at a bias
of 0.06.

**Staying upright.** Neither a straight wave nor rest nor the opposite steering brings a worm back that lies on its
side: a controller has to stay within those limits. Within them it may change its mind: amplitude, frequency and
steering drawn anew every 0.75 s for a minute, at amplitudes of 0.15 to 0.4, roll the worm by less than 3 degrees. On a
cross slope of 3 degrees hinges of -0.12 rad, held for ten waves, do tip it.

With the wave's phase psi (a wave is 2 pi), x = (i + 1/2)/N, k = 2 pi / wavelength, k_s = 2 pi / steering_wavelength and
the sign - for a direct, + for a retrograde wave:

    contraction = A (max(0, sin(k x +- psi)) + side bias sin(k_s x +- (psi + bias_phase + 2 pi f lead)))    (S1)
    hinge_j     = hinge sin(k_s x_j +- (psi + hinge_phase + 2 pi f lead)),   j = 1 ... N-1                  (S2)

clipped to the stroke, side = +1 left, -1 right; joint j belongs to its headward segment j.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal, get_args

import numpy as np

from control.gaits import Body, Direction
from worm3d import Command, Commands
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray

Mechanism = Literal["hinge", "bias"]
MECHANISMS: tuple[Mechanism, ...] = get_args(Mechanism)

LEFT_RIGHT = np.array([1.0, -1.0])


@dataclass(frozen=True)
class GaitParameters:
    """What a controller decides from wave to wave.

    Attributes
    ----------
    amplitude : float
        A, greatest contraction of a chamber, at least 0.
    frequency : float
        f [Hz], above 0.
    bias, hinge : float
        Steering by unequal chambers, a fraction of A, and by hinges [rad]; with the phases of a schedule that was found
        to steer, positive turns to the left.

    Raises
    ------
    ValueError
        A value that is not finite or out of range.
    """

    amplitude: float
    frequency: float
    bias: float = 0.0
    hinge: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            arguments.number(field.name, getattr(self, field.name))
        if self.amplitude < 0.0:
            raise ValueError(f"amplitude: got {self.amplitude!r}, must be at least 0")
        standing = "above 0; amplitude 0 stands still"
        arguments.number("frequency", self.frequency, "Hz", gt=0.0, allowed=standing)

    def steered(self, mechanism: Mechanism, steering: float) -> GaitParameters:
        """Return the same wave, steered by one mechanism only."""
        turning = {name: steering if name == mechanism else 0.0 for name in MECHANISMS}
        return GaitParameters(self.amplitude, self.frequency, **turning)

    def row(self) -> FloatArray:
        """Return amplitude, frequency, bias and hinge as an array, shape (4,)."""
        return np.array([self.amplitude, self.frequency, self.bias, self.hinge])


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """When each segment contracts and bends within a wave, (S1) and (S2); the defaults steer the default worm.

    Attributes
    ----------
    wavelength : float
        Of the contraction [body lengths].
    steering_wavelength : float
        Of the bending wave [body lengths].
    bias_phase, hinge_phase : float
        By which the bending wave of each mechanism runs ahead of the contraction at f -> 0 [rad].
    lead : float
        Time by which it runs ahead besides, since the bend lags behind its command [s].
    direction : str
        "retrograde" runs head to tail, "direct" tail to head.

    Raises
    ------
    ValueError
        A value out of range.
    """

    wavelength: float = 0.7
    steering_wavelength: float = 1.4
    bias_phase: float = float(np.deg2rad(105.0))
    hinge_phase: float = float(np.deg2rad(90.0))
    lead: float = 0.2
    direction: Direction = "retrograde"

    def __post_init__(self) -> None:
        for name in ("wavelength", "steering_wavelength"):
            arguments.number(name, getattr(self, name), gt=0.0)
        for name in ("bias_phase", "hinge_phase", "lead"):
            arguments.number(name, getattr(self, name))
        arguments.choice("direction", self.direction, get_args(Direction))

    def commands(self, phase: FloatArray, parameters: FloatArray, body: Body) -> Commands:
        """Return the commands at K phases psi [rad], (S1) and (S2).

        Parameters
        ----------
        phase : ndarray, shape (K,)
        parameters : ndarray, shape (K, 4)
            Amplitude, frequency [Hz], bias and hinge [rad] at each of them.
        body : Body
            Its segments and stroke.
        """
        amplitude, frequency, bias, hinge = parameters.T[:, :, None]
        ahead = phase[:, None] + 2.0 * np.pi * self.lead * frequency
        pulse = np.maximum(0.0, self._wave(phase[:, None], self.wavelength, body))
        unequal = bias * self._wave(ahead + self.bias_phase, self.steering_wavelength, body)
        chambers = amplitude[..., None] * (pulse[..., None] + unequal[..., None] * LEFT_RIGHT)
        bend = hinge * self._wave(ahead + self.hinge_phase, self.steering_wavelength, body)
        return Commands(np.clip(chambers, *body.stroke), bend[:, 1:], np.zeros_like(chambers))

    def _wave(self, phase: FloatArray, wavelength: float, body: Body) -> FloatArray:
        x = (np.arange(body.segments) + 0.5) / body.segments
        sign = 1.0 if self.direction == "retrograde" else -1.0
        wave: FloatArray = np.sin(2.0 * np.pi * x / wavelength + sign * phase)
        return wave


@dataclass(frozen=True)
class SteeredWave:
    """The wave of constant parameters, as a gait; it swells from nothing like that of `control.gaits.generator`.

    Attributes
    ----------
    parameters : GaitParameters
    schedule : Schedule
    blend : float
        Waves in which the wave swells to 63 %.
    """

    parameters: GaitParameters
    schedule: Schedule = Schedule()
    blend: float = 0.25

    def __post_init__(self) -> None:
        arguments.instance("parameters", self.parameters, GaitParameters, "a control.gaits.steering.GaitParameters")
        arguments.instance("schedule", self.schedule, Schedule, "a control.gaits.steering.Schedule")
        arguments.number("blend", self.blend, "waves", gt=0.0)

    @property
    def period(self) -> float:
        """1 / f [s]."""
        return 1.0 / self.parameters.frequency

    def bind(self, worm: Body) -> BoundWave:
        """Return the actuation of `worm`: time [s] -> `worm3d.Command`."""
        return BoundWave(self, worm)


class BoundWave:
    """A steered wave as the actuation of one worm.

    Parameters
    ----------
    wave : SteeredWave
    worm : Body
    """

    def __init__(self, wave: SteeredWave, worm: Body) -> None:
        self._wave, self._worm = wave, worm

    def __call__(self, t: float) -> Command:
        """Return the command at time t [s]."""
        given = self.commands(np.array([t]))
        return Command(given.contraction[0], given.hinge[0])

    def commands(self, times: FloatArray) -> Commands:
        """Return the commands at K times [s] at once."""
        wave, asked = self._wave, self._wave.parameters
        swell = 1.0 - np.exp(-asked.frequency / wave.blend * times)
        parameters = asked.row() * np.column_stack([swell, np.ones_like(swell), swell, swell])
        return wave.schedule.commands(2.0 * np.pi * asked.frequency * times, parameters, self._worm)
