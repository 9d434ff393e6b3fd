"""Arrays with names, dimensions and units, for files and for other programs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

AXES = "xyz"
"""Names of the entries along the dimension "axis"."""


@dataclass(frozen=True, init=False, eq=False)
class Variable:
    """A named, read-only array."""

    name: str
    dims: tuple[str, ...]
    """Names of the dimensions, () for a single number."""
    values: NDArray[Any]
    """Array of numbers or texts, read-only."""
    units: str
    """Unit, or "1" for dimensionless numbers."""
    long_name: str
    """Meaning, in a few words."""

    def __init__(self, name: str, dims: tuple[str, ...], values: ArrayLike, units: str, long_name: str) -> None:
        array = np.array(values)
        if array.dtype.kind not in "iufU":
            raise ValueError(f"{name}: got values of type {array.dtype}, must be integers, floats or texts")
        if array.ndim != len(dims):
            raise ValueError(f"{name}: got shape {array.shape}, must have one axis for each of {dims}")
        array.setflags(write=False)
        vars(self).update(name=name, dims=dims, values=array, units=units, long_name=long_name)

    @property
    def sizes(self) -> dict[str, int]:
        """Length of each dimension."""
        return dict(zip(self.dims, self.values.shape, strict=True))


def column_names(variable: Variable) -> Iterator[str]:
    """Yield the names of the columns of a variable whose first dimension is time, for example "com_x_m"."""
    unit = "" if variable.units == "1" else "_" + variable.units.replace("/", "_per_").replace("^", "")
    for index in np.ndindex(variable.values.shape[1:]):
        labels = (AXES[i] if dim == "axis" else str(i) for i, dim in zip(index, variable.dims[1:], strict=True))
        yield "_".join((variable.name, *labels)) + unit


def write_csv(variables: Iterable[Variable], path: str | PathLike[str]) -> None:
    """Write variables whose first dimension is time, with a row for each instant and a column for each number.

    The numbers have enough digits to be read back exactly.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    shown = list(variables)
    header = ",".join(name for variable in shown for name in column_names(variable))
    rows = np.hstack([variable.values.reshape(len(variable.values), -1) for variable in shown])
    np.savetxt(path, rows, fmt="%.17g", delimiter=",", header=header, comments="", encoding="utf-8")
