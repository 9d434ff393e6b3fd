"""Reports as text: numbers that have no value are blank in tables and null in JSON."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

from scenes.records.text import Column, aligned, json_bytes, markdown_table, table

COLUMNS = {"dt [ms]": Column("dt", ".1f", 1e3), "ratio": Column("ratio", ".2f", none="none")}
ROWS = [SimpleNamespace(dt=0.01, ratio=None), SimpleNamespace(dt=math.nan, ratio=12.345)]


def test_a_table_is_written_by_its_columns() -> None:
    header, rows = table(COLUMNS, ROWS)
    assert (header, rows) == (("dt [ms]", "ratio"), [("10.0", "none"), ("", "12.35")])
    assert list(aligned(header, rows)) == ["dt [ms]  ratio", "   10.0   none", "         12.35"]
    assert list(markdown_table(header, rows)) == ["| dt [ms] | ratio |", "|---|---|", "| 10.0 | none |", "|  | 12.35 |"]


def test_json_has_null_for_what_is_not_finite() -> None:
    content = {"a": [1.0, math.nan], "b": {"c": (math.inf, "µs")}, "d": None}
    assert json.loads(json_bytes(content)) == {"a": [1.0, None], "b": {"c": [None, "µs"]}, "d": None}
