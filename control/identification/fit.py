"""What a worm does with a wave, identified from short runs: distance, turn and drift a wave, and how they lag.

A run of constant gait parameters is measured wave by wave once it is steady: the centre of mass averaged over each
wave, and the heading likewise, give per wave

    distance = d . (cos h, sin h) / L,   drift = d . (-sin h, cos h) / L,   turn = h_{k+1} - h_k             (I2)

d being the step of the averaged centre of mass between waves k and k + 1 and h the mean of their headings. A map of
each over amplitude, frequency and steering is (I1), `control.identification.surrogate`. A step of the parameters gives
the lag: with y_k the rate (of distance, or of turning) in wave k after the step,

    lag = sum_k (y_end - y_k) / (y_end - y_begin)   [waves]                                                   (I3)

which is the time constant of a first-order response, or its delay, or their sum. That of the steering is found by sines
of it instead: behind a step the soft start of turning looks like a lag.

The simulator is not touched here: `scenes.commands.identify` runs the plant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np

from control.gaits.steering import GaitParameters, Mechanism, Schedule
from control.identification import surrogate
from control.identification.surrogate import Misfit, Parity, Polynomial, Ranges
from worm3d.values.arrays import FloatArray

QUANTITIES: Mapping[str, Parity] = MappingProxyType({"distance": "even", "turn": "odd", "drift": "odd"})
"""What is mapped, and its parity in the steering."""


@dataclass(frozen=True)
class Motion:
    """Steady motion of a worm a wave, (I2).

    Attributes
    ----------
    distance : float
        Forward [body lengths].
    turn : float
        To the left [rad].
    drift : float
        To the left [body lengths].
    """

    distance: float
    turn: float
    drift: float


@dataclass(frozen=True)
class Sample:
    """One run: the parameters and what the worm did."""

    parameters: GaitParameters
    motion: Motion


@dataclass(frozen=True)
class Design:
    """The runs that identify a map: every amplitude with every period and every steering, to the left only.

    Attributes
    ----------
    amplitudes : tuple of float
    periods : tuple of float
        1/f; multiples of the time step [s].
    steerings : tuple of float
        As fractions of the greatest.
    waves, skipped : int
        Of each run, and how many of them are not steady yet.
    """

    amplitudes: tuple[float, ...] = (0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
    periods: tuple[float, ...] = (2.0, 1.6, 1.25, 1.0, 0.8)
    steerings: tuple[float, ...] = (0.0, 0.04, 0.08, 0.125, 0.25, 0.5, 0.75, 1.0)
    waves: int = 7
    skipped: int = 4

    def ranges(self, steering: float) -> Ranges:
        """Return where a map of these runs holds; `steering` is the greatest."""
        frequencies = [1.0 / period for period in self.periods]
        return Ranges(
            (min(self.amplitudes), max(self.amplitudes)), (min(frequencies), max(frequencies)), float(steering)
        )

    def parameters(self, mechanism: Mechanism, steering: float) -> list[GaitParameters]:
        """Return the parameters of each run."""
        return [
            GaitParameters(amplitude, 1.0 / period).steered(mechanism, share * steering)
            for amplitude, period, share in product(self.amplitudes, self.periods, self.steerings)
        ]


@dataclass(frozen=True)
class SteeringMap:
    """What one mechanism of steering does: distance, turn and drift a wave over amplitude, frequency and steering.

    Attributes
    ----------
    mechanism : str
        "hinge" [rad] or "bias" [1]: what the steering is.
    ranges : Ranges
    distance, turn, drift : Polynomial
        [body lengths a wave], [rad a wave], [body lengths a wave].
    misfits : mapping of str to Misfit
        Of each of them, over the runs that it was fitted to.
    checks : mapping of str to Misfit
        Likewise over other runs.
    """

    mechanism: Mechanism
    ranges: Ranges
    distance: Polynomial
    turn: Polynomial
    drift: Polynomial
    misfits: Mapping[str, Misfit]
    checks: Mapping[str, Misfit]

    def speed(self, amplitude: Any, frequency: Any, steering: Any) -> Any:
        """Return the forward speed [body lengths/s]; numbers, arrays or CasADi's symbols."""
        return frequency * self.distance(amplitude, frequency, steering)

    def turn_rate(self, amplitude: Any, frequency: Any, steering: Any) -> Any:
        """Return the turn rate to the left [rad/s]."""
        return frequency * self.turn(amplitude, frequency, steering)

    def drift_speed(self, amplitude: Any, frequency: Any, steering: Any) -> Any:
        """Return the speed to the left [body lengths/s]."""
        return frequency * self.drift(amplitude, frequency, steering)


