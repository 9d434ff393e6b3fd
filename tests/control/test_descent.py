"""Ways down that are too steep: when a worm is stopped, and when not."""

from dataclasses import replace
from math import atan, inf, radians, tan

import numpy as np
import pytest

from control.estimation.estimate import SIGNIFICANT_EXCESS, Estimate
from control.estimation.reduced import STATES, ReducedState
from control.faults.descent import DESCENT_LOOKAHEAD, MAX_GRADIENT_DEVIATION, USABLE_FRICTION_SHARE, Descent
from control.identification.identified import load
from control.sensing.sensors import Sensors
from control.supervisor import Supervisor
from control.task import ControlTask
from control.tracking.paths import Circle, Line
from control.tracking.references import Constant, Reference
from worm3d import Friction, Plane, Worm, simulate

WORM, HOLDS = Worm(), Friction().forward


def estimate(slope: tuple[float, float], deviation: float = 0.001, heading: float = 0.0, at=(0.0, 0.0)) -> Estimate:
    state = ReducedState(*at, heading, 0.08, 0.0)
    return Estimate(0.0, state, np.eye(STATES), None, np.array(slope), deviation**2 * np.eye(2))


@pytest.mark.parametrize("azimuth", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("deviation", [1e-6, 0.004])
def test_it_is_stopped_where_the_gradient_along_its_way_is_surely_beyond_friction(azimuth, deviation) -> None:
    limit = USABLE_FRICTION_SHARE * HOLDS + SIGNIFICANT_EXCESS * deviation
    along, left = np.array([np.cos(azimuth), np.sin(azimuth)]), np.array([-np.sin(azimuth), np.cos(azimuth)])
    for reference in (Reference(Constant(0.08), path=Line(azimuth=azimuth)), Reference(Constant(0.08))):
        descent = Descent(WORM, reference, HOLDS)
        for across in (0.0, 0.2):
            for share, stops in ((0.99, False), (1.01, True)):
                slope = tuple(-share * limit * along + across * left)
                found = descent.fault(3.0, estimate(slope, deviation, azimuth))
                assert (found is not None) == stops
        assert descent.fault(3.0, estimate(tuple(limit * 5.0 * along), deviation, azimuth)) is None  # up


def test_the_path_ahead_counts_and_not_where_the_worm_looks() -> None:
    radius = 0.5
    descent = Descent(WORM, Reference(Constant(0.08), path=Circle(radius)), HOLDS)
    begins = np.arccos(-USABLE_FRICTION_SHARE * HOLDS / 0.07) - DESCENT_LOOKAHEAD * WORM.length / radius
    for angle, stops in ((begins - 0.02, False), (begins + 0.02, True)):
        at = radius * np.sin(angle), radius * (1.0 - np.cos(angle))
        found = descent.fault(1.0, estimate((0.07, 0.0), 1e-9, 0.0, at))
        assert (found is not None) == stops


@pytest.mark.parametrize("path", [Line(azimuth=1.0), None])
def test_a_worm_that_goes_backwards_minds_the_way_behind_it(path) -> None:
    descent = Descent(WORM, Reference(Constant(-0.08), path=path), HOLDS)
    along = np.array([np.cos(1.0), np.sin(1.0)])
    assert descent.fault(3.0, estimate(tuple(2.0 * HOLDS * along), heading=1.0)) is not None
    assert descent.fault(3.0, estimate(tuple(-2.0 * HOLDS * along), heading=1.0)) is None


def test_a_worm_that_does_not_know_where_it_is_minds_no_slope() -> None:
    unknown = replace(estimate((-1.0, 0.0)), covariance=100.0 * np.eye(STATES))
    assert Descent(WORM, Reference(Constant(0.08), path=Line()), HOLDS).fault(1.0, unknown) is None


def test_what_is_hardly_known_stops_nobody() -> None:
    descent = Descent(WORM, Reference(Constant(0.08), path=Line()), HOLDS)
    assert descent.fault(1.0, estimate((-1.0, 0.0), 1.01 * MAX_GRADIENT_DEVIATION * HOLDS)) is None
    assert descent.fault(1.0, estimate((np.nan, 0.0))) is None
    assert descent.fault(1.0, None) is None
    assert Descent(WORM, Reference(Constant(0.08)), inf).fault(1.0, estimate((-1.0, 0.0))) is None


def test_a_worm_on_the_plant_says_that_it_slides_and_stops() -> None:
    found = load(WORM)
    assert found is not None
    supervisor = Supervisor.of(ControlTask(WORM, Reference(Constant(0.08), path=Line(start=(0.5, 0.0))), found))
    supervisor.descent.steepest = HOLDS
    world = Plane(slope=radians(3.0), heading=np.pi)
    simulate(WORM, world, actuation=supervisor, sensor=Sensors(seed=5), duration=3.0)
    (fault,) = [each for each in supervisor.faults if each.kind == "too steep down"]
    assert f"slides from {np.rad2deg(atan(HOLDS)):.2g} degrees on" in fault.what
    assert tan(radians(3.0)) > HOLDS
    assert supervisor.decisions[-1].source == "stop"


def test_a_stop_ends_and_lasts_twice_as_long_where_the_worm_gets_no_further() -> None:
    descent = Descent(WORM, Reference(Constant(0.08), path=Line()), HOLDS)
    descent.fault(0.0, estimate((-2.0 * HOLDS, 0.0)))
    slid, tries = 0.0, []
    for t in np.arange(0.0, 40.0, 0.2):
        slid += 0.004  # the worm slides: it is no proof that the slope holds
        if descent.tries(t, np.array([min(slid, 0.2), 0.0])):
            tries.append(t)
    np.testing.assert_allclose(np.diff([0.0, *tries]), [4.0, 8.2, 16.2], atol=0.21)
    assert not descent.tries(50.0, np.array([1.0, 0.0]))  # farther on it is a first stop again
    assert descent.tries(54.0, np.array([1.0, 0.0]))


def test_a_slope_on_which_the_worm_rested_without_sliding_stops_it_no_more() -> None:
    descent = Descent(WORM, Reference(Constant(0.08), path=Line()), HOLDS)
    steep, place = estimate((-2.0 * HOLDS, 0.0)), np.zeros(2)
    assert descent.fault(0.0, steep) is not None
    assert not descent.tries(0.0, place)
    assert descent.tries(4.0, place)
    assert descent.fault(5.0, steep) is None
    assert descent.fault(5.0, estimate((-2.2 * HOLDS, 0.0))) is not None
    descent.reset()
    assert descent.fault(0.0, steep) is not None


@pytest.mark.slow
def test_a_short_error_of_the_height_of_the_centre_of_mass_does_not_stop_a_worm_for_good() -> None:
    found = load(WORM)
    assert found is not None
    supervisor = Supervisor.of(ControlTask(WORM, Reference(Constant(0.08), path=Line(start=(0.5, 0.0))), found))
    sensors = Sensors(seed=5)

    def wrong(seen):
        measured = sensors(seen)
        if measured.com is None or not 4.0 < seen.time < 6.0:
            return measured
        return measured.changed(com=(measured.com + np.array([0.0, 0.0, 0.08]), measured.com_time))

    wrong.reset = sensors.reset
    run = simulate(WORM, Plane(), actuation=supervisor, sensor=wrong, duration=24.0)
    assert "too steep down" in {fault.kind for fault in supervisor.faults}
    assert (run.com[-1, 0] - run.com[-400, 0]) / 4.0 > 0.07
