"""Recorded commands: interpolation, and conversion of recorded pressures by the segment law."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.gaits import RecordedCommands
from worm3d import Learned, Plane, Worm, simulate

TIME = np.array([0.5, 1.0, 3.0])


def test_commands_are_interpolated_and_constant_outside() -> None:
    value = np.random.default_rng(0).uniform(0.0, 0.3, (3, 4, 2))
    commands = RecordedCommands(TIME, value).bind(Worm(segments=4))
    times = np.array([0.0, 0.5, 0.6, 1.0, 2.9, 3.0, 9.0])
    found = commands.commands(times)
    for segment, side in np.ndindex(4, 2):
        right = np.interp(times, TIME, value[:, segment, side])
        assert_allclose(found.contraction[:, segment, side], right, rtol=1e-14)
    assert_array_equal(commands(2.9).contraction, found.contraction[4])
    assert not found.hinge.any()


def test_a_pressure_is_interpolated_before_it_is_converted() -> None:
    """The table of the barrel bends, so that the mean of two contractions is not the contraction at the mean."""
    worm = Worm(segments=3, segment=Learned("barrel.json"))
    commands = RecordedCommands(TIME, [0.0, 3000.0, 0.0], "pressure").bind(worm)
    assert_allclose(commands(0.75).contraction, worm.segment.contraction_of(1500.0), rtol=1e-14)
    assert commands(0.75).contraction[0, 0] < 0.45 * commands(1.0).contraction[0, 0]
    run = simulate(worm, Plane(), actuation=RecordedCommands([0.0, 0.1], [0.0, 2000.0], "pressure"), duration=0.1)
    assert_allclose(worm.segment.input_of(run.command[-1]), 2000.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("time", "value", "quantity", "sentence"),
    [
        (
            TIME,
            [0.0, 0.1, 0.5],
            "contraction",
            r"contractions from 0 to 0.5, must be from -0.1 to 0.45, the worm",
        ),
        (TIME, [0.0, 0.1, 0.2], "pressure", r"the law 'rhombus' has no pressure; command the contraction"),
        (TIME, [0.0, 0.1, 0.2], "volume", r"quantity: got 'volume', must be one of 'contraction', 'pressure', 'cable'"),
        (TIME, np.zeros((3, 5, 2)), "contraction", r"value: got 5 segments and 2 chambers, must be the 6 segments"),
        (TIME[::-1], [0.0, 0.1, 0.2], "contraction", r"time: got 1 s after 3 s, must ascend"),
        (TIME, [0.0, np.nan, 0.2], "contraction", r"value: got nan, every value must be"),
        (TIME, [0.0, 0.2], "contraction", r"value: got shape \(2, 1, 1\), must be \(3, N, C\)"),
    ],
)
def test_mistakes(time: np.ndarray, value: object, quantity: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        RecordedCommands(time, value, quantity).bind(Worm())
