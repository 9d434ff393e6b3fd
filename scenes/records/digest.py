"""Digests of results: one of the bytes of a file, at its end, and one of what a record says.

The first is looked at before anything else reads the file: a few wrong bytes can make the HDF5 library loop for ever.
It follows the HDF5 data, where every program that reads HDF5 ignores it. The second is an attribute of the file. It
tells what another program changed when it wrote the file anew, and holds where it changed nothing.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from scenes.records.record import Record, Variable

MARK = b"\nworm3d sha256 "
END = b"\n"
LENGTH = len(MARK) + 64 + len(END)


def sealed(content: bytes | memoryview) -> bytes:
    """Return the content of a file with its digest at the end."""
    return b"".join((content, MARK, hashlib.sha256(content).hexdigest().encode(), END))


def is_whole(path: Path) -> bool | None:
    """Return whether a file is as it was written; None if it has no digest at its end.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    with path.open("rb") as file:
        left = max(path.stat().st_size - LENGTH, 0)
        digest = hashlib.sha256()
        while left and (block := file.read(min(left, 1 << 20))):
            digest.update(block)
            left -= len(block)
        end = file.read()
    if not end.startswith(MARK):
        return None
    return end == MARK + digest.hexdigest().encode() + END


def of_record(record: Record) -> str:
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
