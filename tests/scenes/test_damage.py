"""Damaged results: whichever bits flip, a result is refused in a sentence or says what it said before."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path

import h5netcdf
import h5py
import numpy as np
import pytest
import xarray

from scenes.language.errors import SceneError
from scenes.records import store
from scenes.records.record import Record
from scenes.records.store import load, save
from worm3d.values import netcdf


@pytest.fixture(scope="module")
def whole(record: Record) -> bytes:
    """A result as it stands on disc."""
    return netcdf.packed(netcdf.signed(store.content_of(record)))


def says(path: Path, expected: str) -> str | None:
    """Return the sentence by which a file is refused; if it is not, it has to say what it said."""
    try:
        found = load(path)
    except SceneError as error:
        (line,) = error.lines
        return line if str(path) in line else pytest.fail(line)
    assert store.content_of(found).digest == expected
    return None


def rewritten(old: h5netcdf.Group, new: h5netcdf.Group) -> None:
    """Write all anew, with other chunks, compressed, and a word more."""
    new.dimensions = {name: dimension.size for name, dimension in old.dimensions.items()}
    for name, variable in old.variables.items():
        packed = (
            {"chunks": variable.shape, "compression": "gzip", "fletcher32": True} if np.prod(variable.shape) > 1 else {}
        )
        new.create_variable(name, variable.dimensions, data=variable[...], **packed).attrs.update(variable.attrs)
    new.attrs.update({**old.attrs, "history": "packed"})
    for name, group in old.groups.items():
        rewritten(group, new.create_group(name))


def test_flipped_bits_of_the_digest(whole: bytes, record: Record, tmp_path: Path) -> None:
    path = tmp_path / "result.nc"
    for place in (1, netcdf.SEAL_LENGTH - len(netcdf.SEAL), netcdf.SEAL_LENGTH - 1, netcdf.SEAL_LENGTH):
        damaged = bytearray(whole)
        damaged[-place] ^= 4
        path.write_bytes(damaged)
        said = says(path, store.content_of(record).digest)
        assert (said is None) == (place >= netcdf.SEAL_LENGTH - 1), (
            "in the mark: what follows is not taken for a digest"
        )


def test_files_cut_short(whole: bytes, record: Record, tmp_path: Path) -> None:
    path, expected = tmp_path / "result.nc", store.content_of(record).digest
    for left in (0, len(whole) // 2, len(whole) - netcdf.SEAL_LENGTH - 1):
        path.write_bytes(whole[:left])
        assert "cut short" in (says(path, expected) or ""), left
    for left in (len(whole) - netcdf.SEAL_LENGTH, len(whole) - 1):
        path.write_bytes(whole[:left])
        assert says(path, expected) is None, "only the digest is gone"


def test_every_number_and_word_counts(whole: bytes, record: Record) -> None:
    """What HDF5 finds right is still compared with the digest of what the record says."""
    image = io.BytesIO(whole[: -netcdf.SEAL_LENGTH])
    with h5py.File(image, "r+") as file:
        file["timing/wall_s"][...] = float(file["timing/wall_s"][()]) * (1 + 1e-15)
    with pytest.raises(
        netcdf.FileError, match=r"does not say what worm3d wrote .* damaged, or changed by another program"
    ):
        netcdf.unpacked(image, "result.nc").require_digest("result.nc")
    image = io.BytesIO(whole[: -netcdf.SEAL_LENGTH])
    with h5py.File(image, "r+") as file:
        file["com"].attrs["units"] = "cm"
    with pytest.raises(netcdf.FileError, match="does not say what worm3d wrote"):
        netcdf.unpacked(image, "result.nc").require_digest("result.nc")


def test_another_program_may_write_the_same_anew(whole: bytes, record: Record, tmp_path: Path) -> None:
    (tmp_path / "result.nc").write_bytes(whole)
    with h5netcdf.File(tmp_path / "result.nc") as old, h5netcdf.File(tmp_path / "copy.nc", "w") as new:
        rewritten(old, new)
    assert netcdf.is_whole(tmp_path / "copy.nc") is None
    assert says(tmp_path / "copy.nc", store.content_of(record).digest) is None
    with xarray.open_dataset(tmp_path / "result.nc", engine="h5netcdf") as data:
        data.to_netcdf(tmp_path / "part.nc", engine="h5netcdf")
    assert "does not say what worm3d wrote" in (says(tmp_path / "part.nc", "") or ""), "xarray leaves the groups out"


def test_a_file_on_which_hdf5_never_ends(whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, command = tmp_path / "result.nc", [sys.executable, "-c", "while True: pass"]
    path.write_bytes(whole[: -netcdf.SEAL_LENGTH])
    monkeypatch.setattr(netcdf, "MAX_READ_SECONDS", 0.3)
    run = subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda _, **options: run(command, **options))
    with pytest.raises(SceneError, match=r"result\.nc: not a result of worm3d, or damaged: not read after 0\.3 s"):
        load(path)


@pytest.mark.parametrize("code", ["import os; os.abort()", "raise MemoryError", "raise SystemExit(2)"])
def test_a_file_on_which_hdf5_crashes(code: str, whole: bytes, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "result.nc").write_bytes(whole[: -netcdf.SEAL_LENGTH])
    run = subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda _, **options: run([sys.executable, "-c", code], **options))
    with pytest.raises(SceneError, match="or damaged: the HDF5 library fails on it"):
        load(tmp_path)


def test_no_command_goes_on_from_a_damaged_result(record: Record, worm3d, tmp_path: Path) -> None:
    path = tmp_path / "run" / "result.nc"
    path.parent.mkdir()
    save(record, path)
    damaged = bytearray(path.read_bytes())
    damaged[len(damaged) // 2] ^= 16
    path.write_bytes(damaged)
    for command in (
        ("resume", "run", "--duration", "1", "--out", "more"),
        ("view", "run", "--no-open"),
        ("plot", "run"),
        ("animate", "run"),
        ("export", "run", "--csv", "x.csv"),
    ):
        ended = worm3d(*command)
        assert ended.code == 2
        assert ended.complaints == [
            "run/result.nc: damaged: its bytes are not those that were written (their checksum is wrong); take a "
            "backup copy, or run its scene again"
        ], command
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["result.nc"]
