"""The bytes of a NetCDF4 file, written directly with h5py.

A NetCDF4 file is an HDF5 file with an HDF5 dimension scale for each dimension of a variable. The format is described
in the section "NetCDF-4 format" of "File Format Specifications" in the NetCDF documentation of Unidata. The code uses
low-level calls of h5py. For a run with 90 variables they take a ninth of the time that h5netcdf takes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5p, h5s, h5t
from numpy.typing import NDArray

from worm3d.values.variable import Variable

NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable.{:10d}"
"""HDF5 name attribute of the scale of a dimension that has no variable; to be formatted with the dimension's length."""

OTHER_THAN_DIMENSION = "_nc4_non_coord_{}"
"""HDF5 name for a variable that has the name of a dimension but is not the coordinate variable of this dimension."""

TEXT_TYPE = h5py.string_dtype()
"""HDF5 type of strings of any length, in UTF-8."""

SCALAR = h5s.create(h5s.SCALAR)
"""HDF5 dataspace of a single value."""


def image(attributes: Mapping[str, Any], groups: Mapping[str, Sequence[Variable]]) -> bytes:
    """Return the bytes of a NetCDF4 file.

    Parameters
    ----------
    attributes : mapping
        Attributes of the root group by name, each a string or an integer.
    groups : mapping
        Variables of each group by the name of the group, which is "" for the root group. Each group has its own
        dimensions.
    """
    # The file is written in memory, because the HDF5 library crashes if the disc is full. The name "image" is unused.
    with h5py.File("image", "w", driver="core", backing_store=False, track_order=True) as file:
        dimensions = 0
        for name, variables in groups.items():
            group = file if not name else file.create_group(name, track_order=True)
            dimensions += _fill(group.id, variables, dimensions)
        properties = f"version=2,hdf5={h5py.version.hdf5_version},h5py={h5py.__version__}"
        file.attrs["_NCProperties"] = np.bytes_(properties)
        for name, value in attributes.items():
            _set(file.id, name, value)
        file.flush()
        data: bytes = file.id.get_file_image()
        return data


def _fill(group: Any, variables: Sequence[Variable], known: int) -> int:
    """Write variables and their dimensions to a group, and return the number of these dimensions.

    `known` is the number of dimensions in the groups written before.
    """
    sizes = {dim: size for variable in variables for dim, size in variable.sizes.items()}
    written = {}
    for variable in variables:
        name = variable.name if _is_free(variable, sizes) else OTHER_THAN_DIMENSION.format(variable.name)
        written[name] = array = _array(group, name, variable.values)
        _set(array, "units", variable.units)
        _set(array, "long_name", variable.long_name)
    scales = {}
    for number, (dim, size) in enumerate(sizes.items(), known):
        scales[dim] = scale = written[dim] if dim in written else _array(group, dim, np.zeros(size, ">f4"))
        h5ds.set_scale(scale, (dim if dim in written else NO_VARIABLE.format(size)).encode())
        _set(scale, "_Netcdf4Dimid", np.int32(number))
    for variable, (name, array) in zip(variables, written.items(), strict=True):
        if name not in sizes:
            for axis, dim in enumerate(variable.dims):
                h5ds.attach_scale(array, scales[dim], axis)
    return len(sizes)


def _is_free(variable: Variable, sizes: Mapping[str, int]) -> bool:
    """Return whether a variable keeps its own name in the file.

    A variable keeps its name if no dimension has this name, or if it is the coordinate variable of this dimension.
    """
    return variable.name not in sizes or variable.dims == (variable.name,)


def _array(group: Any, name: str, values: NDArray[Any]) -> Any:
    """Write an array and return its HDF5 identifier. Dimensions of length 0 are stored as unlimited dimensions."""
    creation, greatest = h5p.create(h5p.DATASET_CREATE), None
    creation.set_obj_track_times(False)  # so that the same content gives the same bytes
    if 0 in values.shape:
        greatest = tuple(size or h5s.UNLIMITED for size in values.shape)
        creation.set_chunk(tuple(size or 1 for size in values.shape))
    stored = np.ascontiguousarray(values, dtype=TEXT_TYPE if values.dtype.kind == "U" else None)
    kind = h5t.py_create(stored.dtype, logical=True)
    array = h5d.create(group, name.encode(), kind, h5s.create_simple(values.shape, greatest), creation)
    if values.size:
        array.write(h5s.ALL, h5s.ALL, stored)
    return array


def _set(holder: Any, name: str, value: str | np.int32 | int) -> None:
    """Write an attribute."""
    stored = np.array(value, dtype=TEXT_TYPE if isinstance(value, str) else None)
    h5a.create(holder, name.encode(), h5t.py_create(stored.dtype, logical=True), SCALAR).write(stored)
