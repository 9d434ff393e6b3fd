"""The feed-forward: the identified map there and back."""

import numpy as np
import pytest

from control.identification.identified import SteeringMap, load
from control.planning.feed_forward import FeedForward
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
    assert found(mechanism).ranges.contain(*given)


def test_left_and_right_are_mirror_images() -> None:
    forward = FeedForward(found("hinge"), 1.0)
    left, right = forward(0.08, 0.05), forward(0.08, -0.05)
    assert left[:2] == right[:2]
    assert left.steering == -right.steering > 0.0


def test_beyond_the_map_it_gives_its_edge() -> None:
    forward = FeedForward(found("hinge"), 1.0)
    ranges = found("hinge").ranges
    assert forward(1.0, 0.0) == (ranges.amplitude[1], ranges.frequency[1], 0.0)
    assert forward(0.0, 0.0) == (ranges.amplitude[0], ranges.frequency[0], 0.0)
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
