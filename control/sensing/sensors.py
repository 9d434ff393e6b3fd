"""Sensors: what the robot's instruments make of the true state; noise, bias, delay, dropout and rate of each.

A channel takes a sample when one is due, k / rate after its first, of the value at that instant:

    sample = value + bias + noise N(0, 1),   bias = bias deviation N(0, 1), once a run                         (M1)

each for every number of the value. It arrives `delay` later, at the next call; with the probability `dropout` it never
does. Random numbers are drawn sample by sample from a generator seeded by the seed and the channel's name, whatever is
measured: two runs whose samples are due at the same instants meet the same errors.

Mirror images: `Sensors(..., mirrored=True)` draws the same numbers, and mirrors their errors (y and azimuths change
sign, left and right change places). What it makes of a mirrored observation is the mirrored measurement.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, fields
from zlib import crc32

import numpy as np

from control.sensing.measurement import Measurement
from worm3d import Observation
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray

ROUNDING = 1e-9
"""By which an instant may be missed [s]: times are sums of time steps."""


@dataclass(frozen=True, kw_only=True)
class Channel:
    """How good an instrument is.

    Attributes
    ----------
    noise : float
        Standard deviation of the white noise of each sample, in the unit of the quantity.
    bias : float
        Standard deviation from which the constant error of a run is drawn.
    delay : float
        From the instant of a sample to its arrival [s].
    dropout : float
        Probability that a sample is lost, in [0, 1].
    rate : float
        Samples a second [Hz]; infinite: one at every call.

    Raises
    ------
    ValueError
        A value out of range.
    """

    noise: float
    bias: float = 0.0
    delay: float = 0.0
    dropout: float = 0.0
    rate: float = float("inf")

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name != "rate":
                arguments.number(field.name, getattr(self, field.name), ge=0.0)
        arguments.number("dropout", self.dropout, le=1.0, allowed="a probability, at most 1")
        rate = "above 0; infinite for a sample at every call"
        arguments.number("rate", self.rate, "Hz", gt=0.0, infinite=True, allowed=rate)


STRAIN = Channel(noise=0.01)
"""1 % of a chamber's rest length."""
COM = Channel(noise=0.005, rate=20.0)
"""5 mm in each direction, from a camera with 20 pictures a second."""
HEADING = Channel(noise=float(np.deg2rad(1.1)))
"""1.1 degrees, where there is such a sensor."""


class Sensors:
    """What a controller's measurements are made with; to be given to `worm3d.simulate` as `sensor`.

    Parameters
    ----------
    strain, com : Channel
        Of each chamber [1], and of each coordinate of the centre of mass [m].
    heading : Channel, optional
        Of the azimuth of the tail-to-head chord [rad]; None: there is no such sensor.
    seed : int
        At least 0.
    mirrored : bool
        Whether the errors are those of the mirror image.

    Raises
    ------
    ValueError
        A seed below 0.
    """

    def __init__(
        self,
        strain: Channel = STRAIN,
        com: Channel = COM,
        heading: Channel | None = None,
        seed: int = 0,
        mirrored: bool = False,
    ) -> None:
        arguments.whole("seed", seed, ge=0)
        for name, channel in (("strain", strain), ("com", com), ("heading", heading)):
            optional = Channel | None if name == "heading" else Channel
            arguments.instance(name, channel, optional, "a control.sensing.sensors.Channel")
        arguments.flag("mirrored", mirrored)
        self.channels = {"strain": strain, "com": com} | ({} if heading is None else {"heading": heading})
        self.seed, self.mirrored = seed, mirrored
        self.reset()

    def reset(self) -> None:
        """Begin anew, with the same errors."""
        self._instruments = {name: _Instrument(name, each, self.seed) for name, each in self.channels.items()}

    def __call__(self, seen: Observation) -> Measurement:
        """Return what has arrived by now."""
        values = {"strain": seen.chamber_strain, "com": seen.com, "heading": np.array(seen.heading)}
        for name, instrument in self._instruments.items():
            instrument.look(seen.time, values[name], self.mirrored)
        arrived = {name: instrument.arrived(seen.time) for name, instrument in self._instruments.items()}
        heading, heading_time = arrived.get("heading", (None, float("nan")))
        return Measurement(
            seen.time,
            *arrived["strain"],
            *arrived["com"],
            None if heading is None else _wrapped(float(heading)),
            heading_time,
        )


class _Instrument:
    """A channel at work."""

    def __init__(self, name: str, channel: Channel, seed: int) -> None:
        self._name, self._channel = name, channel
        self._random = np.random.default_rng([seed, crc32(name.encode())])
        self._bias: FloatArray | None = None
        self._begin, self._next = 0.0, 0
        self._last = float("nan")
        self._on_the_way: deque[tuple[float, FloatArray]] = deque()

    def look(self, t: float, value: FloatArray, mirrored: bool) -> None:
        """Take a sample, if one is due."""
        if self._bias is None:
            self._begin, self._bias = t, self._channel.bias * self._random.standard_normal(value.shape)
        if not self._due(t):
            return
        error = self._bias + self._channel.noise * self._random.standard_normal(value.shape)
        if self._random.uniform() >= self._channel.dropout:
            self._on_the_way.append((t, value + (_mirrored(self._name, error) if mirrored else error)))

    def _due(self, t: float) -> bool:
        """Return whether a sample is due; one that was missed is not made up for."""
        if np.isinf(self._channel.rate):
            return True
        count = int((t - self._begin + ROUNDING) * self._channel.rate)
        due, self._next = count >= self._next, max(self._next, count + 1)
        return due

    def arrived(self, t: float) -> tuple[FloatArray | None, float]:
        """Return the latest sample that has arrived since the last call, and the instant of the last one at all."""
        sample = None
        while self._on_the_way and self._on_the_way[0][0] + self._channel.delay <= t + ROUNDING:
            self._last, sample = self._on_the_way.popleft()
        return sample, self._last


def _mirrored(name: str, error: FloatArray) -> FloatArray:
    """Return the mirror image of an error."""
    if name == "strain":
        return error[:, ::-1]
    return -error if name == "heading" else error * [1.0, -1.0, 1.0]


def _wrapped(angle: float) -> float:
    """Return an angle in (-pi, pi]."""
    return float(np.pi - np.mod(np.pi - angle, 2.0 * np.pi))
