"""Channels of a robot's sensors: what each measures of the true state, and how well.

Each quantity is declared once, in `QUANTITIES`. Sensors, measurements, the gate, the section [sensor] of a scene and
the list of faults find it there by the name of its channel. A robot of one's own may add to the table:

    QUANTITIES["tail"] = Quantity("height of the tail", "m", Channel(noise=0.001), lambda seen: seen.joints[0, 2], ...)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from worm3d import Observation, Worm
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import check, documented, parameter

MAX_COORDINATE = 1e7
"""Largest magnitude of a coordinate that can be right, more than any grid on earth has [m]."""
MAX_ANGULAR_RATE = 100.0
"""Largest angular rate that can be right, three times the full range of usual gyroscopes of 2000 deg/s [rad/s]."""
MAX_LOAD = 1e5
"""Largest contact load per mass of the worm that can be right, ten thousand times its weight on earth [N/kg]."""
MAX_PRESSURE = 1e9
"""Largest pressure that can be right, ten times that of strong hydraulics [Pa]."""
MAX_HEADING = 1e4
"""Largest magnitude of a heading that can be right; sensors may count whole turns [rad]."""


@documented
@dataclass(frozen=True, kw_only=True)
class Channel:
    """Quality of a sensor; noise and bias are in the unit of what it measures."""

    noise: float = parameter(meaning="standard deviation of the white noise of each sample", ge=0)
    bias: float = parameter(0.0, meaning="standard deviation of its constant error, drawn once a run", ge=0)
    delay: float = parameter(0.0, meaning="time from the instant of a sample to its arrival", unit="s", ge=0)
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


def _any(right: NDArray[np.bool_]) -> bool:
    return bool(right.any())


def _always(worm: Worm) -> bool:
    return True


@dataclass(frozen=True)
class Quantity:
    """Quantity that a channel measures.

    Attributes
    ----------
    meaning : str
        What is measured, in a few words.
    unit : str
        Unit of a sample, "" for a pure number; scenes have degrees in place of radians.
    default : Channel
        Quality of a usual sensor.
    true_value : callable
        Observation -> value without error, an array; KeyError of a worm without this quantity.
    shape : callable
        Worm -> shape of a sample.
    limits : callable
        Worm -> least and greatest number that a sample can hold.
    mirrored : callable
        Value -> its mirror image, in which left and right, y and -y are exchanged.
    is_enough : callable
        Which numbers of a sample can be right, bool of its shape -> whether these are of use without the others.
    exists : callable
        Worm -> whether it has this quantity.
    standard : bool
        Whether a robot has such a sensor unless its user says otherwise.
    ordered : bool
        Whether a sample is of no use once one of a later instant has come.
    angle : bool
        Whether samples are wrapped to (-pi, pi].
    """

    meaning: str
    unit: str
    default: Channel
    true_value: Callable[[Observation], FloatArray]
    shape: Callable[[Worm], tuple[int, ...]]
    limits: Callable[[Worm], tuple[float, float]]
    mirrored: Callable[[FloatArray], FloatArray]
    is_enough: Callable[[NDArray[np.bool_]], bool] = _any
    exists: Callable[[Worm], bool] = _always
    standard: bool = False
    ordered: bool = False
    angle: bool = False


STRAIN = Channel(noise=0.01)
"""Quality of strain gauges: 1 % of a chamber's rest length."""
COM = Channel(noise=0.005, rate=20.0)
"""Quality of a camera: 5 mm in each direction, 20 pictures a second."""
HEADING = Channel(noise=float(np.deg2rad(1.1)))
"""Quality of a compass: 1.1 degrees."""
ANGULAR_RATE = Channel(noise=float(np.deg2rad(0.1)), bias=float(np.deg2rad(0.5)))
"""Quality of a MEMS gyroscope: 0.1 deg/s (a noise density of 0.01 deg/s/sqrt(Hz) over a bandwidth of 100 Hz), and a
zero-rate offset of 0.5 deg/s."""
CONTACT_LOAD = Channel(noise=0.005)
"""Quality of force sensors in the feet: 5 mN, a sixteenth of what a foot of the default worm bears."""
PRESSURE = Channel(noise=5.0, bias=50.0)
"""Quality of a MEMS barometer: 5 Pa, and a constant error of 50 Pa."""
QUANTITIES = {
    "strain": Quantity(  # l_c/l0 - 1, [left, right]
        "strain of the chambers",
        "",
        STRAIN,
        true_value=lambda seen: seen.chamber_strain,
        shape=lambda worm: (worm.segments, 2),
        limits=lambda worm: (-1.0, 2.0 * float(np.max(worm.link_length / worm.l0))),  # up to a chamber pressed flat
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
        limits=lambda worm: (-MAX_COORDINATE, MAX_COORDINATE),
        mirrored=lambda value: value * [1.0, -1.0, 1.0],
        is_enough=lambda right: bool(right[:2].all()),
        standard=True,
    ),
    "heading": Quantity(
        "heading",
        "rad",
        HEADING,
        true_value=lambda seen: np.array(seen.heading),
        shape=lambda worm: (),
        limits=lambda worm: (-MAX_HEADING, MAX_HEADING),
        mirrored=lambda value: -value,
        angle=True,
    ),
    "angular_rate": Quantity(  # of each segment in its own axes: forward, left, up
        "angular rate of the segments",
        "rad/s",
        ANGULAR_RATE,
        true_value=lambda seen: seen.angular_velocity,
        shape=lambda worm: (worm.segments, 3),
        limits=lambda worm: (-MAX_ANGULAR_RATE, MAX_ANGULAR_RATE),
        mirrored=lambda value: value * [-1.0, 1.0, -1.0],  # an axial vector
    ),
    "contact_load": Quantity(  # normal load of each apex, in the order of NOTATION.md
        "contact load of the apexes",
        "N",
        CONTACT_LOAD,
        true_value=lambda seen: seen.normal_load,
        shape=lambda worm: (worm.segments, 6),
        limits=lambda worm: (-MAX_LOAD * worm.mass, MAX_LOAD * worm.mass),
        mirrored=lambda value: value[:, [3, 4, 5, 0, 1, 2]],
    ),
    "pressure": Quantity(  # absolute, [left, right]
        "pressure of the chambers",
        "Pa",
        PRESSURE,
        true_value=lambda seen: seen.actuator_states["pressure"],
        shape=lambda worm: (worm.segments, 2),
        limits=lambda worm: (-MAX_PRESSURE, MAX_PRESSURE),
        mirrored=lambda value: value[:, ::-1],
        exists=lambda worm: "pressure" in type(worm.actuator).states,
    ),
}
"""Quantity of each channel, by its name."""


def require_known(names: Any) -> None:
    """Raise ValueError unless there is a channel of each name."""
    for name in names:
        if name not in QUANTITIES:
            raise ValueError(f"{name}: got a channel of this name, must be one of {', '.join(QUANTITIES)}")
