"""Extended Kalman filter of a crawling worm: prediction by the reduced model, and correction by samples.

The state X contains the states of (R1) and (R3), and a matrix C (2 x 2) that maps the wave to the rocking of the centre
of mass. It is predicted by

    (R1),   drift' = (-kappa |v| s_left - drift)/tau,   C' = 0                                                 (KF2)

with white noise added to each rate. s_left is the estimated slope of the ground to the left
(`control.estimation.ground`). kappa is the yield of a crawling worm on a slope: the wave shakes the dry friction, which
then yields like viscous friction. Uphill, the worm therefore loses the speed kappa v s. Runs showed a loss of a fifth
at 3 degrees, or kappa = 4. Across a slope, the worm slides downhill in the same proportion. Runs showed a crab angle of
10 degrees at 3 degrees, or kappa = 3.4.

Feet on dry friction go as far in a slow wave as in a fast wave, so that the uncertainty per wave is the same. Therefore
the noise densities depend on the frequency f through p = min(1, f / f_0). The densities for angles, slip, gain and C
are proportional to p, the density for the drift to p^2, and the densities for rates to p^3. A sample of the centre of
mass is

    (x, y) + T(h) C wave(psi)                                                                                (KF3)

where T is the rotation by the heading h, and wave(psi) is the measured wave (W2). A sample of the heading is h. The
mean turn rate of a wave from gyroscopes, (TR1), is w + yaw_bias + o, where the constant error o of the gyroscopes is an
additional state. With the Jacobians F of the prediction and H of the sample, the noise Q dt and R, the innovation e, S
= H P H^T + R and K = P H^T S^-1, the filter is

    P -> F P F^T + Q dt;    X -> X + K e,   P -> (1 - K H) P (1 - K H)^T + K R K^T,   nis = e^T S^-1 e          (KF4)

(Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation, 5.4 and 10.3.)

*Observability.* Position, speed and course (the direction of motion) follow from the samples of the centre of mass
within a wave. The heading follows from course and drift. The filter expects drift to decay with tau. Therefore it
interprets a constant drift that no known slope explains as a change of the heading. Only a sensor of the heading can
distinguish the two. If there is such a sensor, the slowly changing crab angle represents the drift. The gain of turning
and the yaw bias can be distinguished if the steering changes. At rest, neither heading nor slip is observable.

*Starts and stops.* While the wave grows or slows down, the distance that the worm covers depends on the phase. If the
worm is slower or faster than the wave by e, the noise density of the position along the heading is increased by
(changing e)^2. From rest a worm first contracts, which moves the centre of mass by about 2 cm forward, or backward if
the worm slides downhill. At 0.08 m/s the added noise amounts to 4 cm, so that the filter does not interpret this motion
as speed or progress.

*Pushes.* A push to the side looks like a turn, since both change the course. A push, however, gives the innovations a
trend m, which is their mean over about n samples with exponential weights. Without a push, the variance of the trend is
S / (2 n - 1), plus the variance of rocking that (KF3) does not explain, which is not averaged out in slow waves. If the
trend is significantly larger, the variance of the drift is increased, so that the drift explains the trend.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import hypot, sqrt
from typing import NamedTuple

import casadi as ca
import numpy as np

from control.estimation.estimate import HEADING, Belief, wrapped
from control.estimation.reduced import INDEX, INPUTS, LONGEST_SUBSTEP, STATES, ReducedInput, ReducedModel, ReducedState
from worm3d.machine.buffered import Buffered
from worm3d.values.arrays import FloatArray
from worm3d.values.parameters import documented, parameter
from worm3d.values.spelling import Checked

ROCKING = slice(STATES, STATES + 4)
SIZE = STATES + 4
GAIN, SLIP = INDEX["turn_gain"], INDEX["slip"]
IMPOSSIBLE = 25.0
"""NIS above which a sample of the centre of mass is refused. The probability of a larger value under noise alone is 1
in 270 000."""
IMPOSSIBLE_HEADING = 21.0
"""NIS above which a sample of the heading is refused."""
MAX_REFUSED_SAMPLES = 3
"""Number of consecutive refused samples after which the filter assumes that the worm was moved."""
TREND = 8
"""Number n of samples over which the innovations are averaged to the trend. With the default sensors this is 0.4 s."""
IN_METRES = ("speed", "drift")
"""States whose standard deviations are proportional to the length of the worm."""
ERROR_CORRELATION_TIME = 0.05
"""Time within which the errors of two samples are similar [s]. A sample that follows sooner has less weight in the
trend, in proportion to the time."""
RIPPLE = 0.002
"""Standard deviation of the rocking that the measured wave does not explain, at twice the wave's frequency [body
lengths]."""
UNEXPLAINED = 20.0
"""NIS of the trend above which the filter assumes a push. Under noise alone, its probability is only 0.00005 per
sample, since a run has thousands of samples. With 16 the filter assumed a push within a minute at 0.01 m/s, and the
worm did not return to its path."""
PUSHED = {"drift": 0.05, "slip": 0.3, "yaw_bias": 0.01}
"""Standard deviations that are added when the worm is pushed, of drift [body lengths/s], slip [1] and yaw bias
[rad/s]."""
GAINS = (0.3, 3.0)
"""Smallest and greatest accepted gain of turning. The gain is positive, since steering never turns a worm the opposite
way."""
SLIPS = (-1.0, 1.0)
"""Smallest and greatest accepted slip. If a worm moves more than twice as far as the wave would carry it, it is pushed
or slides. If this motion were attributed to the wave, the planner would almost stop the wave."""
MOVED_DEVIATIONS = {"heading": 0.5, "speed": 0.05, "turn_rate": 0.2}
"""Standard deviations that are added when the worm was moved, of heading [rad], speed [body lengths/s] and turn rate
[rad/s]."""


@documented
@dataclass(frozen=True, kw_only=True)
class Uncertainty(Checked):
    """Uncertainty of sensors and model. The defaults suit worms of 1 m and the default sensors.

    The values for position, speed and turn rate are close to the maximum likelihood of the innovations in nine runs of
    one minute (line, circle, S-curve, way points, steps of the speed, and 3 degrees uphill; seeds 11 to 13). For these
    runs, half the drift would be sufficient. The larger drift gives the heading the correct standard deviation on
    winding paths.
    """

    com: float = parameter(0.005, "standard deviation of a sample of the centre of mass", "m", gt=0)
    heading_sample: float = parameter(0.025, "standard deviation of a sample of the heading", "rad", gt=0)
    place: float = parameter(0.0005, "noise of the position", "m/sqrt(s)", ge=0)
    heading: float = parameter(0.004, "noise of the heading without turning", "rad/sqrt(s)", ge=0)
    turning: float = parameter(0.12, "increase of the noise of the heading per turn rate", "sqrt(s)", ge=0)
    changing: float = parameter(
        1.0, "noise of the position ahead per difference between the speeds of the worm and its wave", "sqrt(s)", ge=0
    )
    speed: float = parameter(0.006, "noise of the speed that the gait makes", "m/s/sqrt(s)", ge=0)
    turn_rate: float = parameter(0.008, "noise of the turn rate that the gait makes", "rad/s/sqrt(s)", ge=0)
    slip: float = parameter(0.01, "noise of the slip", "1/sqrt(s)", ge=0)
    yaw_bias: float = parameter(0.003, "noise of the yaw bias", "rad/s/sqrt(s)", ge=0)
    turn_gain: float = parameter(0.01, "noise of the gain of turning", "1/sqrt(s)", ge=0)
    crab: float = parameter(0.0, "noise of the crab angle", "rad/sqrt(s)", ge=0)
    rate_sample: float = parameter(
        0.005, "standard deviation of the mean turn rate of a wave by gyroscopes", "rad/s", gt=0
    )
    rate_offset: float = parameter(
        0.0, "standard deviation of the constant error of the gyroscopes; 0: no gyroscopes", "rad/s", ge=0
    )
    drift: float = parameter(0.0018, "standard deviation of the drift that no slope explains", "m/s", ge=0)
    drift_time: float = parameter(2.0, "correlation time tau of the drift", "s", gt=0)
    rocking: float = parameter(0.001, "noise of the entries of C", "m/sqrt(s)", ge=0)
    frequency: float = parameter(0.8, "frequency f_0 below which the noise decreases with the frequency", "Hz", gt=0)
    slope_yield: float = parameter(3.6, "kappa, the lost share of the speed divided by the slope", ge=0)

    def sized(self, length: float) -> Uncertainty:
        """Return the uncertainty for a worm of a given length [m]. All motion is proportional to the length."""
        motion = {name: length * getattr(self, name) for name in ("place", "speed", "drift", "rocking")}
        return replace(self, **motion)


class Corrected(NamedTuple):
    """Belief after a sample of the centre of mass."""

    belief: Belief
    nis: float
    innovation: FloatArray
    """Sample minus its expected value, shape (2,) [m]."""
    spread: float
    """Variance of the expected value, averaged over both coordinates [m^2]."""
    refused: bool = False
    """Whether the sample was refused as impossible."""
    pushed: bool = False
    """Whether the samples show a motion that the wave does not explain."""


class Kalman:
    """Compiled filter for one reduced model and a worm of a given length [m]."""

    def __init__(self, model: ReducedModel, uncertainty: Uncertainty, length: float = 1.0) -> None:
        self._length = length
        self._longest = min(model.longest_step, LONGEST_SUBSTEP * model.lag)
        self._deviation, size = uncertainty.com, size_of(uncertainty)
        self._predict = Buffered(_prediction(model, uncertainty))
        self._com = Buffered(_com_correction(size))
        X = ca.SX.sym("X", size)
        self._heading = Buffered(_number_correction(X, X[HEADING], uncertainty.heading_sample))
        if size > SIZE:
            turn_rate = X[INDEX["turn_rate"]] + X[INDEX["yaw_bias"]] + X[SIZE]
            self._rate = Buffered(_number_correction(X, turn_rate, uncertainty.rate_sample))

    def predicted(self, belief: Belief, given: FloatArray, slope: FloatArray, seconds: float) -> Belief:
        """Return the belief after `seconds` of constant input.

        `given` is the input, as in `InputHistory.between`, and `slope` the slope of the ground, shape (2,).
        """
        mean, covariance = belief.mean, belief.covariance
        parts = int(np.ceil(seconds / self._longest))
        for _ in range(parts):
            mean, covariance = self._predict(mean, covariance, given, slope, seconds / parts)
        return replace(belief, mean=mean, covariance=covariance)

    def with_com(
        self,
        belief: Belief,
        com: FloatArray,
        wave: FloatArray,
        gated: bool,
        deviation: float | None = None,
        since: float = ERROR_CORRELATION_TIME,
        frequency: float = np.inf,
    ) -> Corrected:
        """Return the belief after a sample of the centre of mass, shape (2,) [m], (KF4).

        Only a `gated` sample may be refused. `wave` is the measured wave (W2) at the instant of the sample, shape (2,).
        `deviation` is the standard deviation of the sample [m], by default `Uncertainty.com`. `since` is the time since
        the previous sample [s], and `frequency` the frequency of the wave [Hz].
        """
        sigma = self._deviation if deviation is None else deviation
        mean, covariance, nis, log_det, e, spread = self._com(belief.mean, belief.covariance, com, wave, sigma)
        found = float(nis[0]), e, float(spread[0])
        trend = belief.trend + (e - belief.trend) * min(1.0, since / ERROR_CORRELATION_TIME) / TREND
        rocked = (RIPPLE * self._length) ** 2 / (1.0 + (4.0 * np.pi * frequency * TREND * ERROR_CORRELATION_TIME) ** 2)
        pushed = gated and hypot(*trend) > sqrt(UNEXPLAINED * ((found[2] + sigma**2) / (2 * TREND - 1) + rocked))
        if pushed:
            trend = np.zeros(2)
            wide = widened(belief.covariance, PUSHED, self._length)
            wide[GAIN, :GAIN] = wide[:GAIN, GAIN] = 0.0  # a push does not change the gain
            mean, covariance, *_ = self._com(belief.mean, wide, com, wave, sigma)
        if not _usable(nis, mean, covariance):
            return Corrected(belief, *found, refused=True)
        if gated and nis[0] > IMPOSSIBLE:
            if belief.refused < MAX_REFUSED_SAMPLES:
                return Corrected(replace(belief, refused=belief.refused + 1), *found, refused=True)
            wide = widened(belief.covariance, MOVED_DEVIATIONS, self._length)
            wide[[0, 1], [0, 1]] += float(np.hypot(*(com - belief.mean[:2]))) ** 2  # to about the place of the sample
            mean, covariance, *_ = self._com(belief.mean, wide, com, wave, sigma)
            pushed = True
        log_weight = belief.log_weight - 0.5 * float(nis[0] + log_det[0])
        mean[GAIN] = min(max(mean[GAIN], GAINS[0]), GAINS[1])
        mean[SLIP] = min(max(mean[SLIP], SLIPS[0]), SLIPS[1])
        after = replace(belief, mean=mean, covariance=covariance, log_weight=log_weight, refused=0, trend=trend)
        return Corrected(after, *found, pushed=pushed)

    def with_heading(self, belief: Belief, heading: float, gated: bool = False) -> tuple[Belief, bool, bool]:
        """Return the belief after a sample of the heading [rad], (KF4). Whole turns do not matter.

        The second result is whether the sample was refused. The third result is whether an impossible sample was
        accepted because the previous samples were impossible, too. Only a `gated` sample may be refused as impossible.
        """
        off = wrapped(np.array([heading - belief.mean[HEADING]]))
        before = belief.mean, belief.covariance, belief.mean[HEADING] + off
        mean, covariance, nis, log_det = self._heading(*before)
        if not _usable(nis, mean, covariance):
            return belief, True, False
        jumped = gated and bool(nis[0] > IMPOSSIBLE_HEADING)
        if jumped:
            if belief.turned < MAX_REFUSED_SAMPLES:
                return replace(belief, turned=belief.turned + 1), True, False
            widened = belief.covariance.copy()
            widened[HEADING, HEADING] += float(off[0]) ** 2
            mean, covariance, *_ = self._heading(belief.mean, widened, belief.mean[HEADING] + off)
        log_weight = belief.log_weight - 0.5 * float(nis[0] + log_det[0])
        return replace(belief, mean=mean, covariance=covariance, log_weight=log_weight, turned=0), False, jumped

    def with_rate(self, belief: Belief, rate: float) -> Belief:
        """Return the belief after a sample of the mean turn rate of a wave [rad/s], (KF4).

        The filter must be at the middle instant of the wave.
        """
        mean, covariance, nis, log_det = self._rate(belief.mean, belief.covariance, rate)
        if not _usable(nis, mean, covariance):
            return belief
        log_weight = belief.log_weight - 0.5 * float(nis[0] + log_det[0])
        return replace(belief, mean=mean, covariance=covariance, log_weight=log_weight)


def widened(covariance: FloatArray, deviations: Mapping[str, float], length: float) -> FloatArray:
    """Return a covariance with the squares of standard deviations added.

    The standard deviations of the states in `IN_METRES` are in body lengths.
    """
    more = covariance.copy()
    for name, deviation in deviations.items():
        index = INDEX[name]
        more[index, index] += (deviation * length if name in IN_METRES else deviation) ** 2
    return more


def size_of(trust: Uncertainty) -> int:
    """Return the size of X. If there are gyroscopes, the last entry is their constant error."""
    return SIZE + (trust.rate_offset > 0.0)


def _usable(*found: FloatArray) -> bool:
    return all(np.isfinite(part).all() for part in found)


def _prediction(model: ReducedModel, trust: Uncertainty) -> ca.Function:
    """Return (X, P, input, slope, seconds) -> X, P by (KF2) and (KF4)."""
    size = size_of(trust)
    X, P = ca.SX.sym("X", size), ca.SX.sym("P", size, size)
    given, slope, dt = ca.SX.sym("input", INPUTS), ca.SX.sym("slope", 2), ca.SX.sym("dt")
    s = ReducedState(*ca.vertsplit(X[:STATES]))
    moved = model.advance(X[:STATES], given, dt, model.in_force)
    towards = -trust.slope_yield * ca.fabs(s.speed) * (slope[1] * ca.cos(s.heading) - slope[0] * ca.sin(s.heading))
    moved[INDEX["drift"]] = towards + (s.drift - towards) * ca.exp(-dt / trust.drift_time)
    after = ca.vertcat(moved, X[STATES:])
    F = ca.jacobian(after, X)
    Q = ca.diag(_noise(s, given, trust)[: X.numel()])
    ahead = ca.vertcat(ca.cos(s.heading), ca.sin(s.heading))
    Q[:2, :2] += (trust.changing * model.lag * model.in_force(X[:STATES], given)[INDEX["speed"]]) ** 2 * ahead @ ahead.T
    spread = F @ P @ F.T + Q * dt
    return ca.Function("predict", [X, P, given, slope, dt], [after, ca.densify((spread + spread.T) / 2.0)])


def _noise(s: ReducedState, given: ca.SX, trust: Uncertainty) -> ca.SX:
    """Return the spectral densities of (KF2), the diagonal of Q."""
    pace = ca.fmin(1.0, ReducedInput(*ca.vertsplit(given)).frequency / trust.frequency)
    of_state = ReducedState(
        x=trust.place**2,
        y=trust.place**2,
        heading=trust.heading**2 * pace + (trust.turning * s.turn_rate) ** 2,
        speed=trust.speed**2 * pace**3,
        turn_rate=trust.turn_rate**2 * pace**3,
        slip=trust.slip**2 * pace,
        yaw_bias=trust.yaw_bias**2 * pace**3,
        drift=2.0 * trust.drift**2 / trust.drift_time * pace**2,
        turn_gain=trust.turn_gain**2 * pace,
        crab=trust.crab**2 * pace,
    )
    return ca.vertcat(*of_state, *[trust.rocking**2 * pace] * 4, 0.0)


def _com_correction(size: int) -> ca.Function:
    """Return (X, P, com, wave, deviation) -> X, P, nis, log det S, e and the mean of H P H^T by (KF3) and (KF4)."""
    X, P = ca.SX.sym("X", size), ca.SX.sym("P", size, size)
    sample, wave, deviation = ca.SX.sym("com", 2), ca.SX.sym("wave", 2), ca.SX.sym("deviation")
    rocking = ca.reshape(X[ROCKING], 2, 2) @ wave
    cos, sin = ca.cos(X[HEADING]), ca.sin(X[HEADING])
    turned = ca.vertcat(cos * rocking[0] - sin * rocking[1], sin * rocking[0] + cos * rocking[1])
    expected = X[:2] + turned
    H = ca.jacobian(expected, X)
    found = _correction(X, P, sample, expected, ca.vertcat(deviation, deviation))
    spread = ca.trace(H @ P @ H.T) / 2.0
    return ca.Function("com", [X, P, sample, wave, deviation], [*found, sample - expected, ca.densify(spread)])


def _number_correction(X: ca.SX, expected: ca.SX, deviation: float) -> ca.Function:
    """Return (X, P, sample) -> X, P, nis, log det S by (KF4) for a sample of one number."""
    P, sample = ca.SX.sym("P", X.numel(), X.numel()), ca.SX.sym("sample")
    return ca.Function("number", [X, P, sample], _correction(X, P, sample, expected, ca.SX(deviation)))


def _correction(X: ca.SX, P: ca.SX, sample: ca.SX, expected: ca.SX, deviations: ca.SX) -> list[ca.SX]:
    """Return X, P, nis and log det S after a sample, (KF4)."""
    H, R, e = ca.jacobian(expected, X), ca.diag(deviations**2), sample - expected
    S = H @ P @ H.T + R
    inverse = ca.inv(S)
    K = P @ H.T @ inverse
    kept = ca.SX.eye(X.numel()) - K @ H
    spread = kept @ P @ kept.T + K @ R @ K.T
    return [X + K @ e, ca.densify((spread + spread.T) / 2.0), e.T @ inverse @ e, ca.log(ca.det(S))]
