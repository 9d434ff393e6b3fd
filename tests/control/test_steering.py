"""The steering schedule: its formulas, mirror images, continuity at run time, and the bars on the plant."""

import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from control.gaits import TravellingWave
from control.gaits.steering import (
    MECHANISMS,
    UNIT_STEERING,
    WAVE_SCHEDULES,
    GaitParameters,
    PlannedWave,
    Schedule,
    SteeredWave,
    WaveGenerator,
)
from control.identification.identified import Motion, steady_motion
from worm3d import Commands, Plane, Status, Worm, simulate

WORM = Worm()
SCHEDULE = Schedule()
STRAIGHT = GaitParameters(0.3, 0.8)
ENOUGH = {"hinge": (0.03, 0.06, 0.09, 0.12), "bias": (0.015, 0.03, 0.045, 0.06), "both": (0.25, 0.5, 0.75)}


def commands(phase: float, given: GaitParameters, schedule: Schedule = SCHEDULE) -> Commands:
    return schedule.commands_at(np.array([phase]), given.row()[None], WORM)


def motion_of(parameters: GaitParameters, waves: int = 8, skipped: int = 4) -> Motion:
    rows = round(100 / parameters.frequency)
    run = simulate(WORM, Plane(), actuation=SteeredWave(parameters), duration=0.01 * rows * waves)
    assert run.status is Status.DONE, run.stop.sentence
    return steady_motion(run.com, run.heading, rows, skipped, WORM.length)


def test_the_schedule_is_its_formula() -> None:
    given, phase = GaitParameters(0.3, 0.9, bias=0.1, hinge=0.2), 1.3
    found = commands(phase, given)
    ahead = phase + 2 * np.pi * 0.9 * SCHEDULE.lead
    for i in range(6):
        x = (i + 0.5) / 6
        pulse = max(0.0, np.sin(2 * np.pi * x / 0.7 + phase))
        unequal = 0.1 * np.sin(2 * np.pi * x / 1.4 + ahead + np.deg2rad(105))
        assert_allclose(found.contraction[0, i], [0.3 * (pulse + unequal), 0.3 * (pulse - unequal)], atol=1e-14)
        if i > 0:
            bend = 0.2 * np.sin(2 * np.pi * x / 1.4 + ahead + np.deg2rad(90))
            assert_allclose(found.hinge[0, i - 1], bend, atol=1e-14)
    assert_array_equal(found.force, 0.0)


def test_a_steep_wave_is_cut_at_the_amplitude_and_stays_there_for_a_third() -> None:
    phase = np.linspace(0.0, 2.0 * np.pi, 600, endpoint=False)
    rows = np.tile(GaitParameters(0.3, 0.8).row(), (len(phase), 1))
    found = WAVE_SCHEDULES["steep"].commands_at(phase, rows, WORM).contraction[..., 0]
    sine = np.sin(2 * np.pi * (np.arange(6) + 0.5) / 6 / 0.7 + phase[:, None])
    assert_allclose(found, 0.3 * np.clip(2.0 * sine, 0.0, 1.0), atol=1e-14)
    assert_allclose((found == 0.3).mean(axis=0), 1 / 3, atol=0.01)


@seed(2)
@given(phase=st.floats(0, 100), bias=st.floats(-0.2, 0.2), hinge=st.floats(-0.3, 0.3))
def test_mirrored_steering_is_the_mirror_image(phase: float, bias: float, hinge: float) -> None:
    left = commands(phase, GaitParameters(0.3, 0.8, bias, hinge))
    right = commands(phase, GaitParameters(0.3, 0.8, -bias, -hinge))
    assert_array_equal(right.contraction, left.contraction[..., ::-1])
    assert_array_equal(right.hinge, -left.hinge)


def test_without_steering_it_is_the_travelling_wave() -> None:
    for direction in ("retrograde", "direct"):
        wave = SteeredWave(GaitParameters(0.3, 0.5), Schedule(wavelength=1.0, direction=direction), blend=1e-3)
        plain = TravellingWave(amplitude=0.3, period=2.0, wavelength=1.0, direction=direction)
        times = np.linspace(0.5, 4.0, 20)
        assert_allclose(wave.bind(WORM).commands(times).contraction, plain.bind(WORM).commands(times).contraction)


def test_contraction_is_clipped_to_the_stroke() -> None:
    found = np.array([commands(p, GaitParameters(0.4, 0.8, bias=0.9)).contraction for p in np.linspace(0, 6.3, 50)])
    assert (found.min(), found.max()) == WORM.stroke


def test_the_generator_makes_the_gaits_wave() -> None:
    target = GaitParameters(0.3, 0.8, 0.05, 0.1)
    generator, wave = WaveGenerator(SCHEDULE, WORM), SteeredWave(target).bind(WORM)
    for k in range(400):
        given, same = generator.step(0.0 if k == 0 else 0.01, target), wave(0.01 * k)
        assert_allclose(given.contraction, same.contraction, atol=1e-12)
        assert_allclose(given.hinge, same.hinge, atol=1e-12)


def largest_jump(dt: float) -> float:
    """Return the greatest change of a command in a step while a controller asks for something else all the time."""
    generator, last, largest = WaveGenerator(SCHEDULE, WORM), None, 0.0
    for k in range(round(20.0 / dt)):
        asked = np.random.default_rng(round(k * dt / 0.1)).uniform([0.0, 0.4, -0.2, -0.2], [0.4, 1.5, 0.2, 0.2])
        command = generator.step(dt, GaitParameters(*asked))
        now = np.concatenate([command.contraction.ravel(), command.hinge])
        largest = max(largest, float(np.abs(now - last).max()) if last is not None else 0.0)
        last = now
    return largest


