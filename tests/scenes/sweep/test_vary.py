from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from scenes import models
from scenes.language.errors import SceneError
from scenes.sweep.design import Design, told
from scenes.sweep.vary import MOST_CASES, cases_of, design_of, texts

WORM = models.get("worm").schema


def design(vary: dict[str, Any], **options: Any) -> Design:
    return design_of("flat", WORM, vary, **options)


def values(text: Any, key: str = "gait.period_s", **options: Any) -> list[Any]:
    return [case[key] for case in design({key: text}, **options).cases()]


@pytest.mark.parametrize(
    ("key", "text", "expected"),
    [
        ("gait.period_s", "2,3.5", [2, 3.5]),
        ("gait.period_s", " 2 ", [2]),
        ("gait.direction", "direct, retrograde", ["direct", "retrograde"]),
        ("start.contracted", "true,false", [True, False]),
        ("worm.spring_N", "[13, 13, 12],13", [[13, 13, 12], 13]),
        ("world", '{kind = "plane", slope_deg = 3}, 3', [{"kind": "plane", "slope_deg": 3}, 3]),
        ("title", '"a, b",c', ["a, b", "c"]),
        ("gait.period_s", "0:3:11", [0.0, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8, 2.1, 2.4, 2.7, 3.0]),
        ("gait.period_s", "1:100:3:log", [1.0, 10.0, 100.0]),
        ("worm.segments", "3:7:5", [3, 4, 5, 6, 7]),
        ("worm.segments", "1:64:7:log", [1, 2, 4, 8, 16, 32, 64]),
        ("worm.segments", "3:5:9", [3, 4, 5]),
        ("gait.period_s", np.array([1.0, 2.0]), [1.0, 2.0]),
        ("worm.segments", range(3, 5), [3, 4]),
        ("worm.segments", 3, [3]),
    ],
)  # fmt: skip
def test_values_as_they_are_written(key: str, text: Any, expected: list[Any]) -> None:
    found = values(text, key)
    assert found == expected
    assert [type(value) for value in found] == [type(value) for value in expected]


def test_several_keys_make_a_grid_whose_last_key_varies_fastest() -> None:
    grid = design({"worm.segments": "3,4", "gait.period_s": "1,2,3"})
    assert grid.sizes == {"worm.segments": 2, "gait.period_s": 3}
    assert len(grid) == 6
    assert [tuple(case.values()) for case in grid.cases()] == [(3, 1), (3, 2), (3, 3), (4, 1), (4, 2), (4, 3)]
    assert [(each.unit, bool(each.title)) for each in grid.varied] == [("1", True), ("s", True)]
    assert told({"gait.period_s": 2.5, "gait.kind": "wave"}) == "gait.period_s = 2.5, gait.kind = wave"


def test_drawn_values_follow_from_seed_and_key_alone() -> None:
    few, many = values("1:3", random=5), values("1:3", random=50)
    assert many[:5] == few, "more cases begin with the same ones: they are kept"
    other_key = design({"gait.amplitude": "0:0.3", "gait.period_s": "1:3"}, random=5)
    assert [case["gait.period_s"] for case in other_key.cases()] == few
    assert values("1:3", random=5, seed=1) != few
    assert other_key.sizes == {"case": 5}
    assert min(many) < 1.2
    assert max(many) > 2.8


def test_logarithms_and_whole_numbers_are_drawn_evenly() -> None:
    drawn = np.log10(values("0.01:100:log", random=2000))
    assert_allclose([drawn.mean(), drawn.std()], [0.0, 4.0 / np.sqrt(12.0)], atol=0.1)
    counts = np.bincount(values("3:6", "worm.segments", random=2000))
    assert len(counts) == 7
    assert_allclose(counts[3:], 500, atol=90)


def test_drawn_cases_beside_a_grid_have_a_dimension_of_their_own() -> None:
    mixed = design({"worm.segments": "3,4", "gait.period_s": "1:3", "gait.amplitude": "0.1:0.2"}, random=4)
    assert mixed.sizes == {"worm.segments": 2, "sample": 4}
    cases = list(mixed.cases())
    assert [case["gait.period_s"] for case in cases[:4]] == [case["gait.period_s"] for case in cases[4:]]


