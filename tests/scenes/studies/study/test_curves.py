"""Shapes of curves: what is said follows from the values, and turns with them."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.studies.study.curves import Shape, sentence

NAN = float("nan")


@pytest.mark.parametrize(
    ("y", "kind"),
    [
        ([1.0, 2.0, 3.0], "rises"),
        ([3.0, 2.0, 1.0], "falls"),
        ([1.0, 3.0, 2.0], "peak"),
        ([3.0, 1.0, 2.0], "dip"),
        ([1.0, 3.0, 1.0, 3.0], "several"),
        ([1.0, 1.02, 1.01], "flat"),
        ([0.0, 0.0], "flat"),
        ([-1.0, 1.0], "rises"),
        ([1.0, 1.99, 1.96, 3.0], "rises"),
        ([3.0, 2.0, 1.0, 1.04], "falls"),
        ([1.0, 0.96, 2.0, 3.0], "rises"),
        ([NAN, 1.0, NAN, 2.0, NAN], "rises"),
        ([1.0, NAN], "none"),
        ([NAN, NAN], "none"),
    ],
)
def test_kind(y: list[float], kind: str) -> None:
    assert Shape.of(np.array(y)).kind == kind
    mirrored = {"rises": "falls", "falls": "rises", "peak": "dip", "dip": "peak"}
    assert Shape.of(-np.array(y)).kind == mirrored.get(kind, kind)


@pytest.mark.parametrize(
    ("y", "off", "kind"),
    [
        ([1.0, 2.0], [0.4, 0.4], "rises"),
        ([1.0, 2.0], [0.6, 0.6], "flat"),
        ([1.0, 3.0, 2.0], [0.4, 0.4, 0.4], "peak"),
        ([1.0, 3.0, 2.0], [0.0, 0.6, 0.6], "rises"),
        ([1.0, 3.0, 2.0], [0.0, NAN, 0.6], "peak"),
        ([0.0, 3.0, 1.0, 9.0], [0.0, 0.0, 0.0, 0.0], "several"),
        ([0.0, 3.0, 1.0, 9.0], [0.0, 1.0, 1.5, 0.0], "rises"),
    ],
)
def test_what_is_no_more_than_its_error_is_no_shape(y: list[float], off: list[float], kind: str) -> None:
    assert Shape.of(np.array(y), np.array(off)).kind == kind


def test_values_are_level_up_to_the_sum_of_their_errors() -> None:
    shape = Shape.of(np.array([1.0, 2.0, 1.9, NAN]), np.array([0.2, 0.06, 0.05, 9.0]))
    assert shape.level(1) == [1, 2]
    assert shape.level(0) == [0]


def told(y: list[float], better: str = "more", off: float = 0.0) -> str:
    values = np.array(y)
    shape = Shape.of(values, np.full(len(y), off))
    return sentence(shape, "speed", "period", lambda k: f"{k} s", lambda k: f"{values[k]:g} m/s", better)


@pytest.mark.parametrize(
    ("y", "text"),
    [
        (
            [1.0, 2.0, 4.0],
            "speed rises with period, from 1 m/s at 0 s to 4 m/s at 2 s (the range ends there) (4 times as much)",
        ),
        (
            [4.0, 2.0, 1.0],
            "speed falls with period, from 4 m/s at 0 s (the range ends there) to 1 m/s at 2 s (a factor of 4 less)",
        ),
        (
            [1.0, 1.1, 1.2],
            "speed rises with period, from 1 m/s at 0 s to 1.2 m/s at 2 s (the range ends there) (+20%)",
        ),
        (
            [NAN, 1.0, 1.1, 1.2, NAN],
            "speed rises with period, from 1 m/s at 1 s to 1.2 m/s at 3 s (the values end there) (+20%)",
        ),
        (
            [0.0, 0.95, 0.98, 1.0],
            "speed rises with period, from 0 m/s at 0 s to 1 m/s at 3 s (the range ends there), "
            "nine tenths of the way at 1 s",
        ),
        (
            [1.0, 2.95, 3.0, 2.0],
            "speed is greatest at 2 s: 3 m/s (within 5% of it from 1 s to 2 s), "
            "compared with 1 m/s at 0 s and 2 m/s at 3 s",
        ),
        (
            [3.0, 1.0, 2.0],
            "speed is least at 1 s: 1 m/s, compared with 3 m/s at 0 s (the range ends there) and 2 m/s at 2 s",
        ),
        (
            [1.0, 3.0, 1.0, 2.0],
            "speed goes up and down with period: 1 m/s at 0 s, 3 m/s at 1 s, 1 m/s at 2 s, 2 m/s at 3 s; best at 1 s",
        ),
        ([2.0, 2.01], "speed hardly depends on period: 2 m/s to 2.01 m/s"),
        ([NAN, 2.0], "speed is known at one value of period alone, 2 m/s at 1 s"),
        ([NAN, NAN], "speed is known nowhere"),
    ],
)
def test_sentences(y: list[float], text: str) -> None:
    assert told(y) == text


def test_the_neighbourhood_of_a_best_value_is_told_where_less_is_better() -> None:
    assert "(within 5% of it from 1 s to 2 s)" in told([3.0, 1.0, 1.02, 2.0], "less")


def test_a_curve_says_what_is_level_with_its_best_and_what_its_errors_hide() -> None:
    assert told([1.0, 3.0, 1.0, 2.95], off=0.1).endswith("; best at 1 s, level with 3 s")
    flat = told([1.0, 2.0], off=0.6)
    assert flat == "speed hardly depends on period: 1 m/s to 2 m/s, no further apart than their errors"
    assert "range ends" not in told([1.0, 2.0, 4.0], better="")
