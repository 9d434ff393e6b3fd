from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from numpy.testing import assert_array_equal

from scenes.records.record import Record
from scenes.records.store import export_csv, export_npz
from worm3d.values.variable import Variable, column_names


def test_csv_has_a_row_per_instant_and_reads_back_exactly(record: Record, tmp_path: Path) -> None:
    export_csv(record, tmp_path / "x.csv")
    with (tmp_path / "x.csv").open() as file:
        header, *rows = csv.reader(file)
    table = np.array(rows, dtype=float)
    column = dict(zip(header, table.T, strict=True))
    assert header[0] == "time_s"
    assert_array_equal(column["time_s"], record["time"])
    assert_array_equal(column["com_x_m"], record["com"][:, 0])
    assert_array_equal(column["main_node_3_y_m"], record["main_node"][:, 3, 1])
    assert_array_equal(column["top_node_5_x_m"], record["top_node"][:, 5, 0])
    assert not any(name.startswith(("residual", "ground")) for name in header)


def test_units_in_column_names() -> None:
    force = Variable("load", ("time", "segment"), np.zeros((1, 2)), "J/m^2", "")
    assert list(column_names(force)) == ["load_0_J_per_m2", "load_1_J_per_m2"]
    assert list(column_names(Variable("share", ("time",), np.zeros(1), "1", ""))) == ["share"]


def test_npz_has_every_variable_and_no_pickle(record: Record, tmp_path: Path) -> None:
    export_npz(record, tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz", allow_pickle=False) as arrays:
        assert set(arrays) == {"scene", *(variable.name for variable in record.variables)}
        assert_array_equal(arrays["com"], record["com"])
        assert str(arrays["scene"]) == record.scene
