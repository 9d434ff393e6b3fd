"""Sections whose keys follow from the parameters of dataclasses."""

import math
from dataclasses import dataclass
from typing import Literal

import pytest
from numpy.testing import assert_allclose

from scenes.language.checks import cross_mistakes, kind_checks
from scenes.language.mistakes import dotted, schema_mistakes
from scenes.language.parts import PartSection, keys_by_parameter, keys_of, part_of
from scenes.language.reading import trusted
from scenes.language.schema import Section, keys_in, setting
from worm3d.values.parameters import check, parameter


@dataclass(frozen=True)
class Spring:
    stiffness: float = parameter(2.0, meaning="force over strain", unit="N", gt=0, key="spring_N")
    angle: float = parameter(math.pi / 6, meaning="angle at rest", unit="rad", ge=-math.pi, le=math.pi, aka=("turn",))
    weights: float = parameter(1.0, meaning="share of each segment", ge=0, each="segment")
    side: Literal["left", "right"] = parameter("left", meaning="side")

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class Piston:
    pressure: float = parameter(1e4, meaning="pressure of the supply", unit="Pa", ge=0)
    angle: float = parameter(0.0, meaning="angle at rest", unit="rad")
    valve: Literal["open", "shut"] = parameter("open", meaning="state of the valve")
    side: Literal["left", "right", "both"] = parameter("both", meaning="side")
    rate: float = parameter(math.inf, meaning="steps a second", unit="1/s", gt=0, infinite=True, left_out="no limit")

    def __post_init__(self) -> None:
        check(self)


DRIVES = {"spring": Spring, "piston": Piston}


class Drive(PartSection, keys=keys_of(DRIVES, by="kind", meaning="what drives it", defaults={"pressure": 3e4})):
    """What drives it."""

    gain: float = setting(1.0, meaning="a key of its own")


class Two(PartSection, keys=keys_of(Spring, prefix="a_") | keys_of(Spring, prefix="b_", without=("weights",))):
    """Two springs."""


class Scene(Section):
    """A scene."""

    drive: Drive = Drive()


def test_keys_are_names_with_their_units() -> None:
    keys = ["kind", "spring_N", "angle_deg", "weights", "side", "pressure_Pa", "valve", "rate_per_s", "gain"]
    assert list(keys_in(Drive)) == keys
    assert keys_by_parameter(Piston, Drive)["rate"] == "rate_per_s"
    assert [key for key in keys_in(Two) if key.startswith("b_")] == ["b_spring_N", "b_angle_deg", "b_side"]


def test_a_section_says_what_the_fields_say() -> None:
    keys = keys_in(Drive)
    assert keys["spring_N"].meaning == "force over strain"
    assert keys["spring_N"].described() == " [N], 0 < … (default 2.0)"
    assert keys["angle_deg"].described() == " [deg], -180 <= … <= 180 (default 30.0)"
    assert keys["rate_per_s"].described() == " [1/s], 0 < … (default no limit)"
    assert keys["pressure_Pa"].described().endswith("(default 30000.0)")
    assert keys["kind"].choices == ("spring", "piston")
    assert keys["spring_N"].only == ("spring",)
    assert keys["angle_deg"].only == ()
    assert keys["side"].choices == ("left", "right", "both")
    assert keys["side"].words_for("spring") == ("left", "right")
    assert keys["valve"].meaning_in_section == "piston only: state of the valve"


def test_a_section_becomes_its_part() -> None:
    spring = part_of(Spring, Drive(angle_deg=45.0, weights=[1.0, 2.0]))
    assert_allclose(spring.angle, math.pi / 4)
    assert_allclose(spring.weights, [1.0, 2.0])
    piston = part_of(DRIVES["piston"], Drive(kind="piston", valve="shut"), stiffness=1.0)  # which it does not have
    assert (piston.valve, piston.rate, piston.pressure) == ("shut", math.inf, 3e4)
    assert part_of(Spring, Two(b_spring_N=5.0), prefix="b_").stiffness == 5.0


