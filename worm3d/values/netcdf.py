"""Files of named arrays. Every run of a planar or 3D worm is stored in a NetCDF4 file of this form.

The root group has the variables with named dimensions, `units` and `long_name`. Further groups have wall-clock times
and the checkpoint for resuming a run. Variables are not compressed, because writing would take six times
as long. They are not divided into chunks, so that the checksums of HDF5 (fletcher32) cannot be used.

Two digests detect damage. The first digest covers the bytes of the file. It is stored after the HDF5 data, where
programs that read HDF5 ignore it. It is checked before the HDF5 library reads the file, because a few wrong bytes can
make this library loop forever, request all memory or crash. The second digest is the attribute `digest`, and covers the
content of the file. If another program rewrites the file, this digest still matches unless the content has changed.

A file without a digest of its bytes was not written directly by worm3d. Such a file is first read by a separate process
with limited time and memory (`python -m worm3d.values.netcdf FILE NAME`), which returns the content in the form that
worm3d writes.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import secrets
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import h5netcdf
import numpy as np
from numpy.typing import NDArray

from worm3d.values.arguments import MOST_MEMORY
from worm3d.values.netcdf_image import image
from worm3d.values.variable import Variable

RESULT_FORMAT = "worm3d result 2"
"""Value of the attribute `format`, which identifies the files of worm3d."""

SAID = ("name", "model", "scene", "status", "sentence", "seed", "versions", "summary", "run")
"""Attributes that the attribute `digest` covers, if a file has them."""
IN_JSON = ("versions", "summary", "run")
"""Attributes of `SAID` whose values are JSON text."""
ROOT, TIMING = "", "timing"
"""Groups that every file has."""
GROUPS = (ROOT, TIMING, "checkpoint")
"""The first groups that the digest covers, in this order. They are covered even if they are empty."""

SEAL = b"\nworm3d sha256 "
"""Bytes that precede the digest at the end of a file."""
SEAL_LENGTH = len(SEAL) + 65

MAX_READ_SECONDS = 60
"""Longest time for reading a file that another program wrote [s]."""
MAX_READ_MEMORY = 3 * int(MOST_MEMORY)
"""Largest memory of the process that reads such a file [byte]. The arrays, a copy, and the program fit into it."""
REFUSED = 2
"""Exit code of the reading process if it refuses the file and has written the reason."""


class FileError(ValueError):
    """A file is not a result, is damaged, or does not have the content that worm3d wrote."""


@dataclass(frozen=True, eq=False)
class Content:
    """Content of a file."""

    attributes: Mapping[str, Any]
    """Texts and whole numbers by name."""
    groups: Mapping[str, tuple[Variable, ...]]
    """Variables of each group; `ROOT` is the root group."""

    @property
    def digest(self) -> str:
        """Digest of the content, independent of the storage layout."""
        said = {name: self.attributes[name] for name in SAID if name in self.attributes}
        said = {name: json.loads(value) if name in IN_JSON else value for name, value in said.items()}
        said = {"kind" if name == "model" else name: value for name, value in said.items()}  # the name in older files
        said["seed"] = int(said["seed"])
        digest = hashlib.sha256(_text(said))
        for name in (*GROUPS, *sorted(self.groups.keys() - set(GROUPS))):
            group = self.groups.get(name, ())
            digest.update(_text({"variables": len(group)}))
            for variable in sorted(group, key=lambda variable: variable.name):
                _add(digest, variable)
        return digest.hexdigest()

    def require_digest(self, name: str) -> None:
        """Raise FileError if the attribute `format` or `digest` does not match the content of the file `name`."""
        if self.attributes.get("format") != RESULT_FORMAT:
            raise FileError(
                f"{name}: not a result of this version of worm3d (its attribute 'format' is not '{RESULT_FORMAT}'); "
                "run its scene again if an early version wrote it"
            )
        try:
            holds = self.digest == self.attributes.get("digest")
        except (KeyError, ValueError, TypeError):
            holds = False
        if not holds:
            raise FileError(
                f"{name}: does not say what worm3d wrote (its attribute 'digest' does not match): damaged, or changed "
                "by another program; take the original file, or run its scene again"
            )


def _text(said: Mapping[str, object]) -> bytes:
    return json.dumps(said, sort_keys=True).encode()


def _add(digest: hashlib._Hash, variable: Variable) -> None:
    values = variable.values.astype(variable.values.dtype.newbyteorder("<"), copy=False)
    said = {name: getattr(variable, name) for name in ("name", "dims", "units", "long_name")}
    digest.update(_text({**said, "shape": values.shape, "type": values.dtype.str}))
    digest.update(np.ascontiguousarray(values).tobytes())


def signed(content: Content) -> Content:
    """Return content with the attributes `format` and `digest`."""
    return Content({"format": RESULT_FORMAT, **content.attributes, "digest": content.digest}, content.groups)


def packed(content: Content) -> bytes:
    """Return content as the bytes of a file."""
    data = image(content.attributes, content.groups)
    return data + _seal(hashlib.sha256(data))


def _seal(digest: hashlib._Hash) -> bytes:
    return SEAL + digest.hexdigest().encode() + b"\n"


def unpacked(file: Path | BinaryIO, name: str) -> Content:
    """Return the content of a file, without checking the digests.

    Raises
    ------
    FileError
        The file is not a NetCDF file, or is cut short.
    PermissionError
        The file may not be read.
    """
    try:
        with h5netcdf.File(file, "r") as opened:
            groups = {ROOT: opened, **opened.groups}
            return Content(dict(opened.attrs), {each: _variables(group) for each, group in groups.items()})
    except PermissionError:
        raise
    except Exception as error:  # a few wrong bytes make the HDF5 libraries raise almost any exception
        line = (str(error).splitlines() or [type(error).__name__])[0]
        raise FileError(f"{name}: not a result of worm3d, or cut short: {line}") from error


def _variables(group: Any) -> tuple[Variable, ...]:
    return tuple(
        Variable(name, tuple(v.dimensions), _decoded(v[...]), v.attrs["units"], v.attrs["long_name"])
        for name, v in group.variables.items()
    )


def _decoded(values: NDArray[Any]) -> NDArray[Any]:
    """Return values in their original type. Texts have to be decoded because HDF5 stores them as bytes."""
    return np.char.decode(values.astype(bytes), "utf-8") if values.dtype.kind == "O" else values


def load(path: Path) -> Content:
    """Return the content of a file, in a way that is safe for damaged files.

    The caller has to call `Content.require_digest`.

    Raises
    ------
    FileError
        The file is not a NetCDF file, is cut short, or is damaged.
    OSError
        The file cannot be read.
    """
    whole = is_whole(path)
    if whole is None:
        return unpacked(io.BytesIO(handed_on(path)), str(path))
    if not whole:
        raise FileError(
            f"{path}: damaged: its bytes are not those that were written (their checksum is wrong); take a "
            "backup copy, or run its scene again"
        )
    return unpacked(path, str(path))


def is_whole(path: Path) -> bool | None:
    """Return whether a file is unchanged since it was written, or None if the file has no digest at its end.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    digest = hashlib.sha256()
    with path.open("rb") as file:
        left = max(path.stat().st_size - SEAL_LENGTH, 0)
        while left and (block := file.read(min(left, 1 << 20))):
            digest.update(block)
            left -= len(block)
        end = file.read()
    return end == _seal(digest) if end.startswith(SEAL) else None


