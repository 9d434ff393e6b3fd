"""Results on disc: one NetCDF4 file per run, for planar and 3D worms alike.

Variables stand in the root group with named dimensions, `units` and `long_name`; wall-clock figures in the
group `timing`, and that from which the run can go on in the group `checkpoint`. Nothing is compressed: it would
take six times as long to write; nor chunked, so that HDF5's own checksums (fletcher32) do not apply.

Damage is noticed by two digests. One of the file's bytes follows the HDF5 data, where every program that reads HDF5
ignores it; it is checked before anything else reads the file, since a few wrong bytes can make the HDF5 library loop
for ever, ask for all memory or crash. The other, the attribute `digest`, is one of what the record says: it tells what
another program changed when it wrote the file anew, and holds where that changed nothing.

A file whose bytes have no digest was not written by this program as it is. A process with little time and memory reads
it first and hands it on as worm3d writes it: `python -m scenes.records.store RESULT NAME`. Files of earlier versions
have neither digest; they are accepted with a warning.
"""

from __future__ import annotations

import hashlib
import io
import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import h5netcdf
import numpy as np

from scenes.language.errors import DiscError, SceneError
from scenes.records.folder import RESULT, write_bytes
from scenes.records.record import Record, Summary
from worm3d.values.memory import MOST_MEMORY
from worm3d.values.variable import Variable

FORMAT = "worm3d result 2"
"""Value of the attribute `format` by which we know our files."""
WITHOUT_DIGEST = "worm3d result 1"
"""Its value in files of earlier versions."""

SEAL, SEAL_END = b"\nworm3d sha256 ", b"\n"
"""Bytes before and after the digest at the end of a file."""
SEAL_LENGTH = len(SEAL) + 64 + len(SEAL_END)

PATIENCE = 60
"""Longest time to read a file that another program wrote [s]."""
MEMORY = 3 * int(MOST_MEMORY)
"""Memory of the process that reads it: a run's arrays, another copy of them, and programs [byte]."""


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
    content = image.getbuffer()
    return b"".join((content, SEAL, hashlib.sha256(content).hexdigest().encode(), SEAL_END))


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
    file_path = path / RESULT if path.is_dir() else path
    if not file_path.is_file():
        raise SceneError(f"{file_path}: no such file; a result is the folder that 'worm3d run' wrote, or its {RESULT}")
    try:
        whole = is_whole(file_path)
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
    record, verified = read(io.BytesIO(handed_on(path)), str(path))
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
    if form == FORMAT and expected != digest_of(record):
        raise SceneError(
            f"{name}: does not say what worm3d wrote (its attribute 'digest' is of something else): damaged, or "
            "changed by another program; take the original, or run the scene again"
        )
    return record, form == FORMAT


def handed_on(path: Path) -> bytes:
    """Return a file that another program wrote, as worm3d writes it.

    Raises
    ------
    SceneError
        It is not one, it is damaged, or it cannot be read in time.
    """
    command = [sys.executable, "-P", "-m", "scenes.records.store", str(path.resolve()), str(path)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False, stdin=subprocess.DEVNULL)
    except subprocess.TimeoutExpired as error:
        raise SceneError(f"{path}: not a result of worm3d, or damaged: not read after {PATIENCE} s") from error
    if done.returncode == 0:
        return done.stdout
    said = done.stderr.decode("utf-8", "replace").strip().splitlines()
    if done.returncode == SceneError.exit_code and said:
        raise SceneError(*said)
    raise SceneError(f"{path}: not a result of worm3d, or damaged: the HDF5 library fails on it")


def main() -> None:
    """Read the file that the first argument names and the second one calls, and write it to standard output."""
    _restrict()
    try:
        record, verified = read(Path(sys.argv[1]), sys.argv[2])
    except SceneError as error:
        sys.stderr.write("\n".join(error.lines))
        sys.exit(error.exit_code)
    sys.stdout.buffer.write(as_bytes(record, verified=verified))


def _restrict() -> None:
    """Limit the memory and time of this process, where the system can."""
    with suppress(ImportError, ValueError, OSError):
        import resource

        for limit, value in ((resource.RLIMIT_AS, MEMORY), (resource.RLIMIT_CPU, PATIENCE), (resource.RLIMIT_CORE, 0)):
            resource.setrlimit(limit, (value, value))


def is_whole(path: Path) -> bool | None:
    """Return whether a file is as it was written; None if it has no digest at its end.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    with path.open("rb") as file:
        left = max(path.stat().st_size - SEAL_LENGTH, 0)
        digest = hashlib.sha256()
        while left and (block := file.read(min(left, 1 << 20))):
            digest.update(block)
            left -= len(block)
        end = file.read()
    if not end.startswith(SEAL):
        return None
    return end == SEAL + digest.hexdigest().encode() + SEAL_END


def digest_of(record: Record) -> str:
    """Return the digest of all that a record says, however it is stored."""
    said = {
        "name": record.name,
        "kind": record.model,
        "scene": record.scene,
        "status": record.status,
        "sentence": record.sentence,
        "seed": record.seed,
        "versions": dict(record.versions),
        "summary": record.summary.to_dict(),
    }
    digest = hashlib.sha256(_text(said))
    for group in (record.variables, record.timing, record.checkpoint):
        digest.update(_text({"variables": len(group)}))
        for variable in sorted(group, key=lambda variable: variable.name):
            _add(digest, variable)
    return digest.hexdigest()


def _add(digest: hashlib._Hash, variable: Variable) -> None:
    values = variable.values.astype(variable.values.dtype.newbyteorder("<"), copy=False)
    digest.update(
        _text(
            {
                "name": variable.name,
                "dims": variable.dims,
                "shape": values.shape,
                "type": values.dtype.str,
                "units": variable.units,
                "long_name": variable.long_name,
            }
        )
    )
    digest.update(np.ascontiguousarray(values).tobytes())


def _text(said: Mapping[str, object]) -> bytes:
    return json.dumps(said, sort_keys=True).encode()


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
        "digest": digest_of(record),
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


if __name__ == "__main__":
    main()
