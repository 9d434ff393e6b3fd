"""Results on disc: one NetCDF4 file per run, for planar and 3D worms alike.

Variables stand in the root group with named dimensions, `units` and `long_name`; wall-clock figures in the
group `timing`, and that from which the run can go on in the group `checkpoint`. Nothing is compressed: it would
take six times as long to write.
"""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np

from scenes.errors import DiscError, SceneError
from scenes.files import write_bytes
from scenes.record import Record, Variable
from scenes.summary import Summary

FORMAT = "worm3d result 1"
"""Value of the attribute `format` by which we know our files."""

FILE_NAME = "result.nc"


def save(record: Record, path: Path) -> None:
    """Write a record as NetCDF4, whole or not at all.

    Raises
    ------
    DiscError
        The file cannot be written.
    """
    # The HDF5 library crashes when the disc is full, so it writes to memory.
    image = io.BytesIO()
    with h5netcdf.File(image, "w") as file:
        file.dimensions = record.sizes
        _put(file, record.variables)
        _put_group(file, "timing", record.timing)
        if record.checkpoint:
            _put_group(file, "checkpoint", record.checkpoint)
        file.attrs.update(_attributes(record))
    write_bytes(path, image.getvalue())


def load(path: Path) -> Record:
    """Read a record; a folder means the `result.nc` in it.

    Raises
    ------
    SceneError
        No such file, not one of ours, cut short or corrupted.
    DiscError
        The file may not be read.
    """
    file_path = path / FILE_NAME if path.is_dir() else path
    if not file_path.is_file():
        raise SceneError(
            f"{file_path}: no such file; a result is the folder that 'worm3d run' wrote, or its {FILE_NAME}"
        )
    try:
        with h5netcdf.File(file_path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise SceneError(f"{file_path}: not a result of worm3d (its attribute 'format' is not '{FORMAT}')")
            return _record(file)
    except PermissionError as error:
        raise DiscError(f"cannot read {file_path}: {(error.strerror or str(error)).lower()}") from error
    except SceneError:
        raise
    except Exception as error:  # a few wrong bytes come out of the HDF5 libraries as almost anything
        raise SceneError(f"{file_path}: not a result of worm3d, or cut short: {_first_line(error)}") from error


def _put_group(file: Any, name: str, variables: tuple[Variable, ...]) -> None:
    group = file.create_group(name)
    group.dimensions = {dim: size for v in variables for dim, size in v.sizes.items()}
    _put(group, variables)


def _put(group: Any, variables: tuple[Variable, ...]) -> None:
    for v in variables:
        stored = group.create_variable(v.name, v.dims, data=v.values)
        stored.attrs["units"] = v.units
        stored.attrs["long_name"] = v.long_name


def _attributes(record: Record) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "name": record.name,
        "model": record.kind,
        "scene": record.scene,
        "status": record.status,
        "sentence": record.sentence,
        "seed": np.int64(record.seed),
        "versions": json.dumps(dict(record.versions)),
        "summary": json.dumps(record.summary.to_dict()),
    }


def _record(file: Any) -> Record:
    attrs = file.attrs
    figures = json.loads(attrs["summary"])
    reasons = figures.pop("reasons")
    return Record(
        name=attrs["name"],
        kind=attrs["model"],
        scene=attrs["scene"],
        status=attrs["status"],
        sentence=attrs["sentence"],
        seed=int(attrs["seed"]),
        versions=json.loads(attrs["versions"]),
        summary=Summary(figures, reasons),
        variables=_variables(file),
        timing=_variables(file.groups["timing"]),
        checkpoint=_variables(file.groups["checkpoint"]) if "checkpoint" in file.groups else (),
    )


def _variables(group: Any) -> tuple[Variable, ...]:
    return tuple(
        Variable(name, tuple(v.dimensions), v[...], v.attrs["units"], v.attrs["long_name"])
        for name, v in group.variables.items()
    )


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
