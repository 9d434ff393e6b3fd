"""Reports as text: numbers that have no value are blank in tables and CSV, and null in JSON."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np

from scenes.records.text import Column, aligned, csv_bytes, json_bytes, markdown_table, table

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


def test_csv_keeps_all_digits_and_is_blank_where_there_is_no_number() -> None:
    rows = [("name", "x", "y"), ("a, b", 0.1 + 0.2, np.float64(1e-17)), ("c", math.nan, None), ("d", -math.inf, 3)]
    assert csv_bytes(rows) == b'name,x,y\n"a, b",0.30000000000000004,1e-17\nc,,\nd,,3\n'
