"""Gyroscopes: the mean turn rate of a wave, against closed forms, the plant and an offset that is found."""

import numpy as np
import pytest

from control.estimation.estimate import Belief
from control.estimation.estimator import Estimator
from control.estimation.kalman import SIZE, Kalman, Uncertainty, size_of
from control.estimation.reduced import STATES, ReducedModel
from control.estimation.turning import MeanRate
from control.gaits.steering import GaitParameters, Schedule, WaveGenerator
from control.identification.identified import load
from control.sensing.sensors import COM, QUANTITIES, STRAIN, Channel, Measurement, Sensors
from worm3d import Friction, Plane, Worm, simulate

WORM = Worm()
MODEL = ReducedModel.of(WORM, load(WORM), "both")
TURN_RATE, YAW_BIAS = 4, 6
WITH_GYRO = Uncertainty(rate_offset=0.005)


def level(rate):
    return np.column_stack([np.zeros((6, 2)), np.full(6, rate)])


def test_rocking_averages_out_over_a_wave():
    mean, found = MeanRate(), []
    for t in np.linspace(0.0, 5.0, 501):
        psi = 2.0 * np.pi * 0.8 * t
        found.append(mean.take(t, level(0.07 + 0.4 * np.cos(psi + 0.3)), psi))
    made = [each for each in found if each]
    assert [round(instant, 9) for instant, _ in made] == [0.625, 1.875, 3.125, 4.375]
    assert [rate for _, rate in made] == pytest.approx([0.07] * 4, abs=1e-4)


def test_segments_that_are_not_known_are_left_out():
    mean = MeanRate()
    rates = level(0.1)
    rates[2] = np.nan
    assert mean.take(0.0, np.full((6, 3), np.nan), 0.0) is None
    assert mean.take(0.0, rates, 0.0) is None
    assert mean.take(1.0, rates, 7.0) == (0.5, pytest.approx(0.1))


class Watched:
    """A steered wave whose turn rates are averaged."""

    def __init__(self, steering):
        self.target = GaitParameters(0.3, 0.8).steered("both", steering)

    def reset(self):
        self.wave, self.mean, self.made = WaveGenerator(Schedule(), WORM), MeanRate(), []

    def step(self, t, measurement):
        found = self.mean.take(t, measurement.angular_rate, self.wave.phase)
        self.made += [] if found is None else [found]
        return self.wave.step(0.01, self.target)


@pytest.mark.parametrize("steering", [-0.5, 0.5])
def test_on_the_plant_it_is_the_turn_of_the_heading(steering):
    watched = Watched(steering)
    run = simulate(
        WORM, Plane(), Friction(), watched, 7.6, sensor=Sensors(angular_rate=Channel(noise=0.0), com=None, strain=None)
    )
    instants, rates = np.array(watched.made[2:]).T
    half = np.diff(instants).mean() / 2.0
    turned = np.interp(instants + half, run.time, run.heading) - np.interp(instants - half, run.time, run.heading)
    assert len(rates) >= 3
    assert np.sign(rates) == pytest.approx(np.sign(steering))
    assert rates == pytest.approx(turned / (2.0 * half), abs=0.01)


def test_a_sample_raises_turn_rate_bias_and_offset_by_their_variances():
    mean, deviations = np.zeros(size_of(WITH_GYRO)), np.full(size_of(WITH_GYRO), 1e-9)
    deviations[[TURN_RATE, YAW_BIAS, SIZE]] = 0.03, 0.01, 0.005
    after = Kalman(MODEL, WITH_GYRO).with_rate(Belief(mean, np.diag(deviations**2)), 0.1)
    variances = deviations[[TURN_RATE, YAW_BIAS, SIZE]] ** 2
    gains = variances / (variances.sum() + WITH_GYRO.rate_sample**2)
    assert after.mean[[TURN_RATE, YAW_BIAS, SIZE]] == pytest.approx(0.1 * gains, rel=1e-6)
    assert size_of(Uncertainty()) == SIZE


def test_a_sample_makes_the_belief_likelier_that_expects_it():
    kalman, covariance = Kalman(MODEL, WITH_GYRO), 1e-4 * np.eye(size_of(WITH_GYRO))
    means = np.zeros((2, size_of(WITH_GYRO)))
    means[:, TURN_RATE] = 0.1, 0.3
    near, far = (kalman.with_rate(Belief(mean, covariance), 0.1).log_weight for mean in means)
    spread = 3e-4 + WITH_GYRO.rate_sample**2
    assert near == pytest.approx(-0.5 * np.log(spread))
    assert far == pytest.approx(near - 0.5 * 0.2**2 / spread)


def estimated(gyro, offset, seconds=60.0, bias=0.02):
    """Return the estimate of a worm that its map does not know to turn, on an exact circle."""
    sensors = {"strain": STRAIN, "com": COM} | ({"angular_rate": QUANTITIES["angular_rate"].default} if gyro else {})
    estimator = Estimator.for_sensors(WORM, MODEL, Schedule(), sensors)
    given, step, state = GaitParameters(0.3, 0.8), MODEL.step(0.05), np.zeros(STATES)
    state[[3, YAW_BIAS, 9]] = 0.09, bias, 1.0
    for k in range(int(seconds / 0.05)):
        t = 0.05 * k
        samples = {"com": (np.array([*state[:2], 0.03]), t), "strain": (np.zeros((6, 2)), t)}
        if gyro:
            samples["angular_rate"] = level(state[TURN_RATE] + bias + offset), t
        estimator.take(t, Measurement(t, **samples), given, 2.0 * np.pi * 0.8 * t)
        state = np.array(step(state, [0.3, 0.8, 0.0])).ravel()
    return estimator


def test_a_constant_error_of_the_gyroscopes_is_found():
    estimator = estimated(True, offset=0.004)
    belief = estimator._past[-1].beliefs[0]
    assert belief.mean[YAW_BIAS] == pytest.approx(0.02, abs=0.002)
    assert belief.mean[SIZE] == pytest.approx(0.004, abs=0.002)


def test_gyroscopes_make_the_turn_rate_better_known():
    both = np.ix_([TURN_RATE, YAW_BIAS], [TURN_RATE, YAW_BIAS])
    without, with_gyro = (estimated(gyro, 0.0, 8.0).estimate(7.95).covariance[both].sum() for gyro in (False, True))
    assert with_gyro < 0.75 * without
