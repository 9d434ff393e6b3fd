"""Metrics as text: a number has the digits that its error leaves."""

from __future__ import annotations

import math

import pytest

from worm3d.values.metrics import rounded_up, with_error


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.0500803, 3.37e-5, "0.05008 ± 0.00004"),
        (7.3702, 0.0151, "7.370 ± 0.016"),
        (1234.5, 87.0, "1230 ± 90"),
        (0.00760012, 4.1e-6, "0.007600 ± 0.000005"),
        (-3.9, 0.5, "-3.9 ± 0.5"),
        (0.2, 3.0, "0 ± 3"),
        (5.0, 0.0296, "5.00 ± 0.03"),
        (3e-9, 2.5e-10, "3e-09 ± 2.5e-10"),
        (0.12345, 0.0, "0.123"),
        (0.12345, math.nan, "0.123"),
        (1e-13, 1e-14, "0"),
    ],
)
def test_a_value_has_the_digits_that_its_error_leaves(value: float, error: float, text: str) -> None:
    assert with_error(value, error, "m") == text


@pytest.mark.parametrize("error", [1e-7, 0.00101, 0.0194, 0.294, 0.296, 3.001, 99.1, 0.0, math.inf])
def test_an_error_is_rounded_up_once_and_by_a_third_at_most(error: float) -> None:
    off = rounded_up(error)
    assert error <= off <= 4.0 / 3.0 * error
    assert rounded_up(off) == off
