"""Estimator of a worm's position, heading and motion, including motion that the gait does not explain.

The estimator is an extended Kalman filter (`control.estimation.kalman`) for the reduced model (R1). When a delayed
sample of the centre of mass arrives, the filter returns to the instant of the sample, and then processes the later
samples again. The filter assumes the stated noise of the sensors, unless the innovations show a different noise
(KF8). The strains give the wave that rocks the centre of mass (`control.estimation.wave`). Gyroscopes, if there are
any, give the mean turn rate (`control.estimation.turning`). If the initial heading is unknown, several filters start
with headings all round the circle. Within about one wave of crawling, they agree or are dropped.

Other methods were tried and gave worse results.

* The strains give the motion that a worm would have if its feet did not slip. This motion explains a third to a half
  of the changes of the speed within a wave, and at most a fifth of the turn rate, because the feet of the default worm
  slide all the time.
* Contact loads would improve little even if they were exact. The speed at which Coulomb friction balances under these
  loads differs from the true speed, averaged over a wave, by 2 to 3 mm/s (the filter's error is 1.5 mm/s). Even this
  accuracy needs a factor and an offset fitted to each ground: 1.5 and -15 mm/s on the default ground, 1.2 and -4 mm/s
  on a slope of 3 degrees and with four times the friction (seeds 10 and 11). Loads do not improve the turn rate.
* The mean of the samples of the centre of mass over the latest wave does not contain the rocking, but is the position
  half a wave ago.
* The rocking (4 mm rms) is not white noise. When the filter treated it as noise, the errors were twice as large as the
  covariance indicated (at 100 samples per second).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf, nan

import numpy as np

from control.estimation.estimate import Belief, Estimate, merged, pruned
from control.estimation.ground import ANYWHERE, Ground, GroundTrust, Standing
from control.estimation.kalman import (
    GAINS,
    IMPOSSIBLE,
    RIPPLE,
    ROCKING,
    SIZE,
    Corrected,
    Kalman,
    Uncertainty,
    size_of,
    widened,
)
from control.estimation.noise import Noise
from control.estimation.reduced import INDEX, STATES, ReducedModel, ReducedState
from control.estimation.turning import MeanRate
from control.estimation.wave import InputHistory, MeasuredWave
from control.gaits.steering import GaitParameters, Schedule
from control.sensing.gate import CLOCK_TOLERANCE, SPAN
from control.sensing.sensors import COM, HEADING_SENSOR, Channel, Measurement
from worm3d import Worm
from worm3d.values import arguments
from worm3d.values.arrays import FloatArray

__all__ = ["Estimate", "Estimator"]

PAUSE = 0.2
"""Time without samples after which the filter advances without a sample [s]."""
ROCKED = 0.016
"""Standard deviation of the difference between the chord's azimuth and the heading, caused by the wave [rad]."""
NOISIEST = 0.2
"""Upper limit of the estimated noise of the centre of mass [body lengths]."""
TOO_SURE = 1.5
"""If the estimated noise exceeds the noise assumed for the latest sample by this factor, the stored samples are
processed again."""
BEGIN = {"speed": 0.08, "turn_rate": 0.05, "slip": 0.15, "yaw_bias": 0.01, "turn_gain": 0.2}
"""Initial standard deviations: speed [body lengths/s], turn rate and yaw bias [rad/s], slip and gain of turning [1].
The initial means are the values of a worm at rest whose motion equals the prediction of the identified map."""
CRAB_NOISE, BEGIN_CRAB = 0.01, 0.1
"""Noise [rad/sqrt(s)] and initial standard deviation [rad] of the crab angle if a sensor measures the heading."""
UNSTEADY = 0.005
"""Standard deviation of the difference between the turn rate in the middle of a wave and the mean of the wave
[rad/s]."""
BEGIN_ROCKING = 0.05
"""Initial standard deviation of the entries of C, the matrix of the rocking in (KF3) [body lengths]."""


@dataclass(frozen=True, eq=False)
class _Sample:
    """Samples of one instant. `com`, `heading` and `rate` are all None if the filter only advanced to this instant."""

    time: float
    com: FloatArray | None = None
    wave: FloatArray | None = None
    """Measured wave (W2) at this instant, shape (2,)."""
    deviation: float = 0.0
    """Standard deviation of `com` that the filter assumed [m]."""
    standing: float = 0.0
    """Height of the axis above the ground by (KF5) [m]."""
    frequency: float = 0.0
    """Frequency of the wave [Hz]."""
    heading: float | None = None
    rate: float | None = None
    """Mean turn rate of a wave by gyroscopes (TR1) [rad/s]."""


