"""Files of records: NetCDF4 in the format of `worm3d.values.netcdf`, CSV for spreadsheets, and NPZ for NumPy."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from scenes.language.errors import DiscError, SceneError
from scenes.records import measured
from scenes.records.folder import RESULT, write_bytes, written_whole
from scenes.records.record import Record, Summary
from worm3d.values import netcdf
from worm3d.values.netcdf import Content, FileError
from worm3d.values.variable import write_csv


def save(record: Record, path: Path) -> None:
    """Write a record as a NetCDF4 file, completely or not at all.

    Raises
    ------
    DiscError
        If the file cannot be written.
    """
    write_bytes(path, netcdf.packed(netcdf.signed(content_of(record))))


def load(path: Path) -> Record:
    """Read a record from a file, or from the file `result.nc` in a folder.

    A file whose name ends in .csv is read as a measurement.

    Raises
    ------
    SceneError
        If the file does not exist, is not a file of worm3d, is incomplete or damaged, or was changed by another
        program.
    DiscError
        If the file cannot be read.
    """
    if path.suffix.lower() == measured.ENDING and not path.is_dir():
        return measured.load(path)
    file = path / RESULT if path.is_dir() else path
    if not file.is_file():
        raise SceneError(f"{file}: no such file; a result is the folder that 'worm3d run' wrote, or its {RESULT}")
    try:
        content = netcdf.load(file)
        content.require_digest(str(file))
        return _record(content)
    except OSError as error:
        raise DiscError(f"cannot read {file}: {(error.strerror or str(error)).lower()}") from error
    except FileError as error:
        raise SceneError(str(error)) from error
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise SceneError(f"{file}: not a result of worm3d, or cut short: {error}") from error


def export_csv(record: Record, path: Path) -> None:
    """Write a CSV file with a row for each stored instant.

    There is a column for each number at an instant, such as `com_x_m` and `main_node_3_y_m`. Values that do not belong
    to an instant are left out: statistics of steps, single numbers, computing times, and texts.

    Raises
    ------
    DiscError
        If the file cannot be written.
    """
    timed = [v for v in record.variables if v.dims[:1] == ("time",)]
    with written_whole(path) as part:
        write_csv(timed, part)


def export_npz(record: Record, path: Path) -> None:
    """Write an NPZ file with all variables by name, and the scene with all defaults as the text `scene`.

    The file has no pickled objects.

    Raises
    ------
    DiscError
        If the file cannot be written.
    """
    arrays = {variable.name: variable.values for variable in record.variables}
    with written_whole(path) as part, part.open("wb") as file:
        np.savez(file, allow_pickle=False, scene=np.array(record.scene), **arrays)


def content_of(record: Record) -> Content:
    """Return a record as the content of a file."""
    attributes = {name: getattr(record, name) for name in ("name", "model", "scene", "status", "sentence", "seed")}
    attributes |= {"versions": json.dumps(dict(record.versions)), "summary": json.dumps(record.summary.to_dict())}
    groups = {netcdf.ROOT: record.variables, netcdf.TIMING: record.timing}
    if record.checkpoint:
        groups["checkpoint"] = record.checkpoint
    if record.run:
        attributes["run"], groups["run"] = record.run, record.parts
    return Content(attributes, groups)


def _record(content: Content) -> Record:
    attributes, groups = content.attributes, content.groups
    metrics = json.loads(attributes["summary"])
    reasons, errors = metrics.pop("reasons"), metrics.pop("errors", {})
    return Record(
        **{name: attributes[name] for name in ("name", "model", "scene", "status", "sentence")},
        seed=int(attributes["seed"]),
        versions=json.loads(attributes["versions"]),
        summary=Summary(metrics, reasons, errors),
        variables=groups[netcdf.ROOT],
        timing=groups[netcdf.TIMING],
        checkpoint=groups.get("checkpoint", ()),
        run=attributes.get("run", ""),
        parts=groups.get("run", ()),
    )
