"""Sensitivities of a run against central differences of two runs, and the run itself against `simulate`."""

import gc
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import (
    Bend,
    Centreline,
    Friction,
    Hydrostat,
    Jenkins,
    Payload,
    Pipe,
    Plane,
    Problem,
    Result,
    Sensitivities,
    Straight,
    Worm,
)
from worm3d.recorded.status import Status
from worm3d.running.sensitivities import Sensed
from worm3d.values.arrays import FloatArray

AT = np.array([0.2, 0.3, 2.03])
"""Amplitude, bias and period [s]. No command of this period has a kink at the end of a step."""
HEAVY = Worm(segments=10, length=1.4, mass=0.2, k_yaw=0.8, kelvin_voigt_time=0.03)
BENT = Pipe(Centreline.of([Straight(0.3), Bend(np.pi / 2, 0.48), Straight(3.0)]), 0.12)
CASES: dict[str, dict[str, Any]] = {
    "default": {"worm": Worm(), "world": Plane()},
    "other worm on a slope": {
        "worm": HEAVY,
        "world": Plane(slope=0.1, heading=0.5),
        "ground": Friction(forward=0.05, backward=0.4, lateral=0.3, static_ratio=1.3),
    },
    "implicit Euler": {"worm": Worm(), "world": Plane(), "integrator": "implicit_euler"},
    "pneumatic with friction in its joints, in a bend": {
        "worm": Worm(actuator=worm3d.ACTUATORS["pneumatic"](), hysteresis=Jenkins()),
        "world": BENT,
    },
    "outline that depends on the command": {"worm": Worm(segment=Hydrostat()), "world": Plane()},
    "one segment": {"worm": Worm(segments=1, length=0.2, mass=0.02), "world": Plane()},
}


def wave(p: FloatArray) -> TravellingWave:
    return TravellingWave(amplitude=p[0], bias=p[1], period=p[2], hinge=0.3)


def sensed(case: dict[str, Any], duration: float, actuation: Callable[[FloatArray], Any] = wave) -> Sensitivities:
    return worm3d.sensitivities(Problem(**case, duration=duration), actuation, AT)


def runs(case: dict[str, Any], actuation: Callable[[FloatArray], Any], i: int, by: float) -> list[Result]:
    """Return two runs with parameter i more and less."""
    found = []
    for sign in (1.0, -1.0):
        at = AT.copy()
        at[i] += sign * by
        found.append(worm3d.simulate(**case, actuation=actuation(at), duration=2.0))
    return found


def changes_of_regime(run: Result) -> dict[str, int]:
    """Return how often loaded contacts broke away and stuck again, and how often contacts landed and lifted."""
    load, slides = run.normal_load > 0.0, run.slip > 0.0
    stay = load[1:] & load[:-1]
    return {
        "breaks": int((stay & ~slides[:-1] & slides[1:]).sum()),
        "sticks": int((stay & slides[:-1] & ~slides[1:]).sum()),
        "lands": int((load[1:] & ~load[:-1]).sum()),
        "lifts": int((load[:-1] & ~load[1:]).sum()),
    }


@pytest.mark.parametrize("name", CASES)
def test_they_equal_central_differences_over_a_wave_with_changes_of_regime(name: str) -> None:
    """Of differences 1e-6 and 3e-6 the better counts: a change of regime in another step spoils one of them at most."""
    case = CASES[name]
    found = sensed(case, 2.0)
    assert found.status is Status.DONE
    for i in range(len(AT)):
        errors = []
        for by in (1e-6, 3e-6):
            more, less = runs(case, wave, i, by)
            worst = 0.0
            for series in ("joints", "com", "chamber_length"):
                difference = (getattr(more, series) - getattr(less, series)) / (2.0 * by)
                off = np.abs(getattr(found, f"d_{series}")[..., i] - difference).max()
                worst = max(worst, off / np.abs(difference).max()) if np.abs(difference).max() > 1e-12 else worst
            errors.append(worst)
        assert min(errors) < 1e-6, (name, i, errors)


def test_the_wave_of_these_tests_has_contacts_that_break_stick_land_and_lift() -> None:
    counts = changes_of_regime(worm3d.simulate(Worm(), Plane(), actuation=wave(AT), duration=2.0))
    assert all(count > 3 for count in counts.values()), counts


