"""Sensors of the robot, which measure the true state with noise, bias, delay, dropouts and a limited rate.

Each quantity is declared once, in `QUANTITIES`. Sensors, measurements, the gate, the section [sensor] of a scene and
the list of faults look up the quantity by the name of its channel. Users may add quantities to this table:

    QUANTITIES["tail"] = Quantity("height of the tail", "m", Channel(noise=0.001), lambda seen: seen.joints[0, 2], ...)

A channel takes samples of the true value at multiples of 1 / rate after its first sample:

    sample = value + bias + noise N(0, 1),   bias = bias deviation N(0, 1), once a run                         (M1)

with separate random numbers for every number of the value. The sample arrives `delay` later, at the next call, or is
lost with the probability `dropout`. The random numbers come from a generator seeded by the seed and the channel's name.
They do not depend on the measured values. Two runs whose samples are due at the same instants therefore have the same
errors.

With `Sensors(..., mirrored=True)` the same random numbers are drawn, and the errors are mirrored: y and azimuths change
sign, left and right change places. A mirrored observation then gives the mirrored measurement.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from worm3d import Observation, Worm
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter
from worm3d.values.spelling import Spelled

SIDE_NAMES = ("left", "right")
"""Names of the sides of a segment, in the order of arrays."""
INSTANT_TOLERANCE = 1e-9
"""Tolerance for comparing instants, which are sums of time steps with rounding errors [s]."""


@documented
@dataclass(frozen=True, kw_only=True)
class Channel(Spelled):
    """Quality of a sensor. Noise and bias are in the unit of the measured quantity."""

    noise: float = parameter(meaning="standard deviation of the white noise of each sample", ge=0)
    bias: float = parameter(0.0, meaning="standard deviation of the constant error, which is drawn once a run", ge=0)
    delay: float = parameter(
        0.0, meaning="time from the instant of a sample to the arrival of the sample", unit="s", ge=0
    )
    dropout: float = parameter(
        0.0, meaning="probability that a sample is lost", ge=0, le=1, allowed="a probability, in [0, 1]"
    )
    rate: float = parameter(
        np.inf,
        meaning="samples a second",
        unit="Hz",
        gt=0,
        infinite=True,
        allowed="above 0; infinite for a sample at every call",
        left_out="at every time step",
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class Quantity(Spelled):
    """A quantity that a channel can measure."""

    meaning: str
    """What is measured, in a few words."""
    unit: str
    """Unit of a sample; "" for a number without unit. Scenes use degrees instead of radians."""
    default: Channel
    """Quality of a typical sensor."""
    true_value: Callable[[Observation], FloatArray]
    """Observation -> value without error, an array; KeyError of a worm without this quantity."""
    shape: Callable[[Worm], tuple[int, ...]]
    """Function of a worm that returns the shape of a sample."""
    limits: Callable[[Worm], tuple[float, float]]
    """Function of a worm that returns the smallest and the largest possible number in a sample."""
    mirrored: Callable[[FloatArray], FloatArray]
    """Function of a value that returns its mirror image: left and right, and y and -y, are exchanged."""
    is_enough: Callable[[NDArray[np.bool_]], bool] = lambda right: bool(right.any())
    """Function that says whether a partly valid sample is usable. Its argument is a bool mask of the valid numbers."""
    exists: Callable[[Worm], bool] = lambda worm: True
    """Function of a worm that says whether the worm has this quantity."""
    standard: bool = False
    """Whether a robot has this sensor by default."""
    ordered: bool = False
    """Whether a sample is useless once a sample of a later instant has arrived."""
    angle: bool = False
    """Whether samples are angles, which are wrapped to (-pi, pi]."""
    may_stay: float = 2.5
    """While the worm moves, a number may stay the same to the last bit for this time [s]. The default is the duration
    of a wave: a chamber rests during part of a wave, and its strain is then constant, whatever the resolution of the
    sensor."""


STRAIN = Channel(noise=0.01)
"""Quality of strain gauges: noise of 1 % of a chamber's rest length."""
COM = Channel(noise=0.005, rate=20.0)
"""Quality of a camera: noise of 5 mm in each direction, 20 pictures per second."""
HEADING_SENSOR = Channel(noise=float(np.deg2rad(1.1)))
"""Quality of a compass: noise of 1.1 degrees."""
QUANTITIES = {
    "strain": Quantity(  # l_c/l0 - 1, [left, right]
        "strain of the chambers",
        "",
        STRAIN,
        true_value=lambda seen: seen.chamber_strain,
        shape=lambda worm: (worm.segments, 2),
        limits=lambda worm: (-1.0, 2.0 * float(np.max(worm.segment.reach(worm) / worm.l0))),  # up to a flat chamber
        mirrored=lambda value: value[:, ::-1],
        is_enough=lambda right: 2 * int(right.any(axis=1).sum()) > len(right),
        standard=True,
        ordered=True,  # the wave in the strains is smoothed as they come
    ),
    "com": Quantity(
        "centre of mass",
        "m",
        COM,
        true_value=lambda seen: seen.com,
        shape=lambda worm: (3,),
        limits=lambda worm: (-1e7, 1e7),  # more than any grid on earth has
        mirrored=lambda value: value * [1.0, -1.0, 1.0],
        is_enough=lambda right: bool(right[:2].all()),
        standard=True,
        may_stay=0.12,
    ),
    "heading": Quantity(
        "heading",
        "rad",
        HEADING_SENSOR,
        true_value=lambda seen: np.array(seen.heading),
        shape=lambda worm: (),
        limits=lambda worm: (-1e4, 1e4),  # sensors may count whole turns
        mirrored=lambda value: -value,
        angle=True,
    ),
    "angular_rate": Quantity(  # of each segment in its own axes: forward, left, up
        "angular rate of the segments",
        "rad/s",
        # A MEMS gyroscope: 0.01 deg/s/sqrt(Hz) over a bandwidth of 100 Hz, and a zero-rate offset of 0.5 deg/s.
        Channel(noise=float(np.deg2rad(0.1)), bias=float(np.deg2rad(0.5))),
        true_value=lambda seen: seen.angular_velocity,
        shape=lambda worm: (worm.segments, 3),
        limits=lambda worm: (-100.0, 100.0),  # three times the full range of usual gyroscopes, 2000 deg/s
        mirrored=lambda value: value * [-1.0, 1.0, -1.0],  # an axial vector
    ),
    "contact_load": Quantity(  # normal load of each apex, in the order of NOTATION.md
        "contact load of the apexes",
        "N",
        Channel(noise=0.005),  # force sensors in the feet: a sixteenth of the load on a foot of the default worm
        true_value=lambda seen: seen.normal_load,
        shape=lambda worm: (worm.segments, 6),
        limits=lambda worm: (-1e5 * worm.mass, 1e5 * worm.mass),  # ten thousand times the weight on earth
        mirrored=lambda value: value[:, [3, 4, 5, 0, 1, 2]],
        may_stay=np.inf,  # an apex that touches nothing bears exactly nothing
    ),
    "pressure": Quantity(  # absolute, [left, right]
        "pressure of the chambers",
        "Pa",
        Channel(noise=5.0, bias=50.0),  # a MEMS barometer
        true_value=lambda seen: seen.actuator_states["pressure"],
        shape=lambda worm: (worm.segments, 2),
        limits=lambda worm: (-1e9, 1e9),  # ten times the pressure of strong hydraulics
        mirrored=lambda value: value[:, ::-1],
        exists=lambda worm: "pressure" in type(worm.actuator).states,
    ),
}
"""Quantity of each channel, by the channel's name."""

