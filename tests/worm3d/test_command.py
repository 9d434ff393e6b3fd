"""Commands are frozen, complete and checked."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from worm3d import Command


def test_scalars_fill_and_defaults_are_zero() -> None:
    command = Command(np.full((4, 2), 0.1), hinge=0.2)
    assert command.segments == 4
    assert_array_equal(command.hinge, [0.2, 0.2, 0.2])
    assert_array_equal(command.force, np.zeros((4, 2)))


def test_arrays_are_copies_and_read_only() -> None:
    contraction = np.zeros((3, 2))
    command = Command(contraction)
    contraction[0, 0] = 1.0
    assert command.contraction[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        command.contraction[0, 0] = 1.0


def test_equality_compares_values() -> None:
    assert Command(np.zeros((3, 2))) == Command(np.zeros((3, 2)), hinge=0.0)
    assert Command(np.zeros((3, 2))) != Command(np.zeros((3, 2)), hinge=0.1)
    assert Command(np.zeros((3, 2))) != Command(np.zeros((4, 2)))
    assert Command(np.zeros((3, 2))) != Command(np.zeros((3, 2)), force=1.0)
    assert Command(np.zeros((3, 2))) != "command"
    with pytest.raises(TypeError, match="unhashable"):
        hash(Command(np.zeros((3, 2))))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((np.zeros(6),), r"contraction: got shape \(6,\), must be \(N, 2\)"),
        ((np.zeros((6, 2)), np.zeros(6)), "hinge: got 6 values, must be a number or 5 of them"),
        ((np.zeros((6, 2)), 0.0, np.zeros((2, 6))), r"force: got shape \(2, 6\), must be \(6, 2\)"),
        ((np.zeros((0, 2)),), r"contraction: got shape \(0, 2\), must be \(N, 2\)"),
        ((np.full((6, 2), 1.0),), "contraction: got 1.0, must be below 1"),
        ((np.full((6, 2), np.nan),), "contraction: got nan, every value must be finite"),
    ],
)
def test_bad_commands(arguments: tuple, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Command(*arguments)
