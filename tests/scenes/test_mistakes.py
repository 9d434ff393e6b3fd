"""Lines about single keys, with a schema of our own that has mandatory keys and nested sections."""

from __future__ import annotations

import math
from typing import Any, Literal

import pytest

from scenes.language.mistakes import Mistake, report, schema_mistakes
from scenes.language.reading import trusted
from scenes.language.schema import Each, Section, setting
from scenes.language.toml import key_lines


class Wave(Section):
    length_m: float = setting(1.0, unit="m", gt=0, le=100, meaning="length", aka=("lambda_m",))
    count: int = setting(3, ge=1, lt=10, meaning="number of waves")
    kind: Literal["sine", "square"] = setting("sine", meaning="shape")
    on: bool = setting(True, meaning="whether it runs")
    stiffness_N: Each[float] = setting(13.0, unit="N", gt=0, each="segment", meaning="stiffness")
    height_m: float | None = setting(unit="m", gt=0, left_out="half the length", meaning="height")
    values: tuple[float, ...] = setting((1, 2), meaning="values")


class Body(Section):
    mass_kg: float = setting(unit="kg", gt=0, meaning="mass")
    name: str = setting(meaning="name")


class Whole(Section):
    wave: Wave = Wave()
    body: Body


def line_about(path: str, value: Any) -> str:
    section, key = path.split(".")
    data = {"body": {"mass_kg": 1.0, "name": "x"}, "wave": {}}
    data[section] = {**data[section], key: value}
    mistakes = schema_mistakes(Whole, data)
    assert len(mistakes) == 1
    return mistakes[0].text


@pytest.mark.parametrize("value", ["1.0 m", "1.0", True, [1.0], {"x": 1}])
def test_only_numbers_are_numbers(value: Any) -> None:
    assert line_about("wave.length_m", value).endswith(
        ": input should be a valid number [m], 0 < … <= 100 (default 1.0)"
    )


def test_what_was_found_is_shown_as_in_the_file() -> None:
    assert line_about("wave.length_m", "1.0 m").startswith("got '1.0 m': ")
    assert line_about("wave.length_m", True).startswith("got true: ")
    assert line_about("wave.length_m", list(range(1000))).startswith("got [0, 1, 2, ")
    assert len(line_about("wave.length_m", list(range(1000)))) < 150


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_are_finite(value: float) -> None:
    assert f"got {value}: input should be a finite number [m]" in line_about("wave.length_m", value)


@pytest.mark.parametrize(
    ("value", "rule"), [(0.0, "greater than 0"), (-1, "greater than 0"), (100.5, "less than or equal to 100")]
)
def test_range(value: float, rule: str) -> None:
    text = line_about("wave.length_m", value)
    assert text == f"got {value}: input should be {rule} [m], 0 < … <= 100 (default 1.0)"


@pytest.mark.parametrize("value", [1.0, True, "1"])
def test_only_integers_are_integers(value: Any) -> None:
    assert "input should be a valid integer, 1 <= … < 10 (default 3)" in line_about("wave.count", value)


def test_one_is_not_true() -> None:
    assert line_about("wave.on", 1) == "got 1: input should be a valid boolean (default true)"


def test_an_integer_will_do_for_a_number() -> None:
    assert schema_mistakes(Whole, {"wave": {"length_m": 2}, "body": {"mass_kg": 1, "name": ""}}) == []


def test_choices_are_listed() -> None:
    assert line_about("wave.kind", "sqare") == (
        "got 'sqare': input should be 'sine' or 'square'; did you mean 'square'? (default 'sine')"
    )
    assert line_about("wave.kind", 7) == "got 7: input should be 'sine' or 'square' (default 'sine')"


@pytest.mark.parametrize("value", [3, 2.5, [1.0], [1, 2, 3]])
def test_a_number_for_all_or_a_list_with_one_for_each(value: Any) -> None:
    data = {"wave": {"stiffness_N": value}, "body": {"mass_kg": 1.0, "name": "x"}}
    kept = trusted(Whole, data).wave.stiffness_N
    assert kept == (tuple(value) if isinstance(value, list) else value)
    assert isinstance(hash(kept), int), "a frozen scene holds nothing that can change"


@pytest.mark.parametrize(
    ("value", "found"),
    [
        ("13 N", "got '13 N': input should be a valid number"),
        (True, "got true: input should be a valid number"),
        (-1.0, "got -1.0: input should be greater than 0"),
        ([1.0, 0.0], "got 0.0: input should be greater than 0"),
        ([True], "got true: input should be a valid number"),
        ([math.nan], "got nan: input should be a finite number"),
    ],
)
def test_each_number_of_a_list_is_checked(value: Any, found: str) -> None:
    rest = " [N], 0 < …, a number or one for each segment (default 13.0)"
    assert line_about("wave.stiffness_N", value) == found + rest


def test_a_wrong_number_in_a_list_is_named_by_its_place() -> None:
    text = "[wave]\nstiffness_N = [\n  1,\n  -2]\n"
    found = schema_mistakes(Whole, {"wave": {"stiffness_N": [1, -2]}, "body": {"mass_kg": 1.0, "name": ""}})
    assert [line.split(": ")[:2] for line in report(found, key_lines(text), [])] == [["line 2", "wave.stiffness_N[1]"]]


def test_what_holds_for_a_key_that_is_left_out_is_told() -> None:
    text = line_about("wave.height_m", 0)
    assert text == "got 0: input should be greater than 0 [m], 0 < … (default half the length)"


@pytest.mark.parametrize(("value", "what"), [(3, "a valid list"), (["x"], "a valid number")])
def test_lists_of_numbers(value: Any, what: str) -> None:
    data = {"wave": {"values": value}, "body": {"mass_kg": 1.0, "name": ""}}
    assert what in schema_mistakes(Whole, data)[0].text
    assert "tuple" not in schema_mistakes(Whole, data)[0].text


def test_unknown_key_with_and_without_a_guess() -> None:
    assert line_about("wave.lenght_m", 1.0) == "unknown key; did you mean 'length_m'?"
    assert line_about("wave.lamda_m", 1.0) == "unknown key; did you mean 'length_m'?"
    assert (
        line_about("wave.zzz", 1.0)
        == "unknown key; known here: length_m, count, kind, on, stiffness_N, height_m, values"
    )


def test_missing_keys_are_named_at_the_header_of_their_section() -> None:
    text = "[wave]\ncount = 2\n\n[body]\n"
    mistakes = schema_mistakes(Whole, {"wave": {"count": 2}, "body": {}})
    assert report(mistakes, key_lines(text), []) == (
        "line 4: body.mass_kg: missing: mass [kg], 0 < …",
        "line 4: body.name: missing: name",
    )


def test_a_section_must_be_a_section() -> None:
    assert [m.text for m in schema_mistakes(Whole, {"wave": 3, "body": {"mass_kg": 1.0, "name": "x"}})] == [
        "got 3: must be a section of keys under the header [wave]"
    ]


def test_lines_come_in_the_order_of_the_file_and_overrides_last() -> None:
    text = "a = 1\n\n[b]\nc = 2\n"
    mistakes = [Mistake(("d",), "3"), Mistake(("b", "c"), "2"), Mistake(("a",), "1")]
    assert report(mistakes, key_lines(text), [("d",)]) == ("line 1: a: 1", "line 4: b.c: 2", "override d: 3")
