"""NetCDF4 files as HDF5 writes them: what h5netcdf and xarray read is what was written."""

from __future__ import annotations

import io
from time import sleep

import h5netcdf
import h5py
import numpy as np
import pytest
import xarray
from numpy.testing import assert_array_equal

from worm3d.values.netcdf import Content, unpacked
from worm3d.values.netcdf_image import image
from worm3d.values.variable import Variable

RANDOM = np.random.default_rng(7)
VARIABLES = (
    Variable("time", ("time",), [0.0, 0.5, 1.0], "s", "time"),
    Variable("place", ("time", "joint", "axis"), RANDOM.normal(size=(3, 4, 2)), "m", "größe"),
    Variable("joint", ("time", "joint"), RANDOM.integers(9, size=(3, 4)), "1", "named as a dimension it is not"),
    Variable("unstepped", ("step", "joint"), np.zeros((0, 4)), "N", "without entries"),
    Variable("seed", (), 2**40, "1", "a whole number"),
    Variable("half", ("axis",), np.array([0.1, np.nan], dtype=np.float32), "1", "in single precision"),
    Variable("gait.kind", ("gait.kind",), ["sine", "", "wäve"], "1", "texts"),
)
CONTENT = Content({"name": "ä" * 70000, "seed": 5}, {"": VARIABLES, "timing": (), "more": VARIABLES[1:3]})


@pytest.fixture(scope="module")
def data() -> bytes:
    return image(CONTENT.attributes, CONTENT.groups)


def test_it_reads_back_bit_for_bit(data: bytes) -> None:
    read = unpacked(io.BytesIO(data), "test")
    assert read.attributes == CONTENT.attributes
    assert list(read.groups) == list(CONTENT.groups)
    for name, group in CONTENT.groups.items():
        for given, found in zip(group, read.groups[name], strict=True):
            assert (found.name, found.dims, found.units, found.long_name) == (
                *(given.name, given.dims, given.units, given.long_name),
            )
            assert found.values.dtype == given.values.dtype
            assert_array_equal(found.values, given.values)
    assert read.digest == CONTENT.digest


def test_xarray_reads_its_coordinates(data: bytes) -> None:
    with xarray.open_dataset(io.BytesIO(data), engine="h5netcdf") as opened:
        assert dict(opened.sizes) == {"time": 3, "joint": 4, "axis": 2, "step": 0, "gait.kind": 3}
        assert list(opened.indexes) == ["time", "gait.kind"]
        assert_array_equal(opened.place.sel(time=0.5), VARIABLES[1].values[1])
        assert opened.place.attrs == {"units": "m", "long_name": "größe"}
        assert opened["gait.kind"].sel({"gait.kind": "wäve"}) == "wäve"


def test_it_is_laid_out_as_netcdf_has_it(data: bytes) -> None:
    def layout(file: h5netcdf.File) -> dict[str, object]:
        dimensions = {name: (each.size, each.isunlimited()) for name, each in file.dimensions.items()}
        return {"dimensions": dimensions, **{name: v.dimensions for name, v in file.variables.items()}}

    def ids(file: h5netcdf.File) -> dict[str, int]:
        return {name: int(file._h5file[name].attrs["_Netcdf4Dimid"]) for name in file.dimensions}

    other = io.BytesIO()
    with h5netcdf.File(other, "w") as file:  # the same by a writer that is not ours
        file.dimensions = {dim: size for v in VARIABLES for dim, size in v.sizes.items()}
        for v in VARIABLES[:-1]:
            file.create_variable(v.name, v.dims, data=v.values)
        texts = VARIABLES[-1].values.astype(object)
        file.create_variable("gait.kind", ("gait.kind",), data=texts, dtype=h5py.string_dtype())
    with h5netcdf.File(other, "r") as theirs, h5netcdf.File(io.BytesIO(data), "r") as ours:
        assert layout(ours) == layout(theirs)
        assert ids(ours) == ids(theirs)


def test_the_same_content_gives_the_same_bytes(data: bytes) -> None:
    sleep(1.1)  # HDF5's times are in seconds
    assert image(CONTENT.attributes, CONTENT.groups) == data