@pytest.mark.slow
def test_commands_are_continuous_whatever_is_asked_for() -> None:
    coarse, fine = largest_jump(4e-3), largest_jump(1e-3)
    assert fine == pytest.approx(coarse / 4.0, rel=0.2), "a jump would not shrink with the time step"
    assert coarse < 0.4 * (2 * np.pi * 1.5 + 1.5 / 0.25) * 4e-3


def test_the_phase_accumulates() -> None:
    generator = WaveGenerator(SCHEDULE, WORM)
    for target, steps in ((GaitParameters(0.3, 0.5), 400), (GaitParameters(0.3, 1.0), 1200)):
        for _ in range(steps):
            generator.step(0.01, target)
    # f' = (1 - f) f / blend from 0.5 to 1: blend ln 2 waves less than at 1 Hz from the start.
    assert generator.waves == pytest.approx(2.0 + 12.0 - 0.25 * np.log(2.0), abs=0.01)
    assert generator.parameters is not None
    assert generator.parameters.frequency == pytest.approx(1.0)
    generator.reset()
    assert (generator.phase, generator.parameters) == (0.0, None)


def test_a_planned_wave_follows_its_plan() -> None:
    plan = PlannedWave(lambda t: STRAIGHT if t < 3.0 else STRAIGHT.steered("hinge", 0.1), WaveGenerator(SCHEDULE, WORM))
    run = simulate(WORM, Plane(), actuation=plan, duration=6.0)
    turned = np.rad2deg(run.heading - run.heading[0])
    assert abs(turned[:300]).max() < 1e-6
    assert turned[-1] > 10.0


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_each_mechanism_turns_ten_degrees_a_wave_at_amplitude_0_3(mechanism) -> None:
    """The bar of steering: at least 10 degrees a wave, monotone, at no less than the straight worm's speed."""
    straight = motion_of(STRAIGHT)
    found = [motion_of(STRAIGHT.steered(mechanism, s)) for s in ENOUGH[mechanism]]
    turns = np.rad2deg([straight.turn, *(motion.turn for motion in found)])
    assert abs(turns[0]) < 1e-6
    assert (np.diff(turns) > 1.0).all(), turns
    assert turns[-1] > 12.0
    assert min(motion.distance for motion in found) > straight.distance > 0.09
    assert max(abs(motion.drift) for motion in found) < 0.015


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_steering_is_the_inverse_of_steered(mechanism) -> None:
    wave = STRAIGHT.steered(mechanism, -0.7)
    assert wave.steering(mechanism) == pytest.approx(-0.7, rel=1e-14)
    assert (wave.amplitude, wave.frequency) == (STRAIGHT.amplitude, STRAIGHT.frequency)
    assert STRAIGHT.steering(mechanism) == 0.0


def test_steering_of_a_wave_that_a_mechanism_cannot_make_is_the_nearest() -> None:
    wave, s = GaitParameters(0.3, 0.8, bias=0.01, hinge=0.07), np.linspace(-1.0, 1.0, 20001)
    nearest = s[
        np.argmin((s * UNIT_STEERING["both"][0] - wave.hinge) ** 2 + (s * UNIT_STEERING["both"][1] - wave.bias) ** 2)
    ]
    assert wave.steering("both") == pytest.approx(nearest, abs=1e-4)
    assert wave.steering("hinge") == wave.hinge
    assert wave.steering("bias") == wave.bias


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_a_mirrored_command_turns_the_worm_as_much_to_the_other_side(mechanism) -> None:
    left, right = (motion_of(STRAIGHT.steered(mechanism, side * ENOUGH[mechanism][1])) for side in (1.0, -1.0))
    assert left.turn > np.deg2rad(4.0)
    assert_allclose([right.distance, -right.turn, -right.drift], [left.distance, left.turn, left.drift], atol=1e-9)


def test_a_bend_in_step_with_the_contraction_shuffles_instead() -> None:
    """Why the bending wave is twice as long: at the contraction's wavelength all feet step to the same side."""
    same = Schedule(steering_wavelength=0.7, hinge_phase=np.deg2rad(75.0), lead=0.0)
    rows = 125
    run = simulate(
        WORM, Plane(), actuation=SteeredWave(STRAIGHT.steered("hinge", 0.08), same), duration=0.01 * rows * 8
    )
    motion = steady_motion(run.com, run.heading, rows, 4, WORM.length)
    assert abs(np.rad2deg(motion.turn)) < 1.5
    assert abs(motion.drift) > 0.02


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (lambda: GaitParameters(float("inf"), 1.0), "amplitude: got inf, must be finite"),
        (lambda: GaitParameters(0.1, 0.0), "frequency: got 0.0 Hz, must be above 0"),
        (lambda: GaitParameters(0.1, 1.0, hinge=float("nan")), "hinge: got nan, must be finite"),
        (lambda: Schedule(wavelength=0.0), "wavelength: got 0.0 body lengths, must be finite and above 0"),
        (lambda: Schedule(lead=float("inf")), "lead: got inf s, must be finite"),
        (lambda: Schedule(direction="standing"), "direction: got 'standing', must be 'direct' or 'retrograde'"),
        (lambda: WaveGenerator(SCHEDULE, WORM, blend=0.0), "blend: got 0.0 waves, must be finite and above 0"),
    ],
)
def test_bad_steering(build, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        build()