def handed_on(path: Path) -> bytes:
    """Return the bytes of a file that another program wrote, in the form that worm3d writes.

    Raises
    ------
    FileError
        The file is not a NetCDF file, is damaged, or cannot be read in time.
    """
    command = [sys.executable, "-P", "-m", "worm3d.values.netcdf", str(path.resolve()), str(path)]
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=MAX_READ_SECONDS, check=False, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired as error:
        raise FileError(f"{path}: not a result of worm3d, or damaged: not read after {MAX_READ_SECONDS} s") from error
    if done.returncode == 0:
        return done.stdout
    said = done.stderr.decode("utf-8", "replace").strip()
    if done.returncode == REFUSED and said:
        raise FileError(said)
    raise FileError(f"{path}: not a result of worm3d, or damaged: the HDF5 library fails on it")


def write_whole(path: Path, data: bytes) -> None:
    """Write a file. An earlier file at this path is replaced only after all data are written.

    Raises
    ------
    OSError
        The folder does not exist, or writing fails.
    """
    if not path.parent.is_dir():  # before an error would show the name of the temporary file
        raise FileNotFoundError(errno.ENOENT, "no such folder", str(path.parent))
    part = path.with_name(f".{path.name}-{os.getpid()}-{secrets.token_hex(4)}.part")
    try:
        part.write_bytes(data)
        os.replace(part, path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def main() -> None:
    """Read a file and write it to standard output in the form of worm3d.

    The first argument of the command is the path of the file, and the second is its name in messages.
    """
    with suppress(ImportError, ValueError, OSError):
        import resource

        memory, seconds = resource.RLIMIT_AS, resource.RLIMIT_CPU
        for limit, value in ((memory, MAX_READ_MEMORY), (seconds, MAX_READ_SECONDS), (resource.RLIMIT_CORE, 0)):
            resource.setrlimit(limit, (value, value))
    try:
        content = unpacked(Path(sys.argv[1]), sys.argv[2])
    except FileError as error:
        sys.stderr.write(str(error))
        sys.exit(REFUSED)
    sys.stdout.buffer.write(packed(content))


if __name__ == "__main__":
    main()