@dataclass(frozen=True)
class Lags:
    """How long motion takes to follow the gait parameters, (I3).

    Attributes
    ----------
    amplitude, frequency : float
        Speed after a step of the amplitude, and of the frequency [waves].
    steering : float
        Turn rate behind the steering in force, by sines of it [s]. (On the default worm 0.4 to 0.6 s from 0.6 to 1.1
        Hz; with the wave generator's own lag, 0.8 to 0.95 s.)
    """

    amplitude: float
    frequency: float
    steering: float


@dataclass(frozen=True)
class Identified:
    """All that is known of a worm on a ground.

    Attributes
    ----------
    schedule : Schedule
    maps : mapping of str to SteeringMap
        By mechanism.
    lags : mapping of str to Lags
        By mechanism.
    """

    schedule: Schedule
    maps: Mapping[Mechanism, SteeringMap]
    lags: Mapping[Mechanism, Lags]

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return {
            "schedule": asdict(self.schedule),
            "maps": {mechanism: _of_map(found) for mechanism, found in self.maps.items()},
            "lags": {mechanism: asdict(lags) for mechanism, lags in self.lags.items()},
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Identified:
        """Return what `as_dict` made content of."""
        return cls(
            Schedule(**content["schedule"]),
            MappingProxyType({name: _to_map(name, found) for name, found in content["maps"].items()}),
            MappingProxyType({name: Lags(**lags) for name, lags in content["lags"].items()}),
        )


def steady_motion(com: FloatArray, heading: FloatArray, rows: int, skipped: int, length: float) -> Motion:
    """Return the mean motion a wave, (I2), of a run of constant parameters.

    Parameters
    ----------
    com : ndarray, shape (T, 2 or 3)
        Centre of mass [m].
    heading : ndarray, shape (T,)
        Unwrapped [rad].
    rows : int
        Rows of a wave; the first row is the start.
    skipped : int
        Waves at the beginning that are left out.
    length : float
        Of the body [m].

    Raises
    ------
    ValueError
        Fewer than two waves are left, or the heading is lost (NaN).
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
    """Return how many waves a rate lags behind a step, (I3).

    Parameters
    ----------
    rates : array_like, shape (K,)
        In each wave.
    before : int
        Waves before the step; the mean of the last `settled` of them is the rate at the beginning.
    settled : int
        Waves at the end that give the rate at the end.

    Raises
    ------
    ValueError
        The step changes the rate by less than a millionth: it has no response.
    """
    y = np.asarray(rates, dtype=float)
    begin, end = y[before - settled : before].mean(), y[-settled:].mean()
    if abs(end - begin) <= 1e-6 * max(abs(end), abs(begin)):
        raise ValueError(f"lag: the rate is {end!r} before and after the step, must change")
    return float(np.sum((end - y[before:]) / (end - begin)))


def fit_map(mechanism: Mechanism, ranges: Ranges, samples: Sequence[Sample], checks: Sequence[Sample]) -> SteeringMap:
    """Return the map of one mechanism, fitted to samples and compared with other ones.

    Raises
    ------
    ValueError
        The samples do not determine the map.
    """
    where, seen = table(mechanism, samples)
    other, there = table(mechanism, checks)
    found = {name: surrogate.fit(ranges, parity, where, seen[name]) for name, parity in QUANTITIES.items()}
    return SteeringMap(
        mechanism,
        ranges,
        **found,
        misfits=MappingProxyType({name: surrogate.misfit(found[name], where, seen[name]) for name in found}),
        checks=MappingProxyType({name: surrogate.misfit(found[name], other, there[name]) for name in found}),
    )


def table(mechanism: Mechanism, samples: Sequence[Sample]) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return amplitude, frequency and steering of samples, shape (M, 3), and each quantity, shape (M,)."""
    given = [(s.parameters.amplitude, s.parameters.frequency, getattr(s.parameters, mechanism)) for s in samples]
    return np.array(given), {name: np.array([getattr(s.motion, name) for s in samples]) for name in QUANTITIES}


def _of_map(found: SteeringMap) -> dict[str, Any]:
    return {
        "ranges": asdict(found.ranges),
        "coefficients": {name: list(getattr(found, name).coefficients) for name in QUANTITIES},
        "misfits": {name: asdict(misfit) for name, misfit in found.misfits.items()},
        "checks": {name: asdict(misfit) for name, misfit in found.checks.items()},
    }


def _to_map(mechanism: Mechanism, content: Mapping[str, Any]) -> SteeringMap:
    given = content["ranges"]
    ranges = Ranges(tuple(given["amplitude"]), tuple(given["frequency"]), given["steering"])
    found = {
        name: Polynomial(ranges, parity, tuple(content["coefficients"][name])) for name, parity in QUANTITIES.items()
    }
    kept = {key: MappingProxyType({n: Misfit(**m) for n, m in content[key].items()}) for key in ("misfits", "checks")}
    return SteeringMap(mechanism, ranges, **found, misfits=kept["misfits"], checks=kept["checks"])
