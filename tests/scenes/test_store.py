from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

import h5netcdf
import numpy as np
import pytest
import xarray
from numpy.testing import assert_array_equal

from scenes.language.errors import DiscError, SceneError
from scenes.models.loading import load_scene
from scenes.records import store
from scenes.records.record import Record
from scenes.records.store import load, save
from scenes.running.runner import simulate
from worm3d.values.variable import Variable


def assert_same_variables(ours: tuple[Variable, ...], theirs: tuple[Variable, ...]) -> None:
    assert [v.name for v in ours] == [v.name for v in theirs]
    for a, b in zip(ours, theirs, strict=True):
        assert (a.dims, a.units, a.long_name) == (b.dims, b.units, b.long_name)
        assert a.values.dtype == b.values.dtype
        assert_array_equal(a.values, b.values, strict=True)


def assert_same(a: Record, b: Record) -> None:
    assert_same_variables(a.variables, b.variables)
    for name in ("name", "model", "scene", "status", "sentence", "seed", "versions", "summary"):
        assert getattr(a, name) == getattr(b, name)


def test_a_record_comes_back_exactly(record: Record, tmp_path: Path) -> None:
    save(record, tmp_path / "result.nc")
    for path in (tmp_path, tmp_path / "result.nc"):
        again = load(path)
        assert_same(record, again)
        assert_same_variables(record.timing, again.timing)
    assert [path.name for path in tmp_path.iterdir()] == ["result.nc"]


def test_special_numbers_and_no_steps_come_back(record: Record, tmp_path: Path) -> None:
    odd = Variable("odd", ("three",), np.array([np.nan, -0.0, np.inf]), "1", "")
    none = Variable("none", ("step", "axis"), np.zeros((0, 2)), "m", "")
    strange = Record("é", "k", "", "done", "", 2**63 - 1, {}, record.summary, (odd, none))
    save(strange, tmp_path / "x.nc")
    assert_same(strange, load(tmp_path / "x.nc"))
    assert np.signbit(load(tmp_path / "x.nc")["odd"][1])


def test_repeats_are_equal_bit_for_bit_outside_timing(record: Record) -> None:
    again = simulate(load_scene("planar_published", ["run.duration_s=0.2", "gait.period_s=0.2"]))
    assert_same(record, again)
    assert record.timing[0].values != again.timing[0].values


def test_xarray_opens_it(record: Record, tmp_path: Path) -> None:
    save(record, tmp_path / "result.nc")
    with xarray.open_dataset(tmp_path / "result.nc", engine="h5netcdf") as data:
        assert dict(data.sizes) == record.sizes
        assert_array_equal(data["com"].sel(time=0.1).values, record["com"][10])
        for variable in record.variables:
            assert data[variable.name].attrs["units"] == variable.units
            assert data[variable.name].attrs["long_name"]
        assert data.attrs["status"] == "done"
        assert load_scene_of(data.attrs["scene"]) == "planar_published"
    with xarray.open_dataset(tmp_path / "result.nc", engine="h5netcdf", group="timing") as timing:
        assert timing["real_time_factor"] > 0


def load_scene_of(text: str) -> str:
    from scenes.models.loading import parse_scene

    return parse_scene(text, "again").model.name


def test_every_variable_has_a_unit_and_a_meaning(record: Record) -> None:
    assert all(variable.units and variable.long_name for variable in (*record.variables, *record.timing))


@pytest.mark.parametrize("content", [b"", b"hello", None])
def test_a_file_that_is_not_ours(record: Record, tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "result.nc"
    save(record, path)
    path.write_bytes(path.read_bytes()[:20_000] if content is None else content)
    with pytest.raises(SceneError, match=r"result\.nc: not a result of worm3d, or cut short: ") as caught:
        load(path)
    assert len(caught.value.lines) == 1


def test_another_netcdf_file(tmp_path: Path) -> None:
    with h5netcdf.File(tmp_path / "other.nc", "w") as file:
        file.attrs["title"] = "weather"
    with pytest.raises(
        SceneError, match=r"other\.nc: not a result of this version of worm3d \(its attribute 'format' is not"
    ):
        load(tmp_path / "other.nc")


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"result\.nc: no such file; a result is the folder that 'worm3d run' wrote"):
        load(tmp_path)


def test_a_full_disc_leaves_the_old_file(record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "result.nc"
    path.write_text("old")

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(DiscError, match=r"^cannot write .*result\.nc: no space left on device$"):
        save(record, path)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("result.nc", "old")]


def test_corrupted_bytes_are_one_clear_sentence(record: Record, tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "result.nc"
    save(record, path)

    def broken(*_: object) -> None:
        raise AttributeError("'NoneType' object has no attribute 'name'")

    monkeypatch.setattr(store, "_record", broken)
    with pytest.raises(SceneError, match=r"result\.nc: not a result of worm3d, or cut short: 'NoneType'") as caught:
        load(path)
    assert len(caught.value.lines) == 1


def test_a_name_that_was_overwritten_in_the_file(record: Record, tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    save(record, path)
    whole = path.read_bytes()
    for word in (b"summary", b"long_name", b"timing", b"versions", b"_Netcdf4Dimid"):
        assert word in whole
        path.write_bytes(whole.replace(word, b"x" * len(word)))
        with contextlib.suppress(SceneError):
            load(path)


def test_a_file_that_may_not_be_read_is_a_disc_error(record: Record, tmp_path: Path, monkeypatch) -> None:
    save(record, tmp_path / "result.nc")

    def locked(*_: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(h5netcdf, "File", locked)
    with pytest.raises(DiscError, match=r"^cannot read .*result\.nc: permission denied$"):
        load(tmp_path)
