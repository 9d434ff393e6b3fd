"""Table of the equilibria of a segment, a row for each state, stored as NetCDF (classic format)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.io import netcdf_file

from worm3d.fem.axisymmetric import State
from worm3d.fem.description import Segment
from worm3d.fem.sweep import Row
from worm3d.values.arrays import FloatArray

KIND, VERSION = "worm3d segment table", 1
"""Attributes `kind` and `version`, which identify the files."""
COLUMNS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "length_m": ("m", "distance between the end plates"),
        "bend_rad": ("rad", "angle between the end plates, positive where the left side is shorter"),
        "pressure_Pa": ("Pa", "gauge pressure inside"),
        "cable_N": ("N", "tension of the cable along the axis"),
        "force_N": ("N", "axial force that holds the length, positive in tension, with the thrust on the plates"),
        "moment_Nm": ("N m", "moment that holds the bend"),
        "radius_m": ("m", "greatest outer radius"),
        "volume_m3": ("m3", "enclosed volume"),
        "stable": ("1", "1 if the state is stable at held length and bend, 0 if it is crumpled"),
    }
)
"""Columns of a table: unit and meaning. A table has one of `pressure_Pa` and `cable_N`."""


def columns(rows: Sequence[Row]) -> dict[str, FloatArray]:
    """Return the columns of axisymmetric states, each as an array of shape (rows,)."""
    states = [row.state for row in rows]
    zero = np.zeros(len(rows))
    return {
        "length_m": _each(states, "length"),
        "bend_rad": zero,
        states[0].wall.segment.load.input: _each(states, "input"),
        "force_N": _each(states, "force"),
        "moment_Nm": zero,
        "radius_m": _each(states, "radius"),
        "volume_m3": _each(states, "volume"),
        "stable": np.array([float(row.stable) for row in rows]),
    }


def _each(states: Sequence[State], name: str) -> FloatArray:
    return np.array([getattr(state, name) for state in states], dtype=float)


def write(path: Path, segment: Segment, table: Mapping[str, FloatArray], source: str, mesh_error: float) -> None:
    """Write a table.

    Parameters
    ----------
    path : Path
    segment : Segment
    table : mapping
        Arrays of shape (rows,) by the names of `COLUMNS`.
    source : str
        A sentence that says how the states were computed.
    mesh_error : float
        Rms error of the force, relative to its rms, as found on a second mesh.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    with netcdf_file(path, "w") as file:
        file.kind, file.version, file.source = KIND, VERSION, source
        file.input = segment.load.input.partition("_")[0]
        file.segment = segment.text
        numbers = (segment.rest_length, segment.plate_radius, mesh_error)  # a Python float would be stored in 32 bits
        file.rest_length_m, file.plate_radius_m, file.mesh_error = map(np.float64, numbers)
        file.createDimension("state", len(table["length_m"]))
        for name, values in table.items():
            variable = file.createVariable(name, "i4" if name == "stable" else "f8", ("state",))
            variable[:] = values
            variable.units, variable.long_name = COLUMNS[name]
