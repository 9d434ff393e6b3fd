"""Response of a worm to a wave, identified from short runs: distance, turn and drift a wave, and their lags.

A run of constant gait parameters is measured wave by wave in the steady state: the centre of mass and the heading, both
averaged over each wave, give per wave

    distance = d . (cos h, sin h) / L,   drift = d . (-sin h, cos h) / L,   turn = h_{k+1} - h_k             (I2)

where d is the step of the averaged centre of mass between waves k and k + 1, and h the mean of their headings. (I1) in
`control.identification.surrogate` maps amplitude, frequency and steering to each of the three. A step of the parameters
gives the lag: with y_k the rate (of distance, or of turning) in wave k after the step,

    lag = sum_k (y_end - y_k) / (y_end - y_begin)   [waves]                                                   (I3)

which is the time constant of a first-order response, or the delay, or their sum. The lag of the steering is measured
with sinusoidal steering instead: after a step the soft start of turning looks like a lag.

Below the least frequency f_0 of the map, down to frequency 0, the map is extrapolated: feet stick and slip by Coulomb's
law, so that a slower wave has the same effect, except that chambers follow a slower wave better. The middle frequency
f_m of the map gives the size of this difference:

    d(f) = d(f_0) + (d(f_0) - d(f_m)) (f_0 - f)/(f_m - f_0),   omega(f) = omega(f_0),   c(f) = c(f_0)          (I4)

(At f = 0.05 Hz and amplitudes of 0.15 and 0.3 the default worm goes 0.057 and 0.125 body lengths a wave; (I4) gives
0.058 and 0.115. At f_0 = 0.5 Hz the worm goes 0.046 and 0.103. At f = 0.05 Hz the worm turns by a quarter less than at
f_0.)

The default worm's maps come with this package; the user's cache holds other maps, in files named by a key of all inputs
of a map. This module does not use the simulator: `scenes.studies.identify` runs the plant.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from functools import cached_property
from itertools import product
from math import inf
from pathlib import Path
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from control.gaits.held import HeldSteering
from control.gaits.steering import GaitParameters, Mechanism, Schedule
from control.identification import surrogate
from control.identification.strain_model import StrainModel
from control.identification.surrogate import Misfit, Parity, Polynomial, Ranges
from worm3d import Friction, Worm
from worm3d.machine import cache
from worm3d.values.arrays import FloatArray

QUANTITIES: Mapping[str, Parity] = MappingProxyType({"distance": "even", "turn": "odd", "drift": "odd", "roll": "even"})
"""Quantities of a map, and their parity as functions of the steering."""

MAX_STEERING: dict[Mechanism, float] = {"hinge": 0.12, "bias": 0.06, "both": 1.0}
"""Greatest steering in the identification of the default worm. The worm stays on its feet with a clear margin."""

MAP_FORMAT_VERSION = 4
"""Version of the files and of the physics. It must be increased when a default parameter changes."""
MAP_FOLDER, SUFFIX = "identified", ".map"
"""Folder and suffix of the files in the user's cache."""
SHIPPED_MAPS = Path(__file__).parent / "worms"
"""Folder of the supplied files. They were made from all combinations of the design (`runs` = 240)."""


@dataclass(frozen=True)
class Motion:
    """Steady motion of a worm per wave, (I2)."""

    distance: float
    """Distance forward [body lengths]."""
    turn: float
    """Turn to the left [rad]."""
    drift: float
    """Distance to the left [body lengths]."""
    roll: float = np.nan
    """Greatest mean roll of the segments in a wave, as a magnitude [rad]. NaN if the roll was not measured."""


@dataclass(frozen=True)
class Sample:
    """Parameters and measured motion of one run."""

    parameters: GaitParameters
    motion: Motion