def test_some_parameters_in_other_units_and_ranges() -> None:
    keys = keys_of(Spring, these=("stiffness", "weights"), units={"weights": "rad/s"}, bounds={"stiffness": {"ge": 1}})
    assert list(keys) == ["spring_N", "weights_deg_s"]
    assert keys["spring_N"].described() == " [N], 1 <= … (default 2.0)"

    class Turned(PartSection, keys=keys):
        """A spring."""

    spring = part_of(Spring, Turned(weights_deg_s=180.0, spring_N=3.0), units={"weights": "rad/s"})
    assert_allclose((spring.weights, spring.stiffness), (math.pi, 3.0))
    both = part_of(Spring, Turned(spring_N=4.0), Two())
    assert (both.stiffness, both.angle) == (4.0, Spring().angle)


@pytest.mark.parametrize(
    ("drive", "text"),
    [
        ({"spring_N": 0.0}, "drive.spring_N: got 0.0: input should be greater than 0 [N], 0 < … (default 2.0)"),
        ({"stiffness": 1.0}, "drive.stiffness: unknown key; did you mean 'spring_N'?"),
        ({"turn": 1.0}, "drive.turn: unknown key; did you mean 'angle_deg'?"),
        ({"side": "both"}, "drive.side: got 'both': not for drive.kind = 'spring'; allowed here: 'left', 'right'"),
        (
            {"weights": [1.0, -1.0]},
            "drive.weights[1]: got -1.0: input should be greater than or equal to 0, 0 <= …, a number or one "
            "for each segment (default 1.0)",
        ),
        (
            {"pressure_Pa": 1.0},
            "drive.pressure_Pa: only for drive.kind = 'piston', but this scene has 'spring': leave it out "
            "(default 30000.0), or change drive.kind",
        ),
    ],
)
def test_mistakes_follow(drive: dict, text: str) -> None:
    data = {"drive": drive}
    found = schema_mistakes(Scene, data)
    found += cross_mistakes(kind_checks(Drive, "drive"), Scene, data, found)
    assert [f"{dotted(mistake.path)}: {mistake.text}" for mistake in found] == [text]


@dataclass(frozen=True)
class Bare:
    width: float = parameter(meaning="width", unit="m", gt=0)
    note: str | None = parameter(None, meaning="a text", left_out="none")
    turns: int | None = parameter(None, meaning="number of turns", left_out="none")
    pairs: float = parameter(0.0, meaning="a pair for each segment", each="side")

    def __post_init__(self) -> None:
        check(self)


class Choice(PartSection, keys=keys_of({"spring": Spring, "bare": Bare}, by="kind", meaning="what it is")):
    """One of two, of which one has a key without a default."""


class Choices(Section):
    """A scene."""

    one: Choice = Choice()


def lines(**keys: object) -> list[str]:
    return [f"{dotted(mistake.path)}: {mistake.text}" for mistake in schema_mistakes(Choices, {"one": keys})]


def test_a_key_that_must_be_given_is_missed_only_where_its_kind_is_chosen() -> None:
    assert lines() == lines(kind="spring") == []
    assert lines(kind="bare") == ["one.width_m: missing: bare only: width [m], 0 < …"]
    assert lines(kind="bare", width_m=1.0) == []


def test_types_of_parameters_that_may_be_left_out() -> None:
    assert lines(kind="bare", width_m=1.0, note="a text", turns=3) == []
    assert lines(kind="bare", width_m=1.0, turns=2.5)[0].startswith(
        "one.turns: got 2.5: input should be a valid integer"
    )
    assert lines(kind="bare", width_m=1.0, note=2)[0].startswith("one.note: got 2: input should be a valid string")


def test_lists_of_pairs() -> None:
    section = trusted(Choices, {"one": {"kind": "bare", "width_m": 1.0, "pairs": [[0.0, 0.5], [1, 2]]}}).one
    assert section.pairs == ((0.0, 0.5), (1.0, 2.0))
    assert trusted(Choices, {"one": {"kind": "bare", "width_m": 1.0, "pairs": [0.0, 0.5]}}).one.pairs == (0.0, 0.5)
    (line,) = lines(kind="bare", width_m=1.0, pairs=[[0.0, "x"]])
    assert line.startswith("one.pairs[0][1]: got 'x': input should be a valid number")


def test_a_number_of_hundreds_of_digits_is_a_mistake() -> None:
    assert "input should be a finite number" in lines(kind="bare", width_m=10**400)[0]
