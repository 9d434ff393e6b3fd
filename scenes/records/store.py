"""Results on disc: one NetCDF4 file per run, for planar and 3D worms alike.

Variables stand in the root group with named dimensions, `units` and `long_name`; wall-clock figures in the
group `timing`, and that from which the run can go on in the group `checkpoint`. Nothing is compressed: it would
take six times as long to write; nor chunked, so that HDF5's own checksums (fletcher32) do not apply.

Damage is noticed (`scenes.records.digest`): a digest of the bytes follows the HDF5 data, and the attribute `digest` is
one of what the record says. A file whose bytes have no digest was not written by this program as it is: it is read in a
process of its own that may not take for ever (`scenes.records.foreign`), and accepted if it still says what its
attribute `digest` is of. Files of earlier versions have neither; they are accepted with a warning.
"""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import h5netcdf
import numpy as np

from scenes.language.errors import DiscError, SceneError
from scenes.records import digest, foreign
from scenes.records.files import write_bytes
from scenes.records.record import Record, Variable
from scenes.records.summary import Summary

FORMAT = "worm3d result 2"
"""Value of the attribute `format` by which we know our files."""

WITHOUT_DIGEST = "worm3d result 1"
"""Its value in files of earlier versions."""

FILE_NAME = "result.nc"


def save(record: Record, path: Path) -> None:
    """Write a record as NetCDF4, whole or not at all.

    Raises
    ------
    DiscError
        The file cannot be written.
    """
    write_bytes(path, as_bytes(record))


def as_bytes(record: Record, *, verified: bool = True) -> bytes:
    """Return a record as NetCDF4; one that is not verified remains one of an earlier version, without a digest."""
    # The HDF5 library crashes when the disc is full, so it writes to memory.
    image = io.BytesIO()
    with h5netcdf.File(image, "w") as file:
        file.dimensions = record.sizes
        _put(file, record.variables)
        _put_group(file, "timing", record.timing)
        if record.checkpoint:
            _put_group(file, "checkpoint", record.checkpoint)
        file.attrs.update(_attributes(record) if verified else {**_attributes(record), "format": WITHOUT_DIGEST})
    return digest.sealed(image.getbuffer())


def _to_standard_error(warning: str) -> None:
    sys.stderr.write(f"warning: {warning}\n")


def load(path: Path, warn: Callable[[str], None] = _to_standard_error) -> Record:
    """Read a record; a folder means the `result.nc` in it.

    Parameters
    ----------
    path : Path
    warn : callable
        Called with a sentence if damage to the file could not be noticed, because an earlier version wrote it.

    Raises
    ------
    SceneError
        No such file, not one of ours, cut short, damaged, or changed by another program.
    DiscError
        The file may not be read.
    """
    file_path = path / FILE_NAME if path.is_dir() else path
    if not file_path.is_file():
        raise SceneError(
            f"{file_path}: no such file; a result is the folder that 'worm3d run' wrote, or its {FILE_NAME}"
        )
    try:
        whole = digest.is_whole(file_path)
        if whole:
            return read(file_path, str(file_path))[0]
        if whole is None:
            return _load_foreign(file_path, warn)
    except OSError as error:
        raise DiscError(f"cannot read {file_path}: {(error.strerror or str(error)).lower()}") from error
    raise SceneError(
        f"{file_path}: damaged: its bytes are not those that were written (their checksum is wrong); "
        "take a copy of it, or run the scene again"
    )


def _load_foreign(path: Path, warn: Callable[[str], None]) -> Record:
    """Read a file that this program did not write as it is."""
    record, verified = read(io.BytesIO(foreign.checked(path)), str(path))
    if not verified:
        warn(f"{path} was written by an earlier version of worm3d, without a checksum: damage to it goes unnoticed")
    return record


def read(file: Path | BinaryIO, name: str) -> tuple[Record, bool]:
    """Read a record without looking at the digest of the bytes; return whether it is what its own digest is of.

    Raises
    ------
    SceneError
        Not a result, cut short, damaged, or changed by another program.
    """
    try:
        with h5netcdf.File(file, "r") as content:
            form, expected = content.attrs.get("format"), content.attrs.get("digest")
            if form not in (FORMAT, WITHOUT_DIGEST):
                raise SceneError(f"{name}: not a result of worm3d (its attribute 'format' is not '{FORMAT}')")
            record = _record(content)
    except (SceneError, PermissionError):
        raise
    except Exception as error:  # a few wrong bytes come out of the HDF5 libraries as almost anything
        raise SceneError(f"{name}: not a result of worm3d, or cut short: {_first_line(error)}") from error
    if form == FORMAT and expected != digest.of_record(record):
        raise SceneError(
            f"{name}: does not say what worm3d wrote (its attribute 'digest' is of something else): damaged, or "
            "changed by another program; take the original, or run the scene again"
        )
    return record, form == FORMAT


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
        "model": record.model,
        "scene": record.scene,
        "status": record.status,
        "sentence": record.sentence,
        "seed": np.int64(record.seed),
        "versions": json.dumps(dict(record.versions)),
        "summary": json.dumps(record.summary.to_dict()),
        "digest": digest.of_record(record),
    }


def _record(file: Any) -> Record:
    attrs = file.attrs
    figures = json.loads(attrs["summary"])
    reasons = figures.pop("reasons")
    return Record(
        name=attrs["name"],
        model=attrs["model"],
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
