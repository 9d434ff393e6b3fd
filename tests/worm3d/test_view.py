"""What an observer sees is what is recorded; what it does changes no number of the run."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import Plane, Status, Worm
from worm3d.recorded.series import Recorded, series_of
from worm3d.running.view import SEEN

GIVEN: dict[str, Any] = {"actuation": TravellingWave(amplitude=0.3, bias=0.3, hinge=0.5), "duration": 0.5}


def test_it_sees_every_series_as_it_is_recorded() -> None:
    seen: dict[str, list[np.ndarray]] = {name: [] for name in SEEN}

    def look(t: float, view: worm3d.View) -> None:
        assert t == view.time
        for name in SEEN:
            seen[name].append(getattr(view, name))

    result = worm3d.simulate(Worm(), Plane(0.1), **GIVEN, observer=look, every=1)
    assert set(series_of(Recorded)) <= set(SEEN)
    for name in SEEN:
        if name == "heading":  # unwrapped in a result
            assert_allclose(np.exp(1j * np.array(seen[name])), np.exp(1j * result.heading), rtol=1e-15)
        else:
            assert_array_equal(np.array(seen[name]), getattr(result, name), err_msg=name)


@pytest.mark.parametrize("record_every", [1, 25])
def test_looking_changes_nothing(record_every: int) -> None:
    given = {**GIVEN, "record_every": record_every}
    alone = worm3d.simulate(Worm(), Plane(), **given)

    def look(t: float, view: worm3d.View) -> None:
        assert view.state().time == t
        assert len(view.result().time) == view.step // record_every + 1
        assert view.observation().time == t
        assert np.isfinite(view.joints).all()

    watched = worm3d.simulate(Worm(), Plane(), **given, observer=look, every=3)
    for name in series_of(Recorded):
        assert_array_equal(getattr(watched, name), getattr(alone, name), err_msg=name)
    for term in ("work_contract", "friction_loss", "numerical_loss"):
        assert_array_equal(getattr(watched.energy, term), getattr(alone.energy, term))
    for name, memory in alone.state.memory.items():
        assert_array_equal(watched.state.memory[name], memory, err_msg=name)


def test_the_view_is_read_only_and_of_its_instant() -> None:
    views: list[worm3d.View] = []
    kept: list[np.ndarray] = []

    def look(t: float, view: worm3d.View) -> None:
        views.append(view)
        kept.append(view.com)
        with pytest.raises(ValueError, match="read-only"):
            view.joints[0, 0] = 1.0
        with pytest.raises(AttributeError, match="a view of a run has no 'comm'; it has actuator_states, anchors, "):
            _ = view.comm

    result = worm3d.simulate(Worm(), Plane(), **GIVEN, observer=look, every=25)
    assert_array_equal(kept, result.com[::25], err_msg="arrays that are kept stay what they were")
    with pytest.raises(ValueError, match=r"view: got one of step 0 when the run is at step 50, must be read before"):
        _ = views[0].com
    assert {"joints", "com", "heading", "state", "result"} <= set(dir(views[0]))


def test_an_error_of_the_observer_is_told_and_keeps_the_steps(caplog: pytest.LogCaptureFixture) -> None:
    def fail(t: float, view: worm3d.View) -> None:
        if view.step == 30:
            raise KeyError("what")

    result = worm3d.simulate(Worm(), Plane(), **GIVEN, observer=fail, every=10)
    assert result.status is Status.OBSERVER_FAILED
    assert not result.status.diverged
    assert len(result.time) == 31
    expected = "the observer raised an error; the steps so far are kept (step 30, t = 0.3 s): KeyError: 'what'"
    assert result.stop.sentence == expected
    assert "test_view.py" in caplog.text, "with the place where it was raised"


def test_false_at_the_start_ends_it_before_the_first_step_and_at_the_end_nothing() -> None:
    none = worm3d.simulate(Worm(), Plane(), **GIVEN, observer=lambda t, view: False)
    assert (none.status, len(none.time)) == (Status.INTERRUPTED, 1)
    whole = worm3d.simulate(Worm(), Plane(), **GIVEN, observer=lambda t, view: view.step < view.steps, every=50)
    assert whole.status is Status.DONE


@pytest.mark.parametrize("every", [0, 2.5, True])
def test_every_is_a_whole_number_of_steps(every: Any) -> None:
    with pytest.raises(ValueError, match=r"every: got .*, must be a whole number of at least 1"):
        worm3d.simulate(Worm(), Plane(), **GIVEN, observer=lambda t, view: None, every=every)
