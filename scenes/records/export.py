"""Results for other programs: CSV for spreadsheets, NPZ for NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.records.folder import written_whole
from scenes.records.record import Record
from worm3d.values.variable import write_csv


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
    with written_whole(path) as part:
        write_csv(timed, part)


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
