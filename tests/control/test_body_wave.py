"""Waves with a bend beside them: closed form of the share that the bend has in a turn."""

import numpy as np
import pytest

from control.chambers.controller import along_path
from control.chambers.wave import ASIDE, GUIDED, BodyWave
from control.estimation.estimator import BEGIN, Estimator
from control.estimation.kalman import GAINS
from control.estimation.reduced import ReducedModel, ReducedState
from control.gaits.steering import GaitParameters, Schedule, WaveGenerator
from control.identification import identified
from control.sensing.sensors import HEADING_SENSOR, Measurement
from control.tracking.paths import Circle, Line
from worm3d import Worm

WORM = Worm()
MAP = identified.load(WORM).maps["hinge"]
ASKED = GaitParameters(0.3, 0.8, 0.0, 0.08)
N = WORM.segments


def body_wave():
    return BodyWave(WaveGenerator(Schedule(), WORM), MAP, WORM)


def bent(angle):
    made = body_wave()
    made.beyond = made.given = np.concatenate([np.zeros(2 * N), np.full(N - 1, angle / (N - 1))])
    made.step(0.0, ASKED)
    return made


def test_without_anything_beside_it_is_the_wave_bit_for_bit():
    plain, made = WaveGenerator(Schedule(), WORM), body_wave()
    for _ in range(30):
        one, other = plain.step(0.02, ASKED), made.step(0.02, ASKED)
        assert np.array_equal(one.contraction, other.contraction)
        assert np.array_equal(one.hinge, other.hinge)


@pytest.mark.parametrize("angle", [-0.2, 0.1, 0.5])
def test_bend_and_wave_together_turn_as_asked(angle):
    made = bent(angle)
    left = made.allotted(ASKED)
    turn, way = (float(f(0.3, 0.8, ASKED.hinge)) for f in (MAP.turn, MAP.distance))
    assert float(MAP.turn(0.3, 0.8, left.hinge)) + GUIDED * angle * way == pytest.approx(turn, abs=2e-3)
    assert (left.amplitude, left.frequency, left.bias) == (ASKED.amplitude, ASKED.frequency, 0.0)


@pytest.mark.parametrize("angle", [-0.2, 0.5])
def test_a_bent_body_goes_aside_by_its_bend_and_by_what_its_wave_leaves_undone(angle):
    made = bent(angle)
    left, way = made.allotted(ASKED), float(MAP.distance(0.3, 0.8, ASKED.hinge))
    undone = float(MAP.drift(0.3, 0.8, left.hinge)) - float(MAP.drift(0.3, 0.8, ASKED.hinge))
    assert made.crab == pytest.approx(ASIDE * angle + undone / way)
    made.bend = 0.0
    made.allotted(ASKED)
    assert made.crab == 0.0


def test_a_bend_beyond_what_steering_can_undo_keeps_within_the_map():
    assert abs(bent(9.0).allotted(ASKED).hinge) == pytest.approx(MAP.ranges.steering)


def test_chambers_beside_the_wave_bend_it_and_keep_to_the_stroke():
    made = body_wave()
    contraction = np.zeros((2, N))
    contraction[0] = 0.06  # left chambers shorter: to the left by l0 c/(2 b) a segment, half of it at either end
    made.beyond = made.given = np.concatenate([contraction.ravel(), np.zeros(N - 1)])
    command = made.step(0.0, ASKED)
    assert made.bend == pytest.approx((N - 1) * WORM.l0 * 0.06 / (2.0 * WORM.chamber_offset))
    assert command.contraction.max() <= WORM.stroke[1]
    assert command.contraction.min() >= WORM.stroke[0]


def test_postures_follow_the_path():
    assert np.array_equal(along_path(WORM, Line(), 0.3), np.zeros(N - 1))
    circle = along_path(WORM, Circle(0.6), 1.0)
    np.testing.assert_allclose(circle, WORM.l0 / 0.6 * np.array([1.0, 0.5, 0.0, 0.5, 1.0]), atol=1e-12)
    np.testing.assert_allclose(along_path(WORM, Circle(0.6, towards="right"), 1.0), -circle, atol=1e-12)


def believed(channels, told):
    """Return the state that is believed after a straight way, with or without being told of a crab angle of 0.1."""
    model = ReducedModel.of(WORM, identified.load(WORM))
    estimator = Estimator.for_sensors(WORM, model, Schedule(), channels)
    for k in range(40):
        t, place = 0.1 * k, np.array([0.008 * k, 0.0, 0.03])
        seen = Measurement(t, strain=(np.zeros((N, 2)), t), com=(place, t))
        estimator.take(t, seen, ASKED, 2.0 * np.pi * 0.08 * k)
        if told:
            estimator.crabs(0.1)
    return estimator.estimate(4.0).state


def test_the_crab_of_a_bent_body_is_taken_as_known_and_turns_what_is_believed_of_its_heading():
    plain, bent_body = believed({}, told=False), believed({}, told=True)
    assert (plain.crab, bent_body.crab) == (0.0, 0.1)
    assert bent_body.heading - plain.heading == pytest.approx(-0.1, abs=0.05)


def test_a_sensor_of_the_heading_shows_the_crab_itself():
    assert believed({"heading": HEADING_SENSOR}, told=True) == believed({"heading": HEADING_SENSOR}, told=False)


@pytest.mark.parametrize(("gain", "taken"), [(0.5, 0.5), (2.0, 2.0), (0.01, GAINS[0]), (9.0, GAINS[1])])
def test_a_worm_that_is_told_how_it_turns_takes_that_within_bounds_and_as_uncertain_as_at_the_start(
    gain: float, taken: float
) -> None:
    """The rest of what it believes stays, and has nothing to do with the gain."""
    model, index = ReducedModel.of(WORM, identified.load(WORM)), ReducedState._fields.index("turn_gain")
    estimator = Estimator(WORM, model, heading=0.3)
    before = estimator.estimate(0.0)
    estimator.turns(gain)
    after = estimator.estimate(0.0)
    assert after.state.turn_gain == pytest.approx(taken)
    assert after.state._replace(turn_gain=before.state.turn_gain) == before.state
    expected = before.covariance.copy()
    expected[index] = expected[:, index] = 0.0
    expected[index, index] = BEGIN["turn_gain"] ** 2
    np.testing.assert_allclose(after.covariance, expected, rtol=1e-12)
