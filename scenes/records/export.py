"""Results for other programs: CSV for spreadsheets, NPZ for NumPy."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scenes.records.folder import written_whole
from scenes.records.record import Record
from worm3d.values.variable import Variable

AXES = "xyz"


def export_csv(record: Record, path: Path) -> None:
    """Write one row per stored instant, one column per number that is known at that instant.

    Columns are named after the variable, the index along each further dimension (x, y, z along "axis") and
    the unit: `com_x_m`, `main_node_3_y_m`. Every float is written so that it reads back exactly. Left out is
    what has no instant: variables whose first dimension is not "time" (the statistics of each solver step,
    single numbers), wall-clock figures, and all text (scene, versions, summary).

    Raises
    ------
    DiscError
        The file cannot be written.
    """
    timed = [v for v in record.variables if v.dims[:1] == ("time",)]
    header = ",".join(name for variable in timed for name in column_names(variable))
    rows = np.hstack([v.values.reshape(record.sizes["time"], -1) for v in timed])
    with written_whole(path) as part:
        np.savetxt(part, rows, fmt="%.17g", delimiter=",", header=header, comments="", encoding="utf-8")


def export_npz(record: Record, path: Path) -> None:
    """Write every variable by its name, and the resolved scene as the text `scene`; no pickles inside.

    Raises
    ------
    DiscError
        The file cannot be written.
    """
    arrays = {variable.name: variable.values for variable in record.variables}
    with written_whole(path) as part, part.open("wb") as file:
        np.savez(file, allow_pickle=False, scene=np.array(record.scene), **arrays)


def column_names(variable: Variable) -> Iterator[str]:
    """Yield the name of each column of a variable whose first dimension is time."""
    unit = "" if variable.units == "1" else "_" + variable.units.replace("/", "_per_").replace("^", "")
    for index in np.ndindex(variable.values.shape[1:]):
        labels = (AXES[i] if dim == "axis" else str(i) for i, dim in zip(index, variable.dims[1:], strict=True))
        yield "_".join((variable.name, *labels)) + unit
