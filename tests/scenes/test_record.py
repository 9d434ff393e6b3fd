from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

from scenes.records.record import Record, Summary
from worm3d.values.variable import Variable


def record_of(*variables: Variable, **changes: Any) -> Record:
    about: dict[str, Any] = {"name": "n", "model": "k", "scene": "", "status": "done", "sentence": "", "seed": 0}
    return Record(**about, versions={}, summary=Summary({}), variables=variables, **changes)


def test_arrays_are_copies_and_read_only() -> None:
    source = np.arange(3.0)
    variable = Variable("x", ("time",), source, "m", "place")
    source[0] = 7.0
    assert variable.values[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        variable.values[0] = 1.0


def test_records_are_frozen() -> None:
    record = record_of()
    with pytest.raises(dataclasses.FrozenInstanceError):
        record.status = "other"  # type: ignore[misc]
    with pytest.raises(TypeError):
        record.versions["numpy"] = "0"  # type: ignore[index]


@pytest.mark.parametrize(
    ("dims", "values", "sentence"),
    [
        (("time",), np.zeros((2, 2)), r"x: got shape \(2, 2\), must have one axis for each of \('time',\)"),
        (("time",), np.array([b"a"]), r"x: got values of type \|S1, must be integers, floats or texts"),
        (("time",), np.array([True]), "x: got values of type bool, must be integers, floats or texts"),
    ],
)
def test_a_variable_is_numbers_with_named_axes(dims: tuple[str, ...], values: Any, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Variable("x", dims, values, "m", "place")


def test_a_dimension_has_one_length() -> None:
    with pytest.raises(ValueError, match="b: got 3 along 'time', must be 2 as in the variables before"):
        record_of(Variable("a", ("time",), np.zeros(2), "m", ""), Variable("b", ("time",), np.zeros(3), "m", ""))


def test_names_are_unique() -> None:
    twice = Variable("a", (), 1.0, "m", "")
    with pytest.raises(ValueError, match="variables: a given more than once"):
        record_of(twice, twice)


def test_a_missing_variable_is_told_with_those_there_are() -> None:
    with pytest.raises(KeyError, match="z: not in this result, which has a, b"):
        record_of(Variable("a", (), 1.0, "m", ""), Variable("b", (), 1, "1", ""))["z"]


@pytest.mark.parametrize("metric", [None, math.nan, math.inf, -math.inf])
def test_a_metric_without_a_value_has_a_reason(metric: float | None) -> None:
    summary = Summary({"a": metric, "b": 1.0}, {"a": "the worm stood still", "b": "not needed"})
    assert json.loads(json.dumps(summary.to_dict(), allow_nan=False)) == {
        "a": None,
        "b": 1.0,
        "reasons": {"a": "the worm stood still"},
    }


def test_a_reason_cannot_be_forgotten() -> None:
    with pytest.raises(ValueError, match="summary: got no value of a, must have a reason"):
        Summary({"a": math.nan})
