from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from scenes.records.summary import Summary, write_summary


@pytest.mark.parametrize("figure", [None, math.nan, math.inf, -math.inf])
def test_a_figure_without_a_value_has_a_reason(figure: float | None, tmp_path: Path) -> None:
    summary = Summary({"a": figure, "b": 1.0}, {"a": "the worm stood still", "b": "not needed"})
    write_summary(summary, {"wall_s": 2.0}, tmp_path / "summary.json")
    assert json.loads((tmp_path / "summary.json").read_text()) == {
        "a": None,
        "b": 1.0,
        "reasons": {"a": "the worm stood still"},
        "wall_s": 2.0,
    }


def test_a_reason_cannot_be_forgotten() -> None:
    with pytest.raises(ValueError, match="summary: a without a value, must have a reason"):
        Summary({"a": math.nan})