HOW_TO_ADD = 'for a channel of your own set sensor."my_module:NAME" = true in the scene, or enter it in QUANTITIES'


def require_known(names: Any) -> None:
    """Raise ValueError unless each name is the name of a channel."""
    for name in names:
        if name not in QUANTITIES:
            known = ", ".join(QUANTITIES)
            raise ValueError(f"{name}: got a channel of this name, must be one of {known}; {HOW_TO_ADD}")


class Sample(NamedTuple):
    """Latest sample of a channel."""

    value: Any
    """Measured value, an array of the channel's shape. None if no sample has arrived since the last measurement."""
    time: float
    """Instant of the latest sample that has arrived [s]. NaN if there was none."""


class Measurement(Mapping[str, Sample]):
    """Samples that a controller gets at one instant, by the name of their channel.

    `measurement.com` is the value of the channel "com", or None if there is no such sensor or no new sample.
    `measurement.com_time` is the instant of the sample [s], or NaN if there is none. The same holds for every channel.

    Parameters
    ----------
    time : float
        Present time [s].
    samples : Sample
        Sample of each channel of the robot, or a pair of value and instant [s]. ValueError if there is no such channel.
    """

    def __init__(self, time: float, **samples: Sample | tuple[Any, Any]) -> None:
        require_known(samples)
        self.time = time
        self._samples = {name: Sample(*sample) for name, sample in samples.items()}

    @classmethod
    def exact(cls, seen: Observation, channels: Iterable[str]) -> Measurement:
        """Return the measurement of a robot with perfect sensors in the given channels."""
        return cls(seen.time, **{name: (true_value(name, seen), seen.time) for name in channels})

    def changed(self, **samples: Sample | tuple[Any, Any]) -> Measurement:
        """Return the measurement with the samples of some channels replaced."""
        return Measurement(self.time, **{**self._samples, **samples})

    __eq__, __hash__ = object.__eq__, object.__hash__  # arrays have no single truth value

    def __getitem__(self, name: str) -> Sample:
        return self._samples[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._samples)

    def __len__(self) -> int:
        return len(self._samples)

    def __getattr__(self, name: str) -> Any:
        channel = name.removesuffix("_time")
        if channel not in QUANTITIES:
            raise AttributeError(f"measurement: has no {name!r}; its channels are {', '.join(QUANTITIES)}")
        sample = self._samples.get(channel, Sample(None, float("nan")))
        return sample.value if channel == name else sample.time


