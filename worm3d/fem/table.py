"""Table of the equilibria of a segment, a row for each state, stored as NetCDF (classic format)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.io import netcdf_file

from worm3d.fem.axisymmetric import State
from worm3d.fem.bending import BentState
from worm3d.fem.description import Segment
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
        "pressed_length_m": ("m", "distance between the end plates, straight state pressed by flat ground"),
        "pressed_pressure_Pa": ("Pa", "gauge pressure inside, straight state pressed by flat ground"),
        "pressed_indentation_m": ("m", "loss of the distance between ground and axis since the first touch"),
        "pressed_load_N": ("N", "force between segment and ground"),
    }
)
"""Columns of a table: unit and meaning. A table has one of `pressure_Pa` and `cable_N`. Columns with the prefix
`PRESSED` have rows of their own, or are left out."""
PRESSED = "pressed_"
POINTS_OF_A_SEGMENT = 2
"""Number of contact points of a segment of a worm that share a load: the lower apexes left and right."""


def columns(states: Sequence[State]) -> dict[str, FloatArray]:
    """Return the columns of axisymmetric states, each as an array of shape (rows,)."""
    fields = {"length_m": "length", "bend_rad": "", states[0].wall.segment.load.input: "input", "force_N": "force"}
    fields |= {"moment_Nm": "", "radius_m": "radius", "volume_m3": "volume", "stable": "stable"}
    return {name: np.array([getattr(each, of) if of else 0.0 for each in states], float) for name, of in fields.items()}


def pressed(states: Sequence[tuple[float, BentState]]) -> dict[str, FloatArray]:
    """Return the columns of the states of `bending.pressed_states`, each as an array of shape (rows,)."""
    rows = [(state.condition.length_m, state.condition.pressure_Pa, way, state.load_N) for way, state in states]
    names = [name for name in COLUMNS if name.startswith(PRESSED)]
    return dict(zip(names, np.array(rows).T, strict=True)) if rows else {}


def contact_stiffness(table: Mapping[str, FloatArray]) -> float | None:
    """Return the stiffness of a contact point [N/m], the median over pressed states; None without such states.

    A segment rests on `POINTS_OF_A_SEGMENT` points, so that a point has half of the stiffness of the segment.
    """
    load, way = (table.get(f"{PRESSED}{name}", np.zeros(0)) for name in ("load_N", "indentation_m"))
    return float(np.median(load / way)) / POINTS_OF_A_SEGMENT if len(load) else None


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
        if (stiffness := contact_stiffness(table)) is not None:
            file.contact_stiffness_N_m = np.float64(stiffness)
        for dimension, name in (("state", "length_m"), ("pressed", f"{PRESSED}length_m")):
            if name in table:
                file.createDimension(dimension, len(table[name]))
        for name, values in table.items():
            dimension = "pressed" if name.startswith(PRESSED) else "state"
            variable = file.createVariable(name, "i4" if name == "stable" else "f8", (dimension,))
            variable[:] = values
            variable.units, variable.long_name = COLUMNS[name]
