"""The estimator: where the worm is, where it heads and what it does besides what its gait should make it do.

It is an extended Kalman filter (`control.kalman`) on the reduced model (R1), fed with samples of the centre of mass
at the instants at which they were taken: a late one takes the filter back to its instant, and those after it are
taken again. The strains give the wave that rocks the centre of mass (`control.measured_wave`). A heading that is not
told at the start is sought from all sides at once, by a filter for each; they agree, or die out, within a wave or so
of crawling.

Why not the no-slip motion of the feet, or the mean over a wave? On the default worm the motion of feet that do not
slip, as the strains give it, explains a third to a half of how the speed changes within a wave, and a fifth of the
turn rate at best: its feet slide all the time. The mean of the centre of mass over a wave is half a wave old. And the
rocking (4 mm rms) taken for noise is no white noise: errors were twice what the covariance said (at 100 samples a
second).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.belief import HEADING, Belief, merged, reduced
from control.driven import Driven
from control.estimate import Estimate
from control.ground import Ground, GroundTrust, Standing
from control.kalman import ROCKING, SIZE, Kalman, Uncertainty
from control.measured_wave import MeasuredWave
from control.measurement import Measurement
from control.reduced import STATES, ReducedModel, ReducedState
from control.steering import GaitParameters, Schedule
from worm3d import Worm

__all__ = ["Estimate", "Estimator"]

FloatArray = NDArray[np.float64]

SPAN = 2.0
"""A sample that arrives later than this is not used [s]."""

PAUSE = 0.2
"""After such a time without samples the filter goes on without one [s]."""

SIDES = 12
"""Headings from which a filter starts where none is told."""

ANYWHERE = 10.0
"""Deviation of the position before the first sample [m]."""

BEGIN = {"speed": 0.02, "turn_rate": 0.05, "slip": 0.15, "yaw_bias": 0.01}
"""Deviations at the start, from a worm at rest that does what its map says [m/s], [rad/s], [1], [rad/s]."""
BEGIN_ROCKING = 0.05
"""[m] a unit of strain."""


@dataclass(frozen=True, eq=False)
class _Sample:
    """What arrived of an instant; nothing, where the filter just went on to it."""

    time: float
    com: FloatArray | None = None
    wave: FloatArray | None = None
    standing: float = 0.0
    heading: float | None = None


@dataclass(frozen=True, eq=False)
class _Fused:
    """A sample, and what is believed since."""

    sample: _Sample
    beliefs: list[Belief]
    ground: Ground
    nis: float | None


class Estimator:
    """Makes an estimate of each measurement.

    Parameters
    ----------
    worm : Worm
    model : ReducedModel
    schedule : Schedule, optional
        Of the wave; the default if left out.
    heading : float, optional
        At the start [rad]; None: not known.
    heading_deviation : float
        How uncertain that is [rad].
    uncertainty : Uncertainty, optional
        How far sensors and model are trusted.
    ground : GroundTrust, optional
        How the ground may be.

    Raises
    ------
    ValueError
        A heading that is not finite, or a deviation that is not above 0.
    """

    def __init__(
        self,
        worm: Worm,
        model: ReducedModel,
        schedule: Schedule | None = None,
        heading: float | None = None,
        heading_deviation: float = 0.05,
        uncertainty: Uncertainty | None = None,
        ground: GroundTrust | None = None,
    ) -> None:
        if heading is not None and not np.isfinite(heading):
            raise ValueError(f"heading: got {heading!r} rad, must be finite, or None where it is not known")
        if not (np.isfinite(heading_deviation) and heading_deviation > 0.0):
            raise ValueError(f"heading_deviation: got {heading_deviation!r} rad, must be finite and above 0")
        self._mechanism = model.mechanism
        trust = uncertainty or Uncertainty()
        self._filter = Kalman(model, trust)
        self._trust_ground = ground or GroundTrust()
        self._wave, self._standing = MeasuredWave(worm.segments, schedule or Schedule()), Standing(worm)
        self._driven = Driven(2.0 * SPAN)
        self._begin = _beginning(trust, heading, heading_deviation)
        self.reset()

    def reset(self) -> None:
        """Forget everything; a run begins."""
        self._wave.reset()
        self._driven.reset()
        self._past: list[_Fused] = []
        self._settled: list[tuple[float, float]] = []
        self._heights: deque[tuple[float, float]] = deque()

    def update(self, t: float, measurement: Measurement, parameters: GaitParameters, phase: float) -> Estimate:
        """Return the estimate of an instant.

        Parameters
        ----------
        t : float
            Now, later than at the last call [s].
        measurement : Measurement
        parameters : GaitParameters
            Asked for since the last call.
        phase : float
            Commanded phase [rad].
        """
        steering = getattr(parameters, self._mechanism)
        self._driven.add(t, np.array([parameters.amplitude, parameters.frequency, steering]), phase)
        if not self._past:
            self._past = [_Fused(_Sample(t), self._begin, Ground.unknown(self._trust_ground), None)]
        if measurement.strain is not None:
            self._look_at(measurement.strain, measurement.strain_time)
        for sample in self._arrived(measurement):
            self._take(sample)
        if t - self._past[-1].sample.time > PAUSE:
            self._take(_Sample(t - PAUSE / 2.0))
        self._forget(t - SPAN)
        return self._estimate(t)

    @property
    def innovations(self) -> list[tuple[float, float]]:
        """Instant [s] and nis of every sample of the centre of mass; see `control.consistency`."""
        return self._settled + [(each.sample.time, each.nis) for each in self._past if each.nis is not None]

    def _look_at(self, strain: FloatArray, instant: float) -> None:
        """Take in the shape of the body at an instant."""
        self._wave.take(strain, self._driven.phase(instant))
        self._heights.append((instant, self._standing.height(strain)))
        while self._heights[0][0] < instant - SPAN:
            self._heights.popleft()

    def _stood(self, t: float) -> float:
        """Return how high the body stood at an instant; 0 as long as no strains have arrived."""
        if not self._heights:
            return 0.0
        times, heights = np.array(self._heights).T
        return float(np.interp(t, times, heights))

    def _arrived(self, measurement: Measurement) -> list[_Sample]:
        """Return the samples of a measurement, in the order of their instants."""
        samples = []
        if measurement.com is not None:
            wave = self._wave.at(self._driven.phase(measurement.com_time))
            samples.append(_Sample(measurement.com_time, measurement.com, wave, self._stood(measurement.com_time)))
        if measurement.heading is not None:
            samples.append(_Sample(measurement.heading_time, heading=measurement.heading))
        return sorted(samples, key=lambda sample: sample.time)

    def _take(self, sample: _Sample) -> None:
        """Fuse a sample at its instant, and again all those after it."""
        if sample.time < self._past[0].sample.time:
            return
        again = []
        while self._past[-1].sample.time > sample.time:
            again.append(self._past.pop().sample)
        for each in (sample, *reversed(again)):
            self._past.append(self._fused(self._past[-1], each))

    def _fused(self, last: _Fused, sample: _Sample) -> _Fused:
        """Return what is believed at the instant of a sample and after it."""
        beliefs, ground, nis = self._predicted(last, sample.time), last.ground, None
        if sample.com is not None and sample.wave is not None:
            beliefs, nis = self._with_com(beliefs, sample.com[:2], sample.wave)
            ground = ground.sampled(merged(beliefs).mean[:2], sample.com[2] - sample.standing, self._trust_ground)
        if sample.heading is not None:
            beliefs = [self._filter.with_heading(belief, sample.heading) for belief in beliefs]
        return _Fused(sample, reduced(beliefs), ground, nis)

    def _with_com(self, beliefs: list[Belief], com: FloatArray, wave: FloatArray) -> tuple[list[Belief], float]:
        """Return the beliefs after a sample of the centre of mass, and the nis of the likeliest."""
        alone = len(beliefs) == 1  # while there are several, those for which it is impossible die out
        corrected = [self._filter.with_com(belief, com, wave, gated=alone) for belief in beliefs]
        best = max(corrected, key=lambda each: each.belief.log_weight)
        return [each.belief for each in corrected], best.nis

    def _predicted(self, last: _Fused, t: float) -> list[Belief]:
        """Return what is believed of a later instant."""
        beliefs = last.beliefs
        for given, seconds in self._driven.between(last.sample.time, t):
            beliefs = [self._filter.predicted(belief, given, last.ground.slope, seconds) for belief in beliefs]
        return beliefs

    def _forget(self, before: float) -> None:
        """Keep no samples that nothing can come before any more, but one to go on from."""
        while len(self._past) > 1 and self._past[1].sample.time < before:
            oldest = self._past.pop(0)
            if oldest.nis is not None:
                self._settled.append((oldest.sample.time, oldest.nis))

    def _estimate(self, t: float) -> Estimate:
        last = self._past[-1]
        now = merged(self._predicted(last, t))
        nis = next((each.nis for each in reversed(self._past) if each.nis is not None), None)
        return Estimate(
            time=t,
            state=ReducedState(*now.mean[:STATES].tolist()),
            covariance=now.covariance[:STATES, :STATES].copy(),
            nis=nis,
            slope=last.ground.slope.copy(),
            slope_covariance=last.ground.covariance[1:, 1:].copy(),
        )


def _beginning(trust: Uncertainty, heading: float | None, deviation: float) -> list[Belief]:
    """Return what is believed before the first sample: a belief for each heading that may be."""
    if heading is not None:
        return [_believed(trust, heading, deviation)]
    apart = 2.0 * np.pi / SIDES
    # Mirror images of each other, so that mirrored worms are treated alike.
    sides = ((np.arange(SIDES) + 0.5 - SIDES / 2.0) * apart).tolist()
    return [_believed(trust, side, apart / 2.0) for side in sides]


def _believed(trust: Uncertainty, heading: float, deviation: float) -> Belief:
    mean, deviations = np.zeros(SIZE), np.zeros(SIZE)
    mean[HEADING] = heading
    known = {"x": ANYWHERE, "y": ANYWHERE, "heading": deviation, "drift": trust.drift, **BEGIN}
    for name, each in known.items():
        deviations[ReducedState._fields.index(name)] = each
    deviations[ROCKING] = BEGIN_ROCKING
    return Belief(mean, np.diag(deviations**2))
