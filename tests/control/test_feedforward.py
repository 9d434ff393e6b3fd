"""The feed-forward: the identified map there and back."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from control.identification.identified import SteeringMap, load
from control.identification.surrogate import MIN_WAVE_FREQUENCY
from control.planning.feed_forward import PREFERRED, FeedForward
from worm3d import Worm


def found(mechanism) -> SteeringMap:
    known = load(Worm())
    assert known is not None
    return known.maps[mechanism]


@pytest.mark.parametrize("mechanism", ["hinge", "bias"])
@pytest.mark.parametrize("speed", [0.03, 0.05, 0.08, 0.1, 0.12])
@pytest.mark.parametrize("turn_rate", [0.0, 0.02, -0.04])
def test_the_wave_has_the_speed_and_turn_rate_that_were_asked_for(mechanism, speed: float, turn_rate: float) -> None:
    given = FeedForward(found(mechanism), 1.0)(speed, turn_rate)
    assert found(mechanism).speed(*given) == pytest.approx(speed, rel=1e-2)
    if speed >= 0.05:  # slower waves are of amplitudes that hardly turn by unequal chambers
        assert found(mechanism).turn_rate(*given) == pytest.approx(turn_rate, rel=1e-2, abs=2e-4)
    assert np.abs(found(mechanism).ranges.scaled(*given)).max() <= 1.0 + 1e-9


def test_left_and_right_are_mirror_images() -> None:
    forward = FeedForward(found("hinge"), 1.0)
    left, right = forward(0.08, 0.05), forward(0.08, -0.05)
    assert left[:2] == right[:2]
    assert left.steering == -right.steering > 0.0


def test_beyond_the_map_it_gives_its_edge() -> None:
    forward = FeedForward(found("hinge"), 1.0)
    ranges = found("hinge").ranges
    assert forward(1.0, 0.0) == (ranges.amplitude[1], ranges.frequency[1], 0.0)
    assert forward(0.0, 0.0) == (ranges.amplitude[0], MIN_WAVE_FREQUENCY, 0.0)
    assert forward(0.08, 9.0).steering == ranges.steering


def test_the_amplitude_does_the_work_at_the_preferred_frequency() -> None:
    forward = FeedForward(found("hinge"), 1.0)
    waves = [forward(speed, 0.0) for speed in np.linspace(0.04, 0.1, 7)]
    assert {wave.frequency for wave in waves} == {forward.frequency}
    assert (np.diff([wave.amplitude for wave in waves]) > 0.0).all()


def test_speeds_grow_with_the_body() -> None:
    small, large = FeedForward(found("hinge"), 1.0), FeedForward(found("hinge"), 2.0)
    assert large(0.16, 0.03) == pytest.approx(small(0.08, 0.03))
    assert large.slowest == pytest.approx(2.0 * small.slowest)


def test_slow_speeds_are_those_of_slow_waves_down_to_almost_nothing() -> None:
    forward, known = FeedForward(found("hinge"), 1.0), found("hinge")
    for speed in (0.001, 0.004, 0.015):
        wave = forward(speed, 0.0)
        assert wave.amplitude == known.ranges.amplitude[0]
        assert wave.frequency < known.ranges.frequency[0]
        assert known.speed(*wave) == pytest.approx(speed, rel=1e-2)
    assert forward.slowest < 0.001


def test_slow_waves_go_on_where_the_map_ends_and_as_the_plant_does() -> None:
    """(I4): continuous at the least frequency; at 0.05 Hz the plant goes 0.0574 and 0.1253 body lengths a wave."""
    known = found("hinge")
    low = known.ranges.frequency[0]
    for amplitude, plant in ((0.15, 0.0574), (0.3, 0.1253)):
        ends = [known.speed(amplitude, low + side, 0.05) for side in (-1e-9, 1e-9)]
        assert ends[0] == pytest.approx(ends[1], rel=1e-6)
        assert known.speed(amplitude, 0.05, 0.0) / 0.05 == pytest.approx(plant, rel=0.1)
        symbols = [ca.SX(value) for value in (amplitude, 0.05, 0.02)]
        for quantity in (known.speed, known.turn_rate, known.drift_speed):
            assert float(quantity(*symbols)) == pytest.approx(float(quantity(amplitude, 0.05, 0.02)), rel=1e-12)


def test_how_fast_a_curve_can_be_followed() -> None:
    """At the speed that is given the worm turns as sharply as the curve, a tenth of its turn rate to spare."""
    forward = FeedForward(found("hinge"), 1.0)
    curvatures = np.array([0.0, 1.0, -2.5, 2.5, 4.0])
    speeds = forward.reach(curvatures)
    assert speeds[0] == forward.fastest
    assert speeds[2] == speeds[3] > speeds[4]
    for speed, curvature in zip(speeds[3:], curvatures[3:], strict=True):
        assert forward.sharpest(float(speed)) * 0.9 == pytest.approx(speed * curvature, rel=0.02)


@pytest.mark.parametrize("mechanism", ["hinge", "bias"])
def test_nothing_is_followed_more_slowly_than_a_wave_that_turns_as_sharply(mechanism) -> None:
    """Heavy worms, and those that steer by unequal chambers, turn less sharply per metre in slow waves than in fast."""
    forward = FeedForward(found(mechanism), 1.0)
    for speed in np.linspace(0.01, forward.fastest, 40):
        assert forward.reach(0.98 * 0.9 * forward.sharpest(speed) / speed) > 0.99 * speed


@pytest.mark.parametrize("mechanism", ["hinge", "bias"])
def test_a_curve_that_is_too_sharp_is_followed_at_the_greatest_speed_at_which_nothing_turns_more_sharply(
    mechanism,
) -> None:
    forward = FeedForward(found(mechanism), 1.0)
    speed = float(forward.reach(1e3))
    greatest = forward.sharpest(speed) / speed
    for share in (0.1, 0.3, 0.6, 0.9):
        assert forward.sharpest(share * speed) / (share * speed) < 1.001 * greatest
    for share in (0.1, 0.3, 0.6, 0.9):
        faster = speed + share * (forward.fastest - speed)
        assert forward.sharpest(faster) / faster < 0.999 * greatest


def test_it_goes_as_slowly_as_its_slowest_wave_and_backwards_if_it_can() -> None:
    forward, both = FeedForward(found("hinge"), 1.0), FeedForward(found("hinge"), 1.0, backward=True)
    slow, still = 1.01 * forward.slowest, 0.99 * forward.slowest
    assert [forward.goes(speed) for speed in (slow, still, 0.0, -still, -slow)] == [True, False, False, False, False]
    assert [both.goes(speed) for speed in (slow, still, 0.0, -still, -slow)] == [True, False, False, False, True]


@pytest.mark.parametrize(("least", "greatest", "preferred"), [(0.4, 1.3, PREFERRED), (0.3, 0.7, 0.5), (0.9, 1.3, 1.1)])
def test_a_preferred_frequency_outside_the_map_gives_way_to_the_middle(
    least: float, greatest: float, preferred: float
) -> None:
    """The waves of middling speeds have the preferred frequency, and those of all speeds a frequency of the map."""
    known = found("hinge")
    ranges = replace(known.ranges, frequency=(least, greatest))
    forward = FeedForward(replace(known, ranges=ranges), 1.0)
    assert forward.frequency == pytest.approx(preferred)
    assert forward.wave == pytest.approx(1.0 / preferred)
    frequencies = forward.frequencies(np.linspace(forward.slowest, forward.fastest, 60))
    assert np.isclose(frequencies, preferred).sum() > 3
    assert frequencies.min() >= MIN_WAVE_FREQUENCY
    assert frequencies.max() <= greatest


@pytest.mark.parametrize("speed", [0.02, 0.03, 0.045, 0.08])
def test_slow_waves_that_turn_are_slower_than_straight_ones_of_the_same_speed(speed: float) -> None:
    """A straight wave of 0.03 m/s has 0.8 Hz and goes 1.5 times as fast when it turns as it can."""
    forward = FeedForward(found("both"), 1.0)
    curvatures = np.array([0.0, 0.5, 1.0, 2.0, -2.0])
    suited = forward.frequencies(np.full(5, speed), curvatures)
    expected = [forward(speed, curvature * speed).frequency for curvature in curvatures]
    np.testing.assert_allclose(suited, expected, rtol=0.06)
    for curvature, frequency in zip(curvatures, suited, strict=True):
        if frequency < PREFERRED:  # a wave of the least amplitude, by the map itself
            wave = forward.ranges.amplitude[0], frequency
            steerings = np.linspace(0.0, forward.ranges.steering, 2001)
            rates = [float(forward.found.turn_rate(*wave, each)) for each in steerings]
            steering = float(np.interp(abs(curvature) * speed, rates, steerings))
            assert float(forward.found.speed(*wave, steering)) == pytest.approx(speed, rel=0.02)
    assert suited[0] == forward.frequencies(np.array([speed]))[0]
    sharpest = forward.frequencies(np.full(2, speed), [50.0, 500.0])
    assert sharpest[0] == sharpest[1] <= suited[3]
    assert (sharpest[0] < 0.7 * suited[0]) == (speed < 0.04)


@pytest.mark.parametrize("turn_rate", [0.0, 0.03, -0.03])
@pytest.mark.parametrize("speed", [0.005, 0.06, 0.12])
def test_backwards_is_the_same_wave_the_other_way_round(speed: float, turn_rate: float) -> None:
    forward = FeedForward(found("hinge"), 1.0, backward=True)
    ahead, back = forward(speed, turn_rate), forward(-speed, turn_rate)
    assert ahead.amplitude > 0.0
    assert back == ahead._replace(amplitude=-ahead.amplitude)