@dataclass(frozen=True)
class Design:
    """Runs for identifying a map: combinations of amplitudes, periods and steerings to the left.

    Only the most informative combinations are run (`surrogate.informative`). 120 of the 240 give as good a map as all.
    """

    amplitudes: tuple[float, ...] = (0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
    periods: tuple[float, ...] = (2.0, 1.6, 1.25, 1.0, 0.8)
    """Periods 1/f, multiples of the time step [s]."""
    steerings: tuple[float, ...] = (0.0, 0.04, 0.08, 0.125, 0.25, 0.5, 0.75, 1.0)
    """Steerings as fractions of the greatest steering."""
    waves: int = 7
    """Number of waves of each run."""
    skipped: int = 4
    """Number of waves at the start of each run that are not steady yet."""
    runs: int = 120
    """Number of runs."""

    def ranges(self, steering: float) -> Ranges:
        """Return the ranges of a map from these runs. `steering` is the greatest steering."""
        amplitude = min(self.amplitudes), max(self.amplitudes)
        return Ranges(amplitude, (1.0 / max(self.periods), 1.0 / min(self.periods)), float(steering))

    def parameters(self, mechanism: Mechanism, steering: float) -> list[GaitParameters]:
        """Return the parameters of each run. `steering` is the greatest steering."""
        grid = list(product(self.amplitudes, self.periods, self.steerings))
        places = [(amplitude, 1.0 / period, share * steering) for amplitude, period, share in grid]
        chosen = [places[k] for k in surrogate.informative(self.ranges(steering), places, self.runs)]
        return [GaitParameters(a, f).steered(mechanism, s) for a, f, s in chosen]


@dataclass(frozen=True)
class SteeringMap:
    """Distance, turn, drift and roll per wave as functions of amplitude, frequency and steering by one mechanism."""

    mechanism: Mechanism
    """Mechanism of the steering: "hinge" [rad], "bias" [1], or "both", as a share of the greatest steering."""
    ranges: Ranges
    distance: Polynomial
    """Distance forward [body lengths per wave]."""
    turn: Polynomial
    """Turn to the left [rad per wave]."""
    drift: Polynomial
    """Distance to the left [body lengths per wave]."""
    misfits: Mapping[str, Misfit]
    """Misfit of each polynomial for the fitted runs."""
    checks: Mapping[str, Misfit]
    """Misfit of each polynomial for other runs."""
    roll: Polynomial | None = None
    """Greatest mean roll of the segments in a wave [rad]. None if the roll is unknown."""

    def speed(self, amplitude: Any, frequency: Any, steering: Any) -> Any:
        """Return the forward speed [body lengths/s], (I4). Arguments may be numbers, arrays or CasADi symbols."""
        known, low = self._known(frequency), self.ranges.frequency[0]
        further = (known - frequency) / (self.ranges.middle - low) * self._gained(amplitude, low, steering)
        return frequency * (self.distance(amplitude, known, steering) + further)

    def turn_rate(self, amplitude: Any, frequency: Any, steering: Any) -> Any:
        """Return the turn rate to the left [rad/s], (I4)."""
        return frequency * self.turn(amplitude, self._known(frequency), steering)

    def drift_speed(self, amplitude: Any, frequency: Any, steering: Any) -> Any:
        """Return the speed to the left [body lengths/s], (I4)."""
        return frequency * self.drift(amplitude, self._known(frequency), steering)

    @cached_property
    def _gained(self) -> Polynomial:
        """Distance per wave at the smallest frequency minus the distance at the middle frequency."""
        return self.distance.rise(self.ranges.middle, self.ranges.frequency[0])

    def _known(self, frequency: Any) -> Any:
        """Return the frequency, but at least the smallest identified frequency."""
        least = self.ranges.frequency[0]
        return ca.fmax(frequency, least) if isinstance(frequency, ca.SX) else np.maximum(frequency, least)

    def as_dict(self) -> dict[str, Any]:
        """Return the map as a JSON object."""
        return {
            "ranges": asdict(self.ranges),
            "coefficients": {name: list(each.coefficients) for name in QUANTITIES if (each := getattr(self, name))},
            "misfits": {name: asdict(misfit) for name, misfit in self.misfits.items()},
            "checks": {name: asdict(misfit) for name, misfit in self.checks.items()},
        }

    @classmethod
    def from_dict(cls, mechanism: Mechanism, content: Mapping[str, Any]) -> SteeringMap:
        """Return the map from the result of `as_dict`."""
        given = content["ranges"]
        ranges = Ranges(tuple(given["amplitude"]), tuple(given["frequency"]), given["steering"])
        terms = content["coefficients"]
        found = {
            name: Polynomial(ranges, parity, tuple(terms[name])) for name, parity in QUANTITIES.items() if name in terms
        }
        misfits, checks = ({n: Misfit(**m) for n, m in content[key].items()} for key in ("misfits", "checks"))
        return cls(mechanism, ranges, **found, misfits=MappingProxyType(misfits), checks=MappingProxyType(checks))


@dataclass(frozen=True)
class Lags:
    """Lags of the motion behind changes of the gait parameters, (I3)."""

    amplitude: float
    """Lag of the speed after a step of the amplitude [waves]."""
    frequency: float
    """Lag of the speed after a step of the frequency [waves]."""
    steering: float
    """Lag of the turn rate behind the steering in force, measured with sinusoidal steering [s]. On the default worm it
    is 0.4 to 0.6 s from 0.6 to 1.1 Hz, or 0.8 to 0.95 s including the lag of the wave generator."""
    swing: float = 0.0
    """Additional speed to the left, compared with steady waves, divided by the turn acceleration: D of (R1), a linear
    fit extrapolated to frequency 0 [body lengths s]. 0 if it was not measured."""
    swing_rise: float = 0.0
    """Slope of this linear fit over the frequency [body lengths s/Hz]."""


@dataclass(frozen=True)
class Identified:
    """Identified properties of a worm on a ground."""

    schedule: Schedule
    maps: Mapping[Mechanism, SteeringMap]
    """Map of each mechanism."""
    lags: Mapping[Mechanism, Lags]
    """Lags of each mechanism."""
    backward: bool = False
    """Whether the worm crawls backwards as well as forwards (`is_reversible`). It is a property of the worm and not
    stored in files."""
    held: tuple[HeldSteering | None, ...] = ()
    """Entry i is the steering while segment i is held still. Empty if not identified."""
    grip: float = inf
    """Smallest coefficient of forward friction. The ground holds the worm on gradients up to this coefficient, which is
    not stored in files."""
    strain: StrainModel | None = None
    """Model of the strains while all chambers are healthy. None if it is unknown."""

    def on(self, worm: Worm, ground: Friction) -> Identified:
        """Return the map with those properties of a worm and a ground that need no run."""
        return replace(self, backward=is_reversible(worm, ground), grip=float(np.min(ground.forward)))

    def as_dict(self) -> dict[str, Any]:
        """Return the maps and lags as a JSON object."""
        return {
            "schedule": asdict(self.schedule),
            "maps": {mechanism: found.as_dict() for mechanism, found in self.maps.items()},
            "lags": {mechanism: asdict(lags) for mechanism, lags in self.lags.items()},
            "held": [each and asdict(each) for each in self.held],
            **({} if self.strain is None else {"strain": self.strain.as_dict()}),
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Identified:
        """Return the object from the result of `as_dict`."""
        return cls(
            Schedule(**content["schedule"]),
            MappingProxyType({name: SteeringMap.from_dict(name, found) for name, found in content["maps"].items()}),
            MappingProxyType({name: Lags(**lags) for name, lags in content["lags"].items()}),
            held=tuple(each and HeldSteering.from_dict(each) for each in content.get("held", ())),
            strain=StrainModel.from_dict(content["strain"]) if "strain" in content else None,
        )


def steady_motion(com: FloatArray, heading: FloatArray, rows: int, skipped: int, length: float) -> Motion:
    """Return the mean motion per wave, (I2), in a run with constant parameters.

    `com` is the centre of mass, shape (T, 2) or (T, 3) [m], and `heading` the unwrapped heading, shape (T,) [rad]. They
    have one row for the start, followed by `rows` rows per wave. The first `skipped` waves are ignored. `length` is the
    length of the body [m].

    Raises
    ------
    ValueError
        Fewer than two waves remain, or the heading is NaN.
    """
    waves = (len(heading) - 1) // rows
    if waves - skipped < 2:
        raise ValueError(f"steady_motion: got {waves} waves of which {skipped} are skipped, must leave at least 2")
    mean_com = com[1 : waves * rows + 1, :2].reshape(waves, rows, 2).mean(axis=1)[skipped:]
    h = heading[1 : waves * rows + 1].reshape(waves, rows).mean(axis=1)[skipped:]
    if not np.isfinite(h).all():
        raise ValueError("steady_motion: the worm lost its heading (its chord became vertical)")
    step, along = np.diff(mean_com, axis=0) / length, (h[1:] + h[:-1]) / 2.0
    forward = step[:, 0] * np.cos(along) + step[:, 1] * np.sin(along)
    left = step[:, 1] * np.cos(along) - step[:, 0] * np.sin(along)
    return Motion(float(forward.mean()), float(np.diff(h).mean()), float(left.mean()))


def lag(rates: Sequence[float] | FloatArray, before: int, settled: int = 3) -> float:
    """Return the lag (I3) of a rate behind a step after `before` waves [waves]. `rates` has one value per wave.

    The initial rate is the mean over the last `settled` waves before the step, the final rate the mean over the last
    `settled` waves of the run.

    Raises ValueError if the step changes the rate by less than a millionth.
    """
    y = np.asarray(rates, dtype=float)
    begin, end = y[before - settled : before].mean(), y[-settled:].mean()
    if abs(end - begin) <= 1e-6 * max(abs(end), abs(begin)):
        raise ValueError(f"lag: the rate is {end!r} before and after the step, must change")
    return float(np.sum((end - y[before:]) / (end - begin)))


def fit_map(
    mechanism: Mechanism,
    ranges: Ranges,
    samples: Sequence[Sample],
    checks: Sequence[Sample],
    similar: SteeringMap | None = None,
) -> SteeringMap:
    """Return the map of one mechanism, fitted to `samples` and compared with `checks`.

    If the map of a `similar` worm is given, this map is corrected instead, which needs fewer samples. ValueError if
    there are too few samples.
    """
    where, seen = _table(mechanism, samples)
    other, there = _table(mechanism, checks)
    known = {name: parity for name, parity in QUANTITIES.items() if np.isfinite([*seen[name], *there[name]]).all()}
    found: dict[str, Polynomial] = {}
    for name, parity in known.items():
        usual: Polynomial | None = getattr(similar, name, None)
        if similar is None:
            found[name] = surrogate.fit(ranges, parity, where, seen[name])
        elif usual is not None:
            found[name] = surrogate.corrected(usual.within(ranges), where, seen[name])
    return SteeringMap(
        mechanism,
        ranges,
        **found,
        misfits=MappingProxyType({name: surrogate.misfit(found[name], where, seen[name]) for name in found}),
        checks=MappingProxyType({name: surrogate.misfit(found[name], other, there[name]) for name in found}),
    )


def _table(mechanism: Mechanism, samples: Sequence[Sample]) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return amplitude, frequency and steering of samples, shape (M, 3), and each quantity, shape (M,)."""
    given = [(s.parameters.amplitude, s.parameters.frequency, s.parameters.steering(mechanism)) for s in samples]
    return np.array(given), {name: np.array([getattr(s.motion, name) for s in samples]) for name in QUANTITIES}


def load(
    worm: Worm, ground: Friction | None = None, schedule: Schedule | None = None, design: Design | None = None
) -> Identified | None:
    """Return the maps and lags of a worm on a ground. None if they were not identified (`worm3d study identify`)."""
    name = key(worm, ground or Friction(), schedule or Schedule(), design or Design())
    shipped = SHIPPED_MAPS / f"{name}.json"
    content = shipped.read_bytes() if shipped.is_file() else cache.load(cache.folder(MAP_FOLDER), name, SUFFIX)
    if content is None:
        return None
    return Identified.from_dict(json.loads(content)).on(worm, ground or Friction())


def is_reversible(worm: Worm, ground: Friction) -> bool:
    """Return whether a worm is the same from both ends, and friction is the same forward and backward.

    By (S3) of `control.gaits.steering` such a worm can crawl backwards.
    """
    return bool(np.array_equal(ground.forward, ground.backward)) and _is_symmetric(worm) and _is_symmetric(ground)


def _is_symmetric(thing: Any) -> bool:
    """Return whether half a turn leaves the fields (N, ...) or (N, 2), left and right, of a part unchanged."""
    for field in fields(thing):
        value = getattr(thing, field.name)
        if isinstance(value, np.ndarray) and value.ndim:
            turned = value[::-1, ::-1] if value.ndim > 1 else value[::-1]
            if not np.array_equal(value, turned):
                return False
        elif is_dataclass(value) and not _is_symmetric(value):
            return False
    return True


def store(identified: Identified, worm: Worm, ground: Friction, design: Design, folder: Path | None = None) -> bool:
    """Store the identified properties in the user's cache or another folder, and return whether this succeeded."""
    name = key(worm, ground, identified.schedule, design)
    content = json.dumps(identified.as_dict(), indent=1, allow_nan=False) + "\n"
    return cache.store(folder or cache.folder(MAP_FOLDER), name, content.encode(), SUFFIX)


def key(worm: Worm, ground: Friction, schedule: Schedule, design: Design) -> str:
    """Return the file name of a worm on a ground. It does not depend on parameters with default values."""
    content = {
        "format": MAP_FORMAT_VERSION,
        "worm": _unusual(worm),
        "ground": _unusual(ground),
        "schedule": {name: value for name, value in asdict(schedule).items() if (name, value) != ("steepness", 1.0)},
        "design": asdict(design),
        "max_steering": MAX_STEERING,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:24]


def parameters(thing: Any) -> dict[str, Any]:
    """Return the fields of a worm, a ground or a part for JSON. An array of equal numbers becomes one number."""
    return {field.name: _plain(getattr(thing, field.name)) for field in fields(thing)}


def _unusual(thing: Worm | Friction) -> dict[str, Any]:
    """Return the parameters that differ from the defaults, so that a parameter added later changes no key."""
    default = parameters(type(thing)())
    return {name: value for name, value in parameters(thing).items() if value != default[name]}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return float(value.flat[0]) if value.size and (value == value.flat[0]).all() else value.tolist()
    if isinstance(value, tuple):
        return list(map(_plain, value))
    if is_dataclass(value):  # a part, such as the law of friction or an actuator
        return {"class": type(value).__qualname__, **parameters(value)}
    return value if value is None or isinstance(value, bool | int | str) or np.isfinite(value) else repr(value)
