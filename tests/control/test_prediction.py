"""The prediction: the reduced model step by step, its derivatives, and the sides of the misses."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.reduced import ReducedModel, ReducedState
from control.identification.identified import Identified, load
from control.planning.constraints import Roll, default_constraints
from control.planning.cost import WANTED, Cost, Prediction, Problem, Scale
from control.planning.terms import CostTerm, Heading, Offset, Speed, default_terms
from control.tracking.preview import Preview
from worm3d import Worm

STEPS = 5
STATE = np.array(ReducedState(0.3, -0.2, 0.7, 0.06, 0.1, slip=0.1, yaw_bias=0.02, drift=0.005))


def known() -> Identified:
    found = load(Worm())
    assert found is not None
    return found


def model() -> ReducedModel:
    return ReducedModel.of(Worm(), known())


FOUND = known().maps["hinge"]
SCALE = Scale(FOUND.ranges)


def predicted(steps: int = STEPS, terms: list[CostTerm] | None = None) -> Prediction:
    cost = Cost.of(model(), FOUND, 1.0, terms or default_terms(), default_constraints())
    return Prediction(model(), cost.function, 0.4, steps, SCALE)


BEFORE = np.array([0.1, -0.2, 0.3])


def inputs() -> np.ndarray:
    return np.random.default_rng(1).uniform([0.2, 0.6, -0.1], [0.35, 1.2, 0.1], (STEPS, 3))


def wanted() -> np.ndarray:
    return np.random.default_rng(2).normal(size=(STEPS, WANTED))


def test_states_are_those_of_the_models_own_steps() -> None:
    step, state = model().step(0.4), STATE
    states = predicted().states(STATE, SCALE.scaled(inputs()))
    assert_allclose(states[0], STATE)
    for k, given in enumerate(inputs(), start=1):
        state = np.array(step(state, given)).ravel()
        assert_allclose(states[k], state, atol=1e-14)


def test_slopes_against_central_differences() -> None:
    prediction, u, h = predicted(), SCALE.scaled(inputs()), 1e-6

    def misses(given: np.ndarray) -> np.ndarray:
        return prediction.misses(prediction.states(STATE, given), given, BEFORE, wanted())

    slopes = prediction.miss_slopes(prediction.states(STATE, u), u, BEFORE, wanted())
    for column in range(u.size):
        shift = h * np.eye(u.size)[column]
        assert_allclose(slopes[:, :, column], (misses(u + shift) - misses(u - shift)) / (2.0 * h), atol=2e-6)


def test_later_inputs_change_nothing_before() -> None:
    prediction, u = predicted(), SCALE.scaled(inputs())
    slopes = prediction.miss_slopes(prediction.states(STATE, u), u, BEFORE, wanted())
    for k in range(STEPS):
        assert_allclose(slopes[k, :, 3 * (k + 1) :], 0.0, atol=0.0)
        assert np.abs(slopes[k, :, 3 * k]).max() > 0.0


def test_misses_of_a_worm_beside_its_path() -> None:
    """Left of the path is a positive offset, a heading to its left a positive one, and slip is taken off the speed.

    A worm that is carried to the right by 0.016 m/s stands to the left, by 0.2 rad at 0.08 m/s, and never by more than
    0.3 rad.
    """
    state = np.array(ReducedState(0.0, 1.3, np.pi / 2 + 0.2, 0.08, 0.0, slip=0.25, drift=-0.016))
    upwards = [0.05, 0.1, 1.0, np.pi / 2, *[0.0] * (WANTED - 4)]  # along y, a tenth to the right of the worm
    wanted = np.tile(upwards, (3, 1))
    wanted[:, 4] = [0.0, 1.0 / 0.08, 1.0 / 0.01]
    states, given = np.tile(state, (4, 1)), SCALE.scaled(np.tile([0.3, 0.8, 0.0], (3, 1)))
    terms = [Speed(1.0, large=1e6), Offset(1.0), Heading(1.0, large=1e6)]
    seen = predicted(3, terms).misses(states, given, BEFORE, wanted)
    assert_allclose(seen[:, :3], [[0.75 * 0.08 - 0.05, 0.1, heading] for heading in (0.2, 0.0, -0.1)], atol=1e-12)


def test_the_roll_is_that_of_the_wave_however_slow_it_is_and_whichever_way_it_goes() -> None:
    """By the map at the size of the amplitude, a frequency that was identified, and the steering in force."""
    found = known().maps["both"]
    cost = Cost.of(ReducedModel.of(Worm(), known(), "both"), found, 1.0, [Speed()], [Roll(limit=0.1, tolerance=0.01)])
    state = np.array(ReducedState(0.0, 0.0, 0.0, 0.05, 0.0)._replace(steering=0.4))
    least, scale = found.ranges.frequency[0], Scale(found.ranges)
    for given, frequency in (((0.3, 0.9, 0.02), 0.9), ((-0.3, 0.9, 0.02), 0.9), ((0.3, least - 0.3, 0.02), least)):
        misses = np.array(cost.function(state, scale.scaled(np.array(given)), BEFORE, np.zeros(WANTED))).ravel()
        roll = float(found.roll(0.3, frequency, 0.4))
        assert misses[-1] == pytest.approx((roll - 0.1) / 0.01)
        assert abs(roll) > 1e-3


def seen_ahead(speed: float, follows: bool) -> Preview:
    """Return three steps at a speed, at the origin, without bounds."""
    far, none = np.full(3, np.inf), np.zeros(3)
    return Preview(np.full(3, speed), np.zeros((3, 2)), none, follows, True, 0.0, far, far, far, far, np.full(3, 0.1))


def test_a_worm_stands_across_its_path_as_far_as_the_speed_asked_for_says_and_no_slow_one_farther() -> None:
    """Carried aside by 0.002 m/s it turns by 0.002 m/s over the speed, below 0.02 m/s as at 0.02 m/s, the way it goes.

    Without a path it does not turn at all.
    """
    terms = [Heading(1.0, large=1e6)]
    cost = Cost.of(model(), FOUND, 1.0, terms, ())
    prediction = Prediction(model(), cost.function, 0.4, 3, SCALE)
    state = np.array(ReducedState(0.0, 0.0, 0.0, 0.0, 0.0, drift=0.002))
    z, none = SCALE.scaled(np.tile([0.3, 0.8, 0.0], (3, 1))), np.zeros(3)

    def misses(speed: float, follows: bool) -> np.ndarray:
        return Problem(prediction, cost, state, seen_ahead(speed, follows), 0.02, BEFORE, none).residuals(z)

    plain = misses(0.08, follows=False)
    crabs = {speed: misses(speed, follows=True) - plain for speed in (0.08, 0.04, 0.02, 0.01, 0.0, -0.04, -0.01)}
    assert (crabs[0.08] > 0.0).all()
    for speed, crab in crabs.items():
        assert_allclose(crab, np.copysign(0.08 / max(abs(speed), 0.02), speed) * crabs[0.08], rtol=1e-9)


def test_the_last_residuals_of_a_problem_are_the_excesses_that_count_only_where_they_are_positive() -> None:
    """Rolls far below their limit are excesses far below 0; a speed is missed by less than 1."""
    cost = Cost.of(ReducedModel.of(Worm(), known(), "both"), known().maps["both"], 1.0, [Speed(1.0)], [Roll(5.0, 0.1)])
    problem = Problem(
        Prediction(model(), cost.function, 0.4, 3, SCALE),
        cost,
        STATE,
        seen_ahead(0.1, False),
        0.02,
        BEFORE,
        np.zeros(3),
    )
    z = SCALE.scaled(np.tile([0.3, 0.8, 0.0], (3, 1)))
    values, slopes = problem.linearised(z)
    assert problem.limits == 3
    assert len(values) == len(slopes) > 3
    assert (values[-3:] < -40.0).all()
    assert (values[:-3] > -1.0).all()
    assert_allclose(problem.residuals(z), values, atol=0.0)