def test_the_change_of_the_heading_follows_from_the_joints() -> None:
    found = sensed(CASES["default"], 1.0)
    more, less = runs(CASES["default"], wave, 1, 1e-6)
    difference = ((more.heading - less.heading) / 2e-6)[: len(found.time)]
    np.testing.assert_allclose(found.d_heading[:, 1], difference, atol=1e-6 * np.abs(difference).max())
    assert_array_equal(found.heading, worm3d.simulate(Worm(), Plane(), actuation=wave(AT), duration=1.0).heading)


def test_a_worm_that_strikes_the_ground_has_them_too() -> None:
    """A push of a command in the air turns the worm, which then falls on the ground."""

    def pushed(p: FloatArray) -> TravellingWave:
        return TravellingWave(amplitude=p[0], bias=p[1], period=p[2])

    start = worm3d.State.straight(Worm(), Plane(), position=(0.0, 0.0, 0.02))
    case = {"worm": Worm(), "world": Plane(), "state": start, "settle_first": False}
    found = sensed(case, 0.5, pushed)
    more, less = runs(case, pushed, 0, 1e-6)
    difference = (more.joints - less.joints)[: len(found.time)] / 2e-6
    np.testing.assert_allclose(found.d_joints[..., 0], difference, atol=1e-6 * np.abs(difference).max())


@pytest.mark.parametrize("name", ["default", "other worm on a slope"])
def test_the_run_equals_that_of_simulate_bit_for_bit(name: str) -> None:
    found = sensed(CASES[name], 2.0)
    run = worm3d.simulate(**CASES[name], actuation=wave(AT), duration=2.0)
    for series in ("time", "joints", "chamber_length"):
        assert_array_equal(getattr(found, series), getattr(run, series))
    np.testing.assert_allclose(found.com, run.com, rtol=0.0, atol=1e-14)


def test_a_run_from_the_state_of_another_goes_on() -> None:
    first = worm3d.simulate(Worm(), Plane(), actuation=wave(AT), duration=0.5)
    found = sensed(CASES["default"] | {"state": first.state}, 0.5)
    whole = worm3d.simulate(Worm(), Plane(), actuation=wave(AT), duration=1.0)
    assert_array_equal(found.joints, whole.joints[50:])


def test_a_worm_that_starts_again_repeats_its_run_after_others_are_gone() -> None:
    """In a pipe of several pieces the kernel of the world has tables, which belong to each worm."""
    case = CASES["pneumatic with friction in its joints, in a bend"]
    sensed = Sensed(Problem(**case), 3)
    first = sensed.follow(wave, AT, 30)
    gc.collect()
    others = [np.full(100_000, np.nan) for _ in range(50)]  # what reuses memory
    sensed.follow(wave, 1.5 * AT, 100)
    again = sensed.follow(wave, AT, 30)
    assert len(others) == 50
    assert_array_equal(again.joints, first.joints)
    assert_array_equal(again.d_joints, first.d_joints)


def test_they_cannot_have_loads_or_controllers() -> None:
    with pytest.raises(ValueError, match=r"got a worm with loads or a medium.*use differences of two runs"):
        sensed({"worm": Worm(load=Payload(mass=0.01)), "world": Plane()}, 0.1)
    with pytest.raises(ValueError, match="must be a function from parameters to a gait"):
        worm3d.sensitivities(Problem(worm=Worm(), world=Plane()), wave(AT), AT)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"parameters: got shape \(0,\)"):
        worm3d.sensitivities(Problem(worm=Worm(), world=Plane()), wave, [])


def test_a_second_process_finds_everything_compiled() -> None:
    """It would import the compiler if the code needed a name that only a compiling Numba has."""
    sensed(CASES["default"], 0.02)
    code = """
import sys, worm3d
from control.gaits import TravellingWave
problem = worm3d.Problem(worm=worm3d.Worm(), world=worm3d.Plane(), duration=0.02)
run = worm3d.sensitivities(problem, lambda p: TravellingWave(amplitude=p[0]), [0.2])
assert run.d_com.shape == (3, 3, 1) and abs(run.d_com[-1]).max() > 0.0
assert "numba" not in sys.modules
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stderr) == (0, "")