def test_cases_of_a_table(tmp_path: Path) -> None:
    (tmp_path / "cases.csv").write_text("gait.period_s, gait.direction\n2.5,direct\n\n3,retrograde\n")
    listed = cases_of(tmp_path / "cases.csv")
    assert listed == [
        {"gait.period_s": 2.5, "gait.direction": "direct"},
        {"gait.period_s": 3, "gait.direction": "retrograde"},
    ]
    assert list(design({}, listed=listed).cases()) == listed
    assert design({"worm.segments": "3,4"}, listed=listed).sizes == {"worm.segments": 2, "sample": 2}


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "the file is empty"),
        ("gait.period_s\n", "no cases; below the row of keys"),
        ("a,a\n1,2\n", "its first row must be keys of the scene, each once; got a, a"),
        ("a,b\n1\n", "row 2: got 1 values, must be 2"),
        ("a,b\n1,2\n3,\n", "row 3: got 1 values, must be 2"),
    ],
)
def test_tables_that_are_none(tmp_path: Path, content: str, complaint: str) -> None:
    (tmp_path / "cases.csv").write_text(content)
    with pytest.raises(SceneError, match=complaint) as error:
        cases_of(tmp_path / "cases.csv")
    assert len(error.value.lines) == 1


def test_options_of_the_command() -> None:
    assert texts([" gait.period_s = 1,2", "world.kind=plane"]) == {"gait.period_s": " 1,2", "world.kind": "plane"}
    for wrong in ("gait.period_s", "=1", "gait.period_s="):
        with pytest.raises(SceneError, match=r"must be key=values, such as gait\.period_s=2,3,4"):
            texts([wrong])
    with pytest.raises(SceneError, match=r"--vary a: given twice"):
        texts(["a=1", "a=2"])


@pytest.mark.parametrize(
    ("vary", "options", "complaint"),
    [
        ({}, {}, "flat: nothing to vary"),
        ({"gait.period_s": []}, {}, "gait.period_s: no values"),
        ({"gait.period_s": ",,"}, {}, "gait.period_s: no values"),
        ({"gait.period_s": "1,2,1"}, {}, "got 1 twice"),
        ({"gait.period_s": "2,2.0"}, {}, "got 2.0 twice"),
        ({"gait.period_s": "1:2"}, {}, "a range needs a number of values, gait.period_s=1:2:5, or --random N"),
        ({"gait.period_s": "1:2:1"}, {}, "must be from 2 to 100000 values"),
        ({"gait.period_s": "1:2:99999999999999"}, {}, "must be from 2 to 100000 values"),
        ({"gait.period_s": "-1:2:5:log"}, {}, "the limits of a range with 'log' must be above 0"),
        ({"gait.period_s": "1,2"}, {"random": 3}, "--random: no key to draw"),
        ({"gait.period_s": "2:1"}, {"random": 3}, "the first limit must be below the second"),
        ({"gait.period_s": "0:1:log"}, {"random": 3}, "must be above 0"),
        ({"worm.segments": "3.2:3.8"}, {"random": 3}, "no whole number between 3.2 and 3.8"),
        ({"gait.period_s": "1:2"}, {"random": 0}, "--random: got 0, must be from 1 to 100000"),
        ({"gait.period_s": "1:2"}, {"random": 3, "listed": [{"seed": 1}]}, "--random and --list"),
        ({"gait.period_s": "1,2"}, {"listed": [{"gait.period_s": 1}]}, "varied twice, in --vary and in --list"),
        ({"gait.period_s": "1:2:1000", "gait.amplitude": "0:0.4:1000"}, {}, r"1000000 cases \(1000 x 1000\): at most"),
        ({"gait.period_s": range(10**12)}, {}, "1000000000000 values: at most 100000"),
        ({}, {"listed": [{"gait.period_s": 1}, {"gait.amplitude": 1}]}, "case 2: got the keys gait.amplitude, must be"),
    ],
)
def test_what_cannot_be_varied_is_one_sentence(vary: dict[str, Any], options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(SceneError, match=complaint) as error:
        design(vary, **options)
    assert len(error.value.lines) == 1
    assert MOST_CASES == 100_000


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0.1:0.2:5:lgo", "a range ends with 'log' or 'lin', not 'lgo'; did you mean 0.1:0.2:5:log?"),
        ("0.1:0.2:lgo", "did you mean 0.1:0.2:log?"),
        ("0.1:0.2:2.5", "the number of values must be a whole number, 0.1:0.2:5"),
    ],
)
def test_what_is_nearly_a_range_is_told_what_is_wrong(text: str, said: str) -> None:
    with pytest.raises(SceneError) as error:
        design({"gait.amplitude": text})
    assert said in str(error.value)


def test_an_empty_table_of_cases_is_told_what_to_write(tmp_path: Path) -> None:
    (tmp_path / "cases.csv").write_text("\n")
    with pytest.raises(SceneError, match=r"file is empty; write a row of keys, such as gait\.period_s,seed"):
        cases_of(tmp_path / "cases.csv")
