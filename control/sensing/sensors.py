"""Sensors: what the robot's instruments make of the true state, with noise, bias, delay, dropout and rate of each.

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
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from control.sensing.channels import COM, HEADING, QUANTITIES, STRAIN, Channel, require_known
from worm3d import Observation
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray

__all__ = ["COM", "HEADING", "STRAIN", "Channel", "Measurement", "Sample", "Sensors"]

ROUNDING = 1e-9
"""Time by which an instant may be missed, since times are sums of time steps [s]."""


class Sample(NamedTuple):
    """Latest sample of a channel."""

    value: Any
    """What was measured, an array of the channel's shape; None if nothing has arrived since the last measurement."""
    time: float
    """Instant of this sample, or of the last one before [s]; NaN: there was none."""


class Measurement(Mapping[str, Sample]):
    """Samples that a controller gets at an instant, by the name of their channel.

    `measurement.com` is short for the value of the channel "com", None without such a sensor; `measurement.com_time` is
    short for its instant, NaN without. The same holds for every channel.

    Parameters
    ----------
    time : float
        Now [s].
    samples : Sample
        Sample of each channel of the robot, or a pair of its value and instant [s].

    Raises
    ------
    ValueError
        There is no such channel.
    """

    def __init__(self, time: float, **samples: Sample | tuple[Any, Any]) -> None:
        require_known(samples)
        self.time = time
        self._samples = {name: Sample(*sample) for name, sample in samples.items()}

    @classmethod
    def exact(cls, seen: Observation, channels: Iterable[str]) -> Measurement:
        """Return the measurement of a robot with perfect sensors of some channels."""
        return cls(seen.time, **{name: (true_value(name, seen), seen.time) for name in channels})

    def changed(self, **samples: Sample | tuple[Any, Any]) -> Measurement:
        """Return the measurement with other samples of some channels."""
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
    """Sensors of a robot, one for each channel; they make the measurements of `worm3d.simulate(..., sensor=...)`.

    Parameters
    ----------
    strain, com, heading : Channel, optional
        Quality of the sensors of the chambers' strain [1], of each coordinate of the centre of mass [m], and of the
        azimuth of the tail-to-head chord [rad]; None: there is no such sensor.
    seed : int
        Seed of all errors, at least 0.
    mirrored : bool
        Whether the errors are those of the mirror image.
    others : Channel, optional
        Quality of the sensors of further channels of `control.sensing.channels.QUANTITIES`, by name.

    Attributes
    ----------
    channels : dict of str to Channel
        Those that there are.

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
        """Begin anew, with the same errors."""
        self._instruments = {name: _Instrument(name, each, self) for name, each in self.channels.items()}

    def __call__(self, seen: Observation) -> Measurement:
        """Return what has arrived by now."""
        return Measurement(seen.time, **{name: each.sample(seen) for name, each in self._instruments.items()})


class _Instrument:
    """A channel at work."""

    def __init__(self, name: str, channel: Channel, sensors: Sensors) -> None:
        self._name, self._quantity, self._channel = name, QUANTITIES[name], channel
        self._mirrored = sensors.mirrored
        self._random = np.random.default_rng([sensors.seed, crc32(name.encode())])
        self._bias: FloatArray | None = None
        self._begin, self._count = float("nan"), 0
        self._last = float("nan")
        self._on_the_way: deque[tuple[float, FloatArray]] = deque()

    def sample(self, seen: Observation) -> Sample:
        """Take a sample if one is due, and return the latest that has arrived since the last call."""
        if self._is_due(seen.time):
            self._take(seen.time, true_value(self._name, seen))
        value = None
        while self._on_the_way and self._on_the_way[0][0] + self._channel.delay <= seen.time + ROUNDING:
            self._last, value = self._on_the_way.popleft()
        return Sample(_wrapped(value) if self._quantity.angle and value is not None else value, self._last)

    def _is_due(self, t: float) -> bool:
        """Return whether a sample is due; one that was missed is not made up for."""
        if np.isinf(self._channel.rate):
            return True
        if np.isnan(self._begin):
            self._begin = t
        count = int((t - self._begin + ROUNDING) * self._channel.rate)
        due, self._count = count >= self._count, max(self._count, count + 1)
        return due

    def _take(self, t: float, value: FloatArray) -> None:
        if self._bias is None:
            self._bias = self._channel.bias * self._random.standard_normal(value.shape)
        error = self._bias + self._channel.noise * self._random.standard_normal(value.shape)
        if self._random.uniform() >= self._channel.dropout:
            self._on_the_way.append((t, value + (self._quantity.mirrored(error) if self._mirrored else error)))


def true_value(name: str, seen: Observation) -> FloatArray:
    """Return the value of a channel without error.

    Raises
    ------
    ValueError
        The worm does not have this quantity.
    """
    try:
        return QUANTITIES[name].true_value(seen)
    except KeyError as error:
        raise ValueError(f"{name}: got a sensor of it, but this worm has no {QUANTITIES[name].meaning}") from error


def _wrapped(angle: FloatArray) -> FloatArray:
    """Return angles in (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2.0 * np.pi)
