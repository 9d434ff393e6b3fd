"""Ways down that are too steep: when a worm is stopped, and when not."""

from dataclasses import replace
from math import atan, inf, radians, tan

import numpy as np
import pytest

from control.estimation.estimate import Estimate
from control.estimation.reduced import STATES, ReducedState
from control.faults.descent import AHEAD, KNOWN, MARGIN, SURE, Descent
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
    limit = MARGIN * HOLDS + SURE * deviation
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
    begins = np.arccos(-MARGIN * HOLDS / 0.07) - AHEAD * WORM.length / radius
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
    assert descent.fault(1.0, estimate((-1.0, 0.0), 1.01 * KNOWN * HOLDS)) is None
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
    assert f"slides from {np.rad2deg(atan(HOLDS)):.2g} on" in fault.what
    assert tan(radians(3.0)) > HOLDS
    assert supervisor.decisions[-1].source == "stop"
