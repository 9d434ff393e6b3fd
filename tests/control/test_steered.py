"""The steered wave as a gait: its formulas, its mirror image, and the bars of turning on the plant."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.gaits import GAITS, Steered
from control.gaits.steering import GaitParameters, SteeredWave
from worm3d import Friction, Plane, Result, Status, Worm, simulate

WORM = Worm()
STEERINGS = {"hinge": {"hinge": 0.15}, "bias": {"bias": 0.08}, "both": {"hinge": 0.08, "bias": 0.04}}
TIMES = np.linspace(0.0, 5.0, 41)
each_mechanism = pytest.mark.parametrize("mechanism", STEERINGS)


def gait(mechanism: str, side: float = 1.0) -> Steered:
    return Steered(amplitude=0.3, **{name: side * value for name, value in STEERINGS[mechanism].items()})


def turned(gait: Steered, worm: Worm = WORM, ground: Friction | None = None, **how: Any) -> Result:
    run = simulate(worm, Plane(), ground, gait, duration=12.5, **how)
    assert run.status is Status.DONE, run.stop.sentence
    return run


@cache
def figures(mechanism: str) -> dict[str, Any]:
    return turned(gait(mechanism)).summary()


def roll_deg(summary: dict[str, Any]) -> float:
    return 35.0 - float(summary["roll_margin_deg"])  # a worm that lies on its side has 35


def test_it_is_the_wave_of_its_schedule() -> None:
    asked = Steered(amplitude=0.3, hinge=0.1, bias=0.05, period=1.6, wavelength=0.8, steering_wavelength=3.0, lead=0.1)
    late = 16.0 + TIMES  # when that of a controller has swollen
    same = SteeredWave(GaitParameters(0.3, 1 / 1.6, bias=0.05, hinge=0.1), asked).bind(WORM).commands(late)
    found = asked.bind(WORM).commands(late)
    assert_allclose(found.contraction, same.contraction, atol=1e-13)
    assert_allclose(found.hinge, same.hinge, atol=1e-13)
    assert GAITS["steered"] is Steered


def test_without_steering_chambers_follow_the_activation_and_so_do_forces() -> None:
    straight = Steered(amplitude=0.3, force=2.0)
    found, activation = straight.bind(WORM).commands(TIMES), straight.activations(TIMES, 6)
    for side in (0, 1):
        assert_allclose(found.contraction[..., side], 0.3 * activation, atol=1e-15)
        assert_allclose(found.force[..., side], 2.0 * activation, atol=1e-15)
    assert_array_equal(found.hinge, 0.0)
    assert activation.min() == 0.0
    assert 0.99 < activation.max() <= 1.0
    assert not straight.lengthens
    assert replace(straight, bias=0.1).lengthens


@each_mechanism
def test_each_mechanism_turns_tightly_and_stays_upright(mechanism: str) -> None:
    """The bar: at least 23 degrees a wave, roll below 6.5 degrees, radius at most 0.3 body lengths."""
    found = figures(mechanism)
    assert found["degrees_per_wave_deg"] > 23.0
    assert roll_deg(found) < 6.5
    assert found["turning_radius_bl"] < 0.3
    assert found["stride_bl"] > 0.1


@each_mechanism
def test_left_and_right_are_mirror_images(mechanism: str) -> None:
    left, right = (turned(gait(mechanism, side)) for side in (1.0, -1.0))
    assert_allclose(right.com * [1, -1, 1], left.com, atol=1e-9)
    assert_allclose(right.heading, -left.heading, atol=1e-9)


@each_mechanism
def test_figures_hold_at_a_quarter_of_the_time_step(mechanism: str) -> None:
    coarse, fine = figures(mechanism), turned(gait(mechanism), dt=0.0025).summary()
    for name in ("degrees_per_wave_deg", "turning_radius_bl", "stride_bl"):
        assert fine[name] == pytest.approx(coarse[name], rel=0.05), name
    assert roll_deg(fine) == pytest.approx(roll_deg(coarse), rel=0.05)


@each_mechanism
def test_worms_and_grounds_nearby_turn_too(mechanism: str) -> None:
    """Drawn anew: masses, springs, joints and friction that differ by some 30 %."""
    rng = np.random.default_rng(19)
    for _ in range(4):
        mass, spring, yaw, forward, backward, lateral = np.exp(0.25 * np.clip(rng.normal(size=6), -1.5, 1.5))
        worm = replace(WORM, mass=0.1 * mass, k_spring=13.0 * spring, k_yaw=0.5 * yaw)
        found = turned(gait(mechanism), worm, Friction(0.03 * forward, 0.2 * backward, 0.2 * lateral)).summary()
        assert found["degrees_per_wave_deg"] > 0.7 * figures(mechanism)["degrees_per_wave_deg"]
        assert roll_deg(found) < 10.0


def test_bad_steering_is_refused() -> None:
    with pytest.raises(ValueError, match=r"steering_wavelength: got 0\.0 body lengths, must be finite and above 0"):
        Steered(steering_wavelength=0.0)
    with pytest.raises(ValueError, match=r"bias: got 2\.0, must be a number in \[-1, 1\]"):
        Steered(bias=2.0)
