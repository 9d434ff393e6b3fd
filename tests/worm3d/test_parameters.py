"""Parameters of a dataclass: the field says unit, range and meaning; checks and documentation follow."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import worm3d
from worm3d.values.parameters import check, documented, parameter, parameters_of


@documented
@dataclass(frozen=True)
class Part:
    """A part.

    Raises
    ------
    ValueError
        A value out of range.
    """

    length: float = parameter(1.0, meaning="length at rest", unit="m", gt=0)
    share: float = parameter(0.5, meaning="share of the mass", ge=0, le=1)
    count: int = parameter(3, meaning="number of springs", ge=1, le=9)
    stiffness: float = parameter(2.0, meaning="stiffness of each spring", unit="N", ge=0, each="segment")
    side: Literal["left", "right"] = parameter("left", meaning="side of the springs")
    closed: bool = parameter(False, meaning="whether it is closed")
    mass: float | None = parameter(None, meaning="mass", unit="kg", gt=0, left_out="that of its springs")

    def __post_init__(self) -> None:
        check(self, segment=self.count)


def test_values_are_checked_and_stored_in_their_type() -> None:
    part = Part(length=2, stiffness=3.0)
    assert isinstance(part.length, float)
    assert_array_equal(part.stiffness, [3.0, 3.0, 3.0])
    assert not part.stiffness.flags.writeable
    assert part.mass is None


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"length": 0.0}, "length: got 0.0 m, must be finite and above 0"),
        ({"share": 1.5}, r"share: got 1.5, must be finite and in \[0, 1\]"),
        ({"count": 10}, "count: got 10, must be a whole number of at least 1 and at most 9"),
        ({"stiffness": [1.0, 2.0]}, r"stiffness: got 2 values, must be a number or 3 of them"),
        ({"stiffness": -1.0}, "stiffness: got -1.0, every value must be finite and at least 0"),
        ({"side": "up"}, "side: got 'up', must be 'left' or 'right'"),
        ({"closed": 1}, "closed: got 1, must be True or False"),
        ({"mass": -1.0}, "mass: got -1.0 kg, must be finite and above 0"),
    ],
)
def test_bad_values(changes: dict, sentence: str) -> None:
    with pytest.raises(ValueError, match=f"^{sentence}"):
        replace(Part(), **changes)


def test_the_docstring_follows() -> None:
    text = Part.__doc__ or ""
    assert "\nlength : float [m], default 1.0\n    Length at rest; above 0.\n" in text
    assert "\nstiffness : float or ndarray, shape (N,) [N], default 2.0\n" in text
    assert "\nside : 'left' or 'right', default left\n" in text
    assert "\nmass : float [kg], default that of its springs\n" in text
    assert text.index("Attributes") < text.index("mass :") < text.index("Raises")


@pytest.mark.parametrize("part", [worm3d.Worm, worm3d.Friction])
def test_every_parameter_of_the_plant_is_documented(part: type) -> None:
    names = list(parameters_of(part))
    assert set(part.__dataclass_fields__) - set(names) <= {
        "law",
        "actuator",
        "hinge_actuator",
        "hysteresis",
        "load",
        "medium",
        "segment",
    }  # parts, with parameters of their own
    assert all(f"\n{name} : " in (part.__doc__ or "") for name in names)


def test_a_number_or_one_for_each_where_the_size_is_not_known() -> None:
    friction = worm3d.Friction(forward=[0.1, 0.2])
    assert_array_equal(friction.forward, [0.1, 0.2])
    assert np.shape(friction.backward) == ()
    with pytest.raises(ValueError, match=r"forward: got .*, a number or one for each segment"):
        worm3d.Friction(forward=[[0.1]])