class Sensors:
    """Sensors of a robot, one per channel. An object of this class is the argument `sensor` of `worm3d.simulate`.

    Parameters
    ----------
    strain, com, heading : Channel, optional
        Quality of the sensors of the chambers' strain [1], of each coordinate of the centre of mass [m], and of the
        azimuth of the tail-to-head chord [rad]. None if the robot has no such sensor.
    seed : int
        Seed of all errors, at least 0.
    mirrored : bool
        Whether the errors are mirrored.
    others : Channel, optional
        Quality of the sensors of further channels of `QUANTITIES`, by name.

    Raises
    ------
    ValueError
        The seed is below 0, or there is no such channel.
    """

    def __init__(
        self,
        strain: Channel | None = STRAIN,
        com: Channel | None = COM,
        heading: Channel | None = None,
        seed: int = 0,
        mirrored: bool = False,
        **others: Channel | None,
    ) -> None:
        arguments.whole("seed", seed, ge=0)
        arguments.flag("mirrored", mirrored)
        require_known(others)
        given = {"strain": strain, "com": com, "heading": heading, **others}
        for name, channel in given.items():
            arguments.instance(name, channel, Channel | None, "a control.sensing.sensors.Channel")
        self.channels = {name: channel for name, channel in given.items() if channel is not None}
        self.seed, self.mirrored = seed, mirrored
        self.reset()

    def reset(self) -> None:
        """Return to the initial state. The same errors are drawn again."""
        self._instruments = {name: _Instrument(name, each, self) for name, each in self.channels.items()}

    def __call__(self, seen: Observation) -> Measurement:
        """Return the samples that have arrived by now."""
        return Measurement(seen.time, **{name: each.sample(seen) for name, each in self._instruments.items()})


class _Instrument:
    def __init__(self, name: str, channel: Channel, sensors: Sensors) -> None:
        self._name, self._quantity, self._channel = name, QUANTITIES[name], channel
        self._mirrored = sensors.mirrored
        self._random = np.random.default_rng([sensors.seed, crc32(name.encode())])
        self._bias: FloatArray | None = None
        self._begin, self._count, self._last = float("nan"), 0, float("nan")
        self._on_the_way: deque[tuple[float, FloatArray]] = deque()

    def sample(self, seen: Observation) -> Sample:
        """Take a sample if one is due, and return the latest sample that has arrived since the last call."""
        if self._is_due(seen.time):
            self._take(seen.time, true_value(self._name, seen))
        value = None
        while self._on_the_way and self._on_the_way[0][0] + self._channel.delay <= seen.time + INSTANT_TOLERANCE:
            self._last, value = self._on_the_way.popleft()
        return Sample(_wrapped(value) if self._quantity.angle and value is not None else value, self._last)

    def _is_due(self, t: float) -> bool:
        """Return whether a sample is due; a missed sample is not taken later."""
        if np.isinf(self._channel.rate):
            return True
        if np.isnan(self._begin):
            self._begin = t
        count = int((t - self._begin + INSTANT_TOLERANCE) * self._channel.rate)
        due, self._count = count >= self._count, max(self._count, count + 1)
        return due

    def _take(self, t: float, value: FloatArray) -> None:
        if self._bias is None:
            self._bias = self._channel.bias * self._random.standard_normal(value.shape)
        error = self._bias + self._channel.noise * self._random.standard_normal(value.shape)
        if self._random.uniform() >= self._channel.dropout:
            self._on_the_way.append((t, value + (self._quantity.mirrored(error) if self._mirrored else error)))


def true_value(name: str, seen: Observation) -> FloatArray:
    """Return the value of a channel without error. ValueError if the worm does not have this quantity."""
    try:
        return QUANTITIES[name].true_value(seen)
    except KeyError as error:
        raise ValueError(f"{name}: got a sensor of it, but this worm has no {QUANTITIES[name].meaning}") from error


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
