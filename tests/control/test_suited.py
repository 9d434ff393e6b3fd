"""Which wave suits a speed."""

import pytest

from control.gaits.steering import MECHANISMS
from control.identification.identified import load
from control.planning.feed_forward import FeedForward
from control.planning.suited import SHARE, suited
from worm3d import Worm


@pytest.mark.parametrize("mechanism", MECHANISMS)
@pytest.mark.parametrize("length", [1.0, 0.4])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_steep_wave_is_for_speeds_that_the_sine_hardly_reaches(mechanism, length, way) -> None:
    found = load(Worm())
    assert found is not None
    sine = found.maps[mechanism]
    limit = SHARE * FeedForward(sine, length).fastest
    assert suited(0.99 * way * limit, sine, length) == "sine"
    assert suited(1.01 * way * limit, sine, length) == "steep"
    assert suited(0.0, sine, length) == "sine"
