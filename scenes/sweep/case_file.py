"""The file of a case: the results, and the data needed to run the case again.

The file is `<key>.json` in the folder `cases`, small and readable. If whole records are stored, the file is `<key>.nc`,
identical to the `result.nc` of `worm3d run`. A case without a record, because the plant refused the scene, always has
the JSON file.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from scenes.language.errors import SceneError
from scenes.records import store
from scenes.records.folder import write_bytes
from scenes.records.record import Metric, Record
from scenes.records.text import finite
from scenes.running.terminal import timing
from worm3d.values import netcdf

CASES = "cases"
"""Folder of the files of the cases, in the folder of a sweep."""
CASE_FORMAT = "worm3d case 1"
FAILED_STATUS = "failed"
"""Status of a case without a record: refused by the plant, or ended by an error or the death of the worker."""
NOT_RUN = "not run"
"""Status of a case without a file: the sweep was interrupted before the case."""


@dataclass(frozen=True)
class CaseResult:
    """Result of a case."""

    key: str
    """Key of the job, which is the stem of the file."""
    name: str
    """Name of the scene."""
    model: str
    status: str
    """`done`, `diverged`, `failed`; `not run` if there is no file."""
    sentence: str
    """Sentence about the end of the case."""
    seed: int
    summary: Mapping[str, Metric] = field(default_factory=dict)
    """Entries of `summary.json` by name; empty if the case failed."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Reasons for missing values."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Errors of the entries by name, if known."""
    timing: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock values, which differ when the case is run again."""
    versions: Mapping[str, str] = field(default_factory=dict)
    scene: Mapping[str, Any] = field(default_factory=dict)
    """The resolved scene as data: section -> key -> value."""


def result_of(key: str, record: Record, scene: Mapping[str, Any]) -> CaseResult:
    """Return the result of a case, given the record of the run and the resolved scene as data."""
    return CaseResult(
        key=key,
        name=record.name,
        model=record.model,
        status=record.status,
        sentence=record.sentence,
        seed=record.seed,
        summary=record.summary.metrics,
        reasons=record.summary.reasons,
        errors=record.summary.errors,
        timing=timing(record),
        versions=record.versions,
        scene=scene,
    )


def write(result: CaseResult, path: Path) -> None:
    """Write the JSON file of a case, completely or not at all.

    Raises
    ------
    DiscError
        The file cannot be written.
    """
    content = finite({"format": CASE_FORMAT, **vars(result)})
    text = json.dumps({**content, "digest": _digest(content)}, indent=1, ensure_ascii=False)
    write_bytes(path, f"{text}\n".encode())


def read(path: Path) -> CaseResult | None:
    """Return the content of a case file, JSON or NetCDF; None if the file is missing, damaged or not a case file."""
    with suppress(OSError, ValueError, TypeError, KeyError, AttributeError, SceneError):
        result = _of_record(path) if path.suffix == ".nc" else _of_json(path)
        return result if result.key == path.stem else None
    return None


def _of_json(path: Path) -> CaseResult:
    content = json.loads(path.read_text("utf-8"))
    if content.pop("digest") != _digest(content) or content.pop("format") != CASE_FORMAT:
        raise ValueError(f"{path}: damaged, or not the file of a case")
    return CaseResult(**content)


def _of_record(path: Path) -> CaseResult:
    if not netcdf.is_whole(path):
        raise ValueError(f"{path}: damaged, or not a record")
    record = store.load(path)
    return result_of(path.stem, record, tomllib.loads(record.scene))


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, ensure_ascii=False).encode()).hexdigest()
