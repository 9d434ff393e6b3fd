"""The extended Kalman filter of a crawling worm: prediction by the reduced model, correction by the centre of mass.

Its state X are the states of (R1) and, besides, how the centre of mass rocks with the wave, C (2 x 2):

    (R1),   drift' = (-kappa v s_left - drift)/tau,   C' = 0                                                  (K2)

with white noise on each rate. s_left is the slope of the ground to the left, as far as it is known
(`control.estimation.ground`), and kappa what a slope makes a crawling worm yield: dry friction that is shaken by the
wave gives way like a viscous one, so that uphill the worm loses kappa v s of its speed (found: a fifth at 3 degrees,
kappa = 4), and across a slope it slides downhill in proportion likewise (found: 10 degrees of crab at 3 degrees, kappa
= 3.4). A sample of the centre of mass is

    (x, y) + T(h) C wave(psi)                                                                                 (K3)

T being the rotation by the heading h and wave(psi) the measured wave (W2); a sample of the heading is h. With the
Jacobians F and H of prediction and sample, noise Q dt and R, innovation e, S = H P H^T + R and K = P H^T S^-1:

    P -> F P F^T + Q dt;    X -> X + K e,   P -> (1 - K H) P (1 - K H)^T + K R K^T,   nis = e^T S^-1 e           (K4)

(Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation, 5.4 and 10.3.)

What can be known. Position, speed and course (the direction in which the centre of mass moves) follow from the
samples of the centre of mass within a wave. The heading follows from course and drift: a constant drift that no known
slope explains looks like a heading, and is taken for one, since the filter expects drift to pass with tau. A worm at
rest has no course: its heading stays as uncertain as it was, and more so. Slip is known where the worm crawls, at
rest it is not.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from control.estimation.belief import HEADING, Belief, wrapped
from control.estimation.reduced import INPUTS, STATES, ReducedModel, ReducedState
from worm3d.machine.buffered import Buffered
from worm3d.values.arrays import FloatArray

ROCKING = slice(STATES, STATES + 4)
SIZE = STATES + 4
DRIFT = ReducedState._fields.index("drift")

IMPOSSIBLE = 25.0
"""A sample with a greater nis is held for impossible: of two normal numbers, one pair in 270 000 is."""

IMPOSSIBLE_HEADING = 21.0
"""Squared deviation, over its variance, beyond which a measured heading is not believed."""

PATIENCE = 3
"""After so many impossible samples in a row it is the belief that is held for wrong: the worm was moved."""

MOVED = {"heading": 0.5, "speed": 0.05, "turn_rate": 0.2}
"""Standard deviations that a worm that was moved has besides [rad], [m/s], [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """How far sensors and model are trusted; the defaults suit the default worm and `control.sensing.sensors`.

    Place, speed and turn rate are about where the innovations of nine runs of a minute are likeliest (line, circle,
    S-curve, way points, steps of the speed, and 3 degrees uphill; seeds 11 to 13). For those the drift could be half of
    what it is; that is what makes the filter know how wrong its heading is where a worm winds.

    Attributes
    ----------
    com : float
        Standard deviation of a sample of the centre of mass, with what it rocks besides (K3) [m].
    heading_sample : float
        Likewise of a heading sensor [rad].
    place : float
        Noise of the position [m/sqrt(s)].
    heading, turning : float
        Noise of the heading [rad/sqrt(s)], at no turn rate, and what it grows by a unit of it [sqrt(s)].
    speed, turn_rate : float
        Of the motion that the gait makes [m/s/sqrt(s)], [rad/s/sqrt(s)].
    slip, yaw_bias : float
        [1/sqrt(s)], [rad/s/sqrt(s)]
    drift, drift_time : float
        Standard deviation [m/s] and correlation time tau [s] of the drift that no slope explains.
    rocking : float
        Of the entries of C [m/sqrt(s)].
    slope_yield : float
        kappa.

    Raises
    ------
    ValueError
        A value that is not finite or is below 0; sensors and `drift_time` must be above 0.
    """

    com: float = 0.005
    heading_sample: float = 0.025
    place: float = 0.0005
    heading: float = 0.004
    turning: float = 0.12
    speed: float = 0.003
    turn_rate: float = 0.008
    slip: float = 0.01
    yaw_bias: float = 0.003
    drift: float = 0.0018
    drift_time: float = 2.0
    rocking: float = 0.001
    slope_yield: float = 3.6

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            positive = field.name in ("com", "heading_sample", "drift_time")
            if not (np.isfinite(value) and value >= 0.0 and (value > 0.0 or not positive)):
                rule = "above 0" if positive else "at least 0"
                raise ValueError(f"{field.name}: got {value!r}, must be finite and {rule}")


class Corrected(NamedTuple):
    """A belief after a sample."""

    belief: Belief
    nis: float
    innovation: FloatArray
    """Sample less what was expected, shape (2,) [m]."""
    spread: float
    """Variance of what was expected, the mean of both coordinates [m^2]."""
    refused: bool = False
    """Whether the sample was held for impossible."""


class Kalman:
    """The filter, compiled.

    Parameters
    ----------
    model : ReducedModel
    uncertainty : Uncertainty
    """

    def __init__(self, model: ReducedModel, uncertainty: Uncertainty) -> None:
        self._longest, self._deviation = model.longest_step, uncertainty.com
        self._predict = Buffered(_prediction(model, uncertainty))
        self._com = Buffered(_com_correction())
        self._heading = Buffered(_heading_correction(uncertainty))

    def predicted(self, belief: Belief, given: FloatArray, slope: FloatArray, seconds: float) -> Belief:
        """Return the belief after some time with the same input (amplitude, frequency, steering) on a slope (2,)."""
        mean, covariance = belief.mean, belief.covariance
        parts = int(np.ceil(seconds / self._longest))
        for _ in range(parts):
            mean, covariance = self._predict(mean, covariance, given, slope, seconds / parts)
        return replace(belief, mean=mean, covariance=covariance)

    def with_com(
        self, belief: Belief, com: FloatArray, wave: FloatArray, gated: bool, deviation: float | None = None
    ) -> Corrected:
        """Return the belief after a sample of the centre of mass, (K4).

        Parameters
        ----------
        belief : Belief
        com, wave : ndarray, shape (2,)
            The sample [m], and the measured wave then.
        gated : bool
            Whether it may be held for impossible.
        deviation : float, optional
            Standard deviation of its noise [m]; what was told if left out.
        """
        sigma = self._deviation if deviation is None else deviation
        mean, covariance, nis, log_det, e, spread = self._com(belief.mean, belief.covariance, com, wave, sigma)
        found = float(nis[0]), e, float(spread[0])
        if not _usable(nis, mean, covariance):
            return Corrected(belief, *found, refused=True)
        if gated and nis[0] > IMPOSSIBLE:
            if belief.refused < PATIENCE:
                return Corrected(replace(belief, refused=belief.refused + 1), *found, refused=True)
            mean, covariance, *_ = self._com(belief.mean, _widened(belief, com), com, wave, sigma)
        log_weight = belief.log_weight - 0.5 * float(nis[0] + log_det[0])
        after = replace(belief, mean=mean, covariance=covariance, log_weight=log_weight, refused=0)
        return Corrected(after, *found)

    def with_heading(self, belief: Belief, heading: float, gated: bool = False) -> tuple[Belief, bool]:
        """Return the belief after a sample of the heading [rad], (K4), modulo a turn, and whether that was refused.

        Gated, it may be held for impossible.
        """
        off = wrapped(np.array([heading - belief.mean[HEADING]]))
        before = belief.mean, belief.covariance, belief.mean[HEADING] + off
        mean, covariance, nis, log_det = self._heading(*before)
        if not _usable(nis, mean, covariance):
            return belief, True
        if gated and nis[0] > IMPOSSIBLE_HEADING:
            if belief.turned < PATIENCE:
                return replace(belief, turned=belief.turned + 1), True
            widened = belief.covariance.copy()
            widened[HEADING, HEADING] += float(off[0]) ** 2
            mean, covariance, *_ = self._heading(belief.mean, widened, belief.mean[HEADING] + off)
        log_weight = belief.log_weight - 0.5 * float(nis[0] + log_det[0])
        return replace(belief, mean=mean, covariance=covariance, log_weight=log_weight, turned=0), False


def _usable(*found: FloatArray) -> bool:
    return all(np.isfinite(part).all() for part in found)


def _prediction(model: ReducedModel, trust: Uncertainty) -> ca.Function:
    """Return (X, P, input, slope, seconds) -> X, P by (K2) and (K4)."""
    X, P = ca.SX.sym("X", SIZE), ca.SX.sym("P", SIZE, SIZE)
    given, slope, dt = ca.SX.sym("input", INPUTS), ca.SX.sym("slope", 2), ca.SX.sym("dt")
    s = ReducedState(*ca.vertsplit(X[:STATES]))
    moved = model.advance(X[:STATES], given, dt)
    towards = -trust.slope_yield * s.speed * (slope[1] * ca.cos(s.heading) - slope[0] * ca.sin(s.heading))
    moved[DRIFT] = towards + (s.drift - towards) * ca.exp(-dt / trust.drift_time)
    after = ca.vertcat(moved, X[ROCKING])
    F = ca.jacobian(after, X)
    spread = F @ P @ F.T + ca.diag(_noise(s, trust)) * dt
    return ca.Function("predict", [X, P, given, slope, dt], [after, ca.densify((spread + spread.T) / 2.0)])


def _noise(s: ReducedState, trust: Uncertainty) -> ca.SX:
    """Return the spectral densities of (K2), the diagonal of Q."""
    of_state = ReducedState(
        x=trust.place**2,
        y=trust.place**2,
        heading=trust.heading**2 + (trust.turning * s.turn_rate) ** 2,
        speed=trust.speed**2,
        turn_rate=trust.turn_rate**2,
        slip=trust.slip**2,
        yaw_bias=trust.yaw_bias**2,
        drift=2.0 * trust.drift**2 / trust.drift_time,
    )
    return ca.vertcat(*of_state, *[trust.rocking**2] * 4)


def _com_correction() -> ca.Function:
    """Return (X, P, com, wave, deviation) -> X, P, nis, log det S, e and the mean of H P H^T by (K3) and (K4)."""
    X, P = ca.SX.sym("X", SIZE), ca.SX.sym("P", SIZE, SIZE)
    sample, wave, deviation = ca.SX.sym("com", 2), ca.SX.sym("wave", 2), ca.SX.sym("deviation")
    rocking = ca.reshape(X[ROCKING], 2, 2) @ wave
    cos, sin = ca.cos(X[HEADING]), ca.sin(X[HEADING])
    turned = ca.vertcat(cos * rocking[0] - sin * rocking[1], sin * rocking[0] + cos * rocking[1])
    expected = X[:2] + turned
    H = ca.jacobian(expected, X)
    found = _correction(X, P, sample, expected, ca.vertcat(deviation, deviation))
    spread = ca.trace(H @ P @ H.T) / 2.0
    return ca.Function("com", [X, P, sample, wave, deviation], [*found, sample - expected, ca.densify(spread)])


def _heading_correction(trust: Uncertainty) -> ca.Function:
    """Return (X, P, heading) -> X, P, nis, log det S by (K4)."""
    X, P, sample = ca.SX.sym("X", SIZE), ca.SX.sym("P", SIZE, SIZE), ca.SX.sym("heading")
    return ca.Function("heading", [X, P, sample], _correction(X, P, sample, X[HEADING], ca.SX(trust.heading_sample)))


def _correction(X: ca.SX, P: ca.SX, sample: ca.SX, expected: ca.SX, deviations: ca.SX) -> list[ca.SX]:
    """Return X, P, nis and log det S after a sample, (K4)."""
    H, R, e = ca.jacobian(expected, X), ca.diag(deviations**2), sample - expected
    S = H @ P @ H.T + R
    inverse = ca.inv(S)
    K = P @ H.T @ inverse
    kept = ca.SX.eye(SIZE) - K @ H
    spread = kept @ P @ kept.T + K @ R @ K.T
    return [X + K @ e, ca.densify((spread + spread.T) / 2.0), e.T @ inverse @ e, ca.log(ca.det(S))]


def _widened(belief: Belief, com: FloatArray) -> FloatArray:
    """Return the covariance of a worm that was moved to about where a sample of its centre of mass says."""
    widened = belief.covariance.copy()
    off = float(np.hypot(*(com - belief.mean[:2])))
    for index in (0, 1):
        widened[index, index] += off**2
    for name, deviation in MOVED.items():
        index = ReducedState._fields.index(name)
        widened[index, index] += deviation**2
    return widened
