"""Series are declared once: what is recorded, its documentation and its units follow from that."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Plane, State, Worm
from worm3d.recorded.series import Recorded, Steps, series_of


@pytest.fixture(scope="module")
def run() -> worm3d.Result:
    gait = TravellingWave(amplitude=0.3, bias=0.5)
    return worm3d.simulate(Worm(), Plane(), actuation=gait, duration=0.5, record_every=5)


@pytest.mark.parametrize("name", series_of(worm3d.Result))
def test_each_series_has_the_shape_and_the_line_that_are_declared(run: worm3d.Result, name: str) -> None:
    series, value = series_of(worm3d.Result)[name], getattr(run, name)
    lengths = {"time": 11, "step": 50}
    expected = (*(lengths[dim] for dim in series.dims[:1]), *series.shape(6))
    assert np.shape(value) == expected
    assert worm3d.Result.__doc__ is not None
    unit = "" if series.unit == "1" else f" [{series.unit}]"
    said = " ".join(worm3d.Result.__doc__.split())
    assert f"{series.meaning[1:]}{unit}." in said


def test_the_order_of_declaration_is_that_of_the_variables(run: worm3d.Result) -> None:
    names = [variable.name for variable in run.variables()]
    ordered = [*series_of(Recorded), *series_of(worm3d.Energy), *series_of(Steps)]
    assert names == ordered
    assert len(set(names)) == len(names)


def test_nothing_is_recorded_where_the_memory_is_not_the_solvers() -> None:
    """Rows are copies: what a run records stays when it goes on."""
    kept: list[np.ndarray] = []
    result = worm3d.simulate(
        Worm(), Plane(), duration=0.2, observer=lambda t, view: kept.append(view.result().points), every=5
    )
    for k, points in enumerate(kept):
        assert_array_equal(points, result.points[: 5 * k + 1])


def test_twist_is_the_roll_of_neighbours_against_each_other() -> None:
    roll = np.array([0.0, 0.1, 0.3, 0.25, -0.1, 0.05])
    directors = np.column_stack([np.zeros(6), np.cos(roll), np.sin(roll)])
    joints = np.column_stack([np.linspace(0.0, 1.0, 7), np.zeros(7), np.ones(7)])
    result = worm3d.simulate(Worm(), None, state=State(joints=joints, directors=directors), duration=0.01)
    assert_allclose(result.twist[0], np.diff(roll), rtol=1e-13)
