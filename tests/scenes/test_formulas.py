"""Formulas in scene files: arithmetic by the rules of arithmetic, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from scenes.language.errors import SceneError
from scenes.language.formulas import MAX_FORMULA_LENGTH, evaluated, is_formula, names_in

KNOWN = {"worm.segments": 6.0, "ratio": 4.0, "zero": 0.0}


@pytest.mark.parametrize(
    ("formula", "value"),
    [
        ("= worm.segments / 6", 1.0),
        ("=(0.006 / ratio) ** 0.5 * 2", 2 * (0.006 / 4.0) ** 0.5),
        ("= -ratio + 2 * (worm.segments - 1)", 6.0),
        ("= 2 ** 3 ** 0", 2.0),
        ("= ratio <= 4", True),
        ("= ratio * 2 > worm.segments + 3", False),
    ],
)
def test_values(formula: str, value: float) -> None:
    assert is_formula(formula)
    assert evaluated(formula, KNOWN.__getitem__) == value


def test_names_are_dotted_ones_whole() -> None:
    assert names_in("= worm.segments / ratio + ratio * 2") == {"worm.segments", "ratio"}


def test_arrays_are_taken_element_by_element() -> None:
    assert_array_equal(evaluated("= a < 0", {"a": np.array([-1.0, 0.0, np.nan])}.__getitem__), [True, False, False])


@pytest.mark.parametrize(
    ("formula", "complaint"),
    [
        ("= 1 +", "cannot be read; allowed are numbers, names"),
        ("= 1\n2", "cannot be read"),
        ("= " + "(" * 150 + "1" + ")" * 150, "at most 200"),
        ("= 1" + " + 1" * MAX_FORMULA_LENGTH, "at most 200 are allowed"),
        ("= __import__('os')", "'__import__('os')' is not allowed"),
        ("= 'text'", "is not allowed"),
        ("= True", "'True' is not allowed"),
        ("= 1 < 2 < 3", "is not allowed"),
        ("= [1]", "is not allowed"),
        ("= ().x.y", "is not known"),
        ("= 1 / zero", "has no value: float division by zero"),
        ("= 10 ** ratio ** 9", "has no value"),
        ("= 1e308 * 10", "has no value: it is no finite number"),
        ("= (0 - 1) ** 0.5", "has no value: it is no finite number"),
    ],
)
def test_what_is_no_formula_or_has_no_value(formula: str, complaint: str) -> None:
    def value_of(name: str) -> float:
        if name not in KNOWN:
            raise SceneError(f"{name} is not known")
        return KNOWN[name]

    with pytest.raises(SceneError, match=r"formula|is not known") as error:
        evaluated(formula, value_of)
    assert complaint in str(error.value)
