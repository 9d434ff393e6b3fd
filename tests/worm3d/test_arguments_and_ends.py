"""What is refused with a sentence, and what a run keeps when the user's own code fails."""

import logging
from typing import Any

import numpy as np
import pytest

from control.gaits import TravellingWave
from worm3d import Command, Friction, Held, Plane, State, StateError, Status, Worm, simulate

GAIT = TravellingWave()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"world": Friction()}, "world: got Friction, must be a world such as worm3d.Plane"),
        ({"ground": 0.3}, "ground: got float, must be a worm3d.Friction"),
        ({"external_force": np.zeros((7, 3))}, "external_force: got ndarray, must be a function of time"),
        ({"actuation": TravellingWave}, "actuation: got the class TravellingWave, must be an object"),
        ({"held": [0]}, "held.joints: got int64 values, must be True or False"),
        ({"held": Held(roll=[0])}, "held.roll: got int64 values"),
        ({"duration": 1.0, "record_every": 7}, "record_every: got 7, must divide the 100 time steps"),
        ({"record_every": 2.0}, "record_every: got 2.0, must be a whole number"),
    ],
)
def test_arguments_in_the_wrong_place_or_kind(arguments: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        simulate(Worm(), **({"world": Plane()} | arguments))


def test_a_memory_on_another_world_is_refused() -> None:
    state = simulate(Worm(), Plane(), actuation=GAIT, duration=1.0).state
    with pytest.raises(StateError, match="m inside the world"):
        simulate(Worm(), Plane(slope=0.2), state=state)


def test_an_error_of_a_controller_keeps_the_run(caplog: pytest.LogCaptureFixture) -> None:
    class Breaks:
        def reset(self) -> None:
            pass

        def step(self, t: float, _measurement: object) -> Command:
            if t > 0.195:
                raise RuntimeError("valve 3 is stuck")
            return Command(np.zeros((6, 2)))

    with caplog.at_level(logging.ERROR):
        result = simulate(Worm(), Plane(), actuation=Breaks(), duration=1.0)
    assert result.status is Status.BAD_COMMAND
    assert len(result.time) == 21
    assert "RuntimeError: valve 3 is stuck" in result.stop.sentence
    assert "Traceback" in caplog.text


def test_gravity_away_from_the_world_lifts_the_worm_off() -> None:
    """It is not settled, not refused for its weight, and flies by the parabola."""
    result = simulate(Worm(mass=2.0), Plane(), gravity=(0.0, 0.0, 9.81), duration=0.1, dt=1e-3)
    assert result.status is Status.DONE
    np.testing.assert_allclose(result.com[-1, 2] - result.com[0, 2], 0.5 * 9.81 * 0.1**2, rtol=0.02)


def test_the_final_state_has_the_rates_of_roll_and_bend() -> None:
    """A turning worm that flies freely goes on alike without its memory."""
    start = State.straight(Worm()).with_changes(roll_rate=5.0, bend_rate=1.0)
    arguments: dict[str, Any] = {"dt": 1e-3, "gravity": (0.0, 0.0, 0.0)}
    half = simulate(Worm(), None, state=start, duration=0.02, **arguments)
    np.testing.assert_allclose(half.state.roll_rate, 5.0, rtol=0.02)
    whole = simulate(Worm(), None, state=start, duration=0.04, **arguments)
    rest = simulate(Worm(), None, state=half.state.with_changes(time=0.0), duration=0.02, **arguments)
    np.testing.assert_allclose(rest.angular_momentum[-1, 0], whole.angular_momentum[-1, 0], rtol=0.02)
    np.testing.assert_allclose(rest.bend[-1], whole.bend[-1], atol=2e-3)


def test_what_is_rounding_is_no_result() -> None:
    """Without way there is no cost of transport; an actuator that does nothing has not been driven."""
    still = simulate(Worm(), Plane(), duration=0.5)
    assert still.summary()["cost_of_transport"] is None
    assert "did not move forward" in still.reasons()["cost_of_transport"]
    assert "no `period`" in still.reasons()["mean_speed_m_s"]
    sparse = simulate(Worm(), Plane(), actuation=TravellingWave(period=0.5), duration=6.0, record_every=200)
    assert "store more rows" in sparse.reasons()["mean_speed_m_s"]
    short = simulate(Worm(), Plane(), actuation=GAIT, duration=0.5)
    assert "shorter than one period" in short.reasons()["mean_speed_m_s"]


@pytest.mark.parametrize(("answer", "ends"), [(False, True), (np.False_, True), (np.array(False), True), (0, False)])
def test_an_observer_that_returns_false_ends_the_run(answer: Any, ends: bool) -> None:
    """Also as numpy has it; what is no truth value, such as None or 0, does not."""
    result = simulate(Worm(), None, duration=0.05, observer=lambda t, view: answer if t > 0.015 else None, every=1)
    assert result.status is (Status.INTERRUPTED if ends else Status.DONE)
    assert len(result.time) == (3 if ends else 6)