@dataclass(eq=False)
class _Fused:
    """A sample and the beliefs after it. `placed` is the instant of the last sample of the centre of mass [s]."""

    sample: _Sample
    beliefs: list[Belief]
    ground: Ground
    nis: float | None = None
    placed: float | None = None
    refused: int = 0
    pushed: int = 0
    jumped: int = 0


class Estimator:
    """Extended Kalman filter of a worm. The attribute `noise` estimates the noise of samples of the centre of mass.

    Parameters
    ----------
    worm : Worm
    model : ReducedModel
    schedule : Schedule, optional
    heading : float, optional
        Initial heading [rad]. None if it is unknown.
    heading_deviation : float
        Standard deviation of the initial heading [rad].
    uncertainty : Uncertainty, optional
    ground : GroundTrust, optional
    span : float
        Age beyond which a sample is not used [s].

    Raises
    ------
    ValueError
        The heading is not finite, or the standard deviation is not above 0.
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
        span: float = SPAN,
    ) -> None:
        if heading is not None and not np.isfinite(heading):
            raise ValueError(f"heading: got {heading!r} rad, must be finite, or None where it is not known")
        arguments.number("heading_deviation", heading_deviation, "rad", gt=0.0)
        self._mechanism, self.span = model.mechanism, span
        trust = uncertainty or Uncertainty().sized(worm.length)
        self._filter, self._knows_crab = Kalman(model, trust, worm.length), trust.crab > 0.0
        self._trust_ground = ground or GroundTrust().sized(worm.length)
        self._worm, self._schedule, self._standing = worm, schedule or Schedule(), Standing(worm)
        self._begin = _beginning(trust, heading, heading_deviation, worm.length)
        self._told_noise, self._has_rates = trust.com, trust.rate_offset > 0.0
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._wave, self._turning = MeasuredWave(self._worm.segments, self._schedule), MeanRate()
        self._history, length = InputHistory(2.0 * self.span), self._worm.length
        self.noise = Noise(self._told_noise, NOISIEST * length, RIPPLE * length)
        self._past: list[_Fused] = []
        self._settled: list[tuple[float, float]] = []
        self._heights: deque[tuple[float, float]] = deque()

    def take(self, t: float, measurement: Measurement, parameters: GaitParameters, phase: float) -> None:
        """Process a measurement at time t [s], which must be later than the time of the previous call.

        `parameters` have been commanded since the previous call. `phase` is the commanded phase [rad].
        """
        steering = parameters.steering(self._mechanism)
        self._history.add(t, np.array([parameters.amplitude, parameters.frequency, steering]), phase)
        self._begin_at(t)
        if measurement.strain is not None:
            self._take_strain(measurement.strain, measurement.strain_time)
        for sample in self._arrived(measurement):
            self._insert(t, sample)
            if sample.com is not None and self.noise.deviation > TOO_SURE * sample.deviation:
                self._take_again()
        if t - self._past[-1].sample.time > PAUSE:
            self._insert(t, _Sample(t - PAUSE / 2.0))
        self._forget(t - self.span)

    @classmethod
    def for_sensors(
        cls, worm: Worm, model: ReducedModel, schedule: Schedule, sensors: Mapping[str, Channel]
    ) -> Estimator:
        """Return the estimator that assumes the noise, bias and delay of the given channels.

        `sensors` contains the channels by name, like `control.sensing.sensors.Sensors.channels`.
        """
        noise = {name: channel.noise for name, channel in sensors.items()}
        place, heading = noise.get("com", COM.noise), noise.get("heading", HEADING_SENSOR.noise)
        rates, root = sensors.get("angular_rate"), np.sqrt(worm.segments)
        place = max(place, RIPPLE * worm.length)
        uncertainty = replace(
            Uncertainty().sized(worm.length),
            com=place,
            rate_sample=float(np.hypot(UNSTEADY, 0.0 if rates is None else rates.noise / root)),
            rate_offset=0.0 if rates is None else float(max(rates.bias, 1e-4) / root),
            heading_sample=float(np.hypot(heading, ROCKED)),
            crab=CRAB_NOISE if "heading" in sensors else 0.0,
        )
        ground = replace(GroundTrust().sized(worm.length), height=place)
        return cls(worm, model, schedule, uncertainty=uncertainty, ground=ground, span=span_of(sensors))

    @property
    def innovations(self) -> list[tuple[float, float]]:
        """Instant [s] and NIS of each sample of the centre of mass, see `control.estimation.estimate.consistency`."""
        return self._settled + [(each.sample.time, each.nis) for each in self._past if each.nis is not None]

    def _begin_at(self, t: float) -> None:
        if not self._past:
            self._past = [_Fused(_Sample(t), self._begin, Ground.unknown(self._trust_ground))]

    def _take_strain(self, strain: FloatArray, instant: float) -> None:
        self._wave.take(strain, self._history.phase(instant), self._history.is_back(instant))
        self._heights.append((instant, self._standing.height(strain)))
        while self._heights[0][0] < instant - self.span:
            self._heights.popleft()

    def _height_at(self, t: float) -> float:
        """Return the height of the axis above the ground at an instant [m]; NaN without recent strains."""
        if not self._heights or t > self._heights[-1][0] + 0.1:
            return nan
        times, heights = np.array(self._heights).T
        return float(np.interp(t, times, heights))

    def _arrived(self, measurement: Measurement) -> list[_Sample]:
        samples = []
        if measurement.com is not None:
            instant = measurement.com_time
            wave, stood = self._wave.at(self._history.phase(instant)), self._height_at(instant)
            frequency = self._history.frequency(instant)
            samples.append(_Sample(instant, measurement.com, wave, self.noise.deviation, stood, frequency))
        if measurement.heading is not None:
            samples.append(_Sample(measurement.heading_time, heading=measurement.heading))
        if self._has_rates and measurement.angular_rate is not None:
            instant = measurement.angular_rate_time
            rate = self._turning.take(instant, measurement.angular_rate, self._history.phase(instant))
            samples += [] if rate is None else [_Sample(rate[0], rate=rate[1])]
        return sorted(samples, key=lambda sample: sample.time)

    def _insert(self, now: float, sample: _Sample) -> None:
        """Process a sample at its instant, then process the samples of later instants again."""
        if not self._past[0].sample.time <= sample.time <= now + CLOCK_TOLERANCE:
            return
        again = []
        while self._past[-1].sample.time > sample.time:
            again.append(self._past.pop().sample)
        for each in (sample, *reversed(again)):
            self._past.append(self._fused(self._past[-1], each, new=each is sample))

    def _take_again(self) -> None:
        """Process the stored samples again, with the present estimate of the noise."""
        samples = [each.sample for each in self._past[1:]]
        del self._past[1:]
        for sample in samples:
            known = replace(sample, deviation=self.noise.deviation)
            self._past.append(self._fused(self._past[-1], known, new=False))

    def _fused(self, last: _Fused, sample: _Sample, new: bool) -> _Fused:
        """Return a sample together with the beliefs after it. The noise is only learnt from new samples."""
        after = replace(last, sample=sample, beliefs=self._predicted(last, sample.time), nis=None)
        if sample.com is not None and sample.wave is not None:
            corrected = self._with_com(last, after.beliefs, sample.com[:2], sample.wave, sample)
            best = max(corrected, key=lambda each: each.belief.log_weight)
            after.beliefs, after.nis, after.placed = [each.belief for each in corrected], best.nis, sample.time
            after.refused += best.refused
            after.pushed += best.pushed
            height = sample.com[2] - sample.standing
            if not best.refused and np.isfinite(height):
                trust = replace(self._trust_ground, height=max(self._trust_ground.height, sample.deviation))
                after.ground = after.ground.sampled(merged(after.beliefs).mean[:2], height, trust)
            if new and np.isfinite(best.nis):
                self.noise.learn(best.innovation, best.spread)
        if sample.heading is not None:
            alone = len(after.beliefs) == 1
            found = [self._filter.with_heading(belief, sample.heading, gated=alone) for belief in after.beliefs]
            after.beliefs = [belief for belief, _, _ in found]
            after.refused += all(refused for _, refused, _ in found)
            after.jumped += all(jumped for _, _, jumped in found)
        if sample.rate is not None:
            after.beliefs = [self._filter.with_rate(belief, sample.rate) for belief in after.beliefs]
        after.beliefs = pruned(after.beliefs)
        return after

    def _with_com(
        self, last: _Fused, beliefs: list[Belief], com: FloatArray, wave: FloatArray, sample: _Sample
    ) -> list[Corrected]:
        """Return the beliefs after a sample of the centre of mass. All samples except the first one may be refused."""
        since = inf if last.placed is None else sample.time - last.placed

        def corrected(gated: bool) -> list[Corrected]:
            noise = sample.deviation, since, sample.frequency
            return [self._filter.with_com(each, com, wave, gated, *noise) for each in beliefs]

        # A belief for which the sample is impossible loses weight. If the sample is impossible for all beliefs, it may
        # be refused.
        if last.placed is None or len(beliefs) > 1:
            found = corrected(gated=False)
            if last.placed is None or min(each.nis for each in found) <= IMPOSSIBLE:
                return found
        return corrected(gated=True)

    def _predicted(self, last: _Fused, t: float) -> list[Belief]:
        beliefs = last.beliefs
        for given, seconds in self._history.between(last.sample.time, t):
            beliefs = [self._filter.predicted(belief, given, last.ground.slope, seconds) for belief in beliefs]
        return beliefs

    def _forget(self, before: float) -> None:
        """Drop samples too old to be processed again, except the newest of these, where the filter continues."""
        while len(self._past) > 1 and self._past[1].sample.time < before:
            oldest = self._past.pop(0)
            if oldest.nis is not None:
                self._settled.append((oldest.sample.time, oldest.nis))

    def crabs(self, angle: float) -> None:
        """Set the crab angle [rad], unless a sensor measures the heading."""
        if not self._knows_crab:
            self._believe("crab", angle, 0.0)

    def turns(self, gain: float) -> None:
        """Set the gain of turning, which is the ratio of the worm's turn rate to the map's turn rate.

        The gain is limited to `GAINS`.
        """
        self._believe("turn_gain", min(max(gain, GAINS[0]), GAINS[1]), BEGIN["turn_gain"])

    def forget_ground(self) -> None:
        """Forget the slope and the height of the ground."""
        self._past = [replace(each, ground=Ground.unknown(self._trust_ground)) for each in self._past]

    def _believe(self, name: str, value: float, deviation: float) -> None:
        """Replace the belief about one state by a value and a standard deviation."""
        index = INDEX[name]
        for k, each in enumerate(self._past):
            beliefs = []
            for belief in each.beliefs:
                mean, covariance = belief.mean.copy(), belief.covariance.copy()
                mean[index] = value
                covariance[index] = covariance[:, index] = 0.0
                covariance[index, index] = deviation**2
                beliefs.append(replace(belief, mean=mean, covariance=covariance))
            self._past[k] = replace(each, beliefs=beliefs)

    def estimate(self, t: float) -> Estimate:
        """Return the estimate at the time t [s] of the last measurement.

        Before the first one, return the initial belief.
        """
        self._begin_at(t)
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
            refused=last.refused,
            pushed=last.pushed,
            jumped=last.jumped,
        )


def span_of(sensors: Mapping[str, Channel]) -> float:
    """Return the age above which samples of the given channels are not used [s]."""
    return SPAN + max((channel.delay for channel in sensors.values()), default=0.0)


def _beginning(trust: Uncertainty, heading: float | None, deviation: float, length: float) -> list[Belief]:
    """Return the beliefs before the first sample, one for each possible heading."""
    if heading is not None:
        return [_believed(trust, heading, deviation, length)]
    count, apart = 24, 2.0 * np.pi / 24
    # The headings are symmetric about 0, so that a worm and its mirror image are treated alike.
    sides = ((np.arange(count) + 0.5 - count / 2.0) * apart).tolist()
    return [_believed(trust, side, apart / 2.0, length) for side in sides]


def _believed(trust: Uncertainty, heading: float, deviation: float, length: float) -> Belief:
    mean, deviations = np.zeros(size_of(trust)), np.zeros(size_of(trust))
    mean[:STATES] = ReducedState(0.0, 0.0, heading, 0.0, 0.0)
    crab = BEGIN_CRAB if trust.crab > 0.0 else 0.0
    known = {"x": ANYWHERE, "y": ANYWHERE, "heading": deviation, "drift": trust.drift / length, "crab": crab, **BEGIN}
    deviations[ROCKING], deviations[SIZE:] = BEGIN_ROCKING * length, trust.rate_offset
    return Belief(mean, widened(np.diag(deviations**2), known, length))
