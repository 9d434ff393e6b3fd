"""Whatever is asked of it, a run ends with a name, keeps its results, and never shows a NaN."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from worm3d import ClampedGround, Command, Plane, Result, State, Status, Worm, simulate

N = 6
ARRAYS = ("joints", "joint_velocity", "points", "directors", "bend", "chamber_length", "normal_load", "com", "anchors")


def finite(result: Result) -> None:
    """Every kept number is finite, and every kept row belongs to a finished step."""
    rows = len(result.time)
    for name in ARRAYS:
        values = getattr(result, name)
        assert len(values) == rows, name
        assert np.isfinite(values).all(), name
    for name, values in vars(result.energy).items():
        assert np.isfinite(values).all(), name
    assert len(result.newton_iterations) == rows - 1
    for name, values in result.state.memory.items():
        assert np.isfinite(values).all(), name
    if result.status.diverged:
        assert result.stop.step == rows, "the step after the last one kept"
        assert f"step {rows}," in result.stop.sentence


def square(amplitude: float, period: float) -> Callable[[float], Command]:
    """Return all chambers jumping between nothing and an amplitude."""
    return lambda t: Command(np.full((N, 2), amplitude * (np.floor(2 * t / period + 1e-9) % 2)))


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
@pytest.mark.parametrize("time", [0.05, 0.01])
def test_square_jumps_over_the_whole_stroke(time: float, integrator: str) -> None:
    """Jumps of 0.45 without lag, at a period of four steps of 50 ms: the worm hops, and comes through or says why."""
    worm = Worm(actuator_lag=0.0)
    result = simulate(worm, Plane(), actuation=square(0.45, 0.2), dt=time, duration=2.0, integrator=integrator)
    finite(result)
    assert result.energy.balance_error < 1e-9
    assert len(result.time) > 10, result.stop.sentence
    assert result.points[:, :, :6, 2].min() > -1e-3, "above the ground"


HARSH: dict[str, dict[str, Any]] = {
    "undamped": {"worm": Worm(kelvin_voigt_time=0.0, actuator_lag=0.0), "actuation": square(0.45, 0.1)},
    "soft and heavy": {"worm": Worm(k_spring=8.0, mass=0.3, actuator_lag=0.0), "actuation": square(0.45, 0.2)},
    "lengthened": {"worm": Worm(stroke=(-2.0, 0.45), actuator_lag=0.0), "actuation": square(-2.0, 0.2)},
    "great forces": {"actuation": lambda t: Command(np.zeros((N, 2)), force=[[-300.0, 300.0]] * N)},
    "hinges beyond a right angle": {"actuation": lambda t: Command(np.zeros((N, 2)), hinge=3.0 * t)},
    "kicked": {"external_force": lambda t: np.full((N + 1, 3), 1e4 if 0.2 < t < 0.25 else 0.0)},
    "pressed down": {"external_force": lambda t: np.full((N + 1, 3), [0.0, 0.0, -1e3 * t])},
    "thrown at the ground": {
        "state": State.straight(Worm(), Plane(), (0.0, 0.0, 0.1)).with_changes(joint_velocity=[[3.0, 0.0, -30.0]] * 7)
    },
    "limp in twist": {"worm": Worm(k_twist=0.0, k_yaw=0.0), "actuation": square(0.45, 0.2)},
    "clamped": {"world": ClampedGround(), "worm": Worm(actuator_lag=0.0), "actuation": square(0.45, 0.1)},
    "spinning": {
        "world": None,
        "state": State.straight(Worm(), position=(0, 0, 50.0)).with_changes(
            joint_velocity=np.cross([300.0, 200.0, 900.0], State.straight(Worm()).joints)
        ),
    },
}


@pytest.mark.parametrize("integrator", ["bdf2", "implicit_euler"])
@pytest.mark.parametrize("name", HARSH)
def test_harsh_treatment_ends_with_a_name(name: str, integrator: str) -> None:
    arguments = {"worm": Worm(), "world": Plane(), "dt": 0.05, "duration": 2.0, "integrator": integrator} | HARSH[name]
    result = simulate(arguments.pop("worm"), arguments.pop("world"), **arguments)
    finite(result)
    assert isinstance(result.status, Status)
    assert result.status not in (Status.INTERRUPTED, Status.BAD_COMMAND, Status.UNSETTLED)
    if name in ("hinges beyond a right angle", "lengthened"):
        geometric = (Status.FOLDED, Status.FLATTENED) if name.startswith("hinges") else (Status.FLATTENED,)
        assert result.status in geometric, result.stop.sentence


def test_results_up_to_the_end_are_those_of_a_shorter_run() -> None:
    """A run that folds at some step is, until then, the run without that step, bit for bit."""
    arguments: dict[str, Any] = {"actuation": HARSH["hinges beyond a right angle"]["actuation"], "dt": 0.01}
    whole = simulate(Worm(), Plane(), duration=3.0, **arguments)
    assert whole.status in (Status.FOLDED, Status.FLATTENED)
    kept = len(whole.time) - 1
    short = simulate(Worm(), Plane(), duration=0.01 * kept, **arguments)
    assert short.status is Status.DONE
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(whole, name), getattr(short, name))


def test_halved_steps_agree_with_small_ones() -> None:
    """Where a step had to be halved the run goes on close to one with steps a twentieth as long."""
    worm, jump = Worm(actuator_lag=0.0), square(0.45, 0.4)
    coarse = simulate(worm, Plane(), actuation=jump, dt=0.05, duration=1.0)
    fine = simulate(worm, Plane(), actuation=jump, dt=0.0025, duration=1.0)
    assert coarse.status is fine.status is Status.DONE
    np.testing.assert_allclose(coarse.com[-1], fine.com[-1], rtol=0, atol=0.05)
