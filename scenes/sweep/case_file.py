"""The file of a case of a sweep. It contains the results, and the scene to run the case again.

The file is `<key>.json` in the folder `cases` of the sweep. If whole records are stored, it is `<key>.nc` instead, with
the same content as the `result.nc` of `worm3d run`. A case that failed without a record has a JSON file even then.
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
"""Name of the folder with the files of the cases, in the folder of a sweep."""
CASE_FORMAT = "worm3d case 1"
FAILED_STATUS = "failed"
"""Status of a case that has no record, because the scene is impossible, an error occurred, the time limit was exceeded,
or the worker died. In the last two situations, the case has no file either."""
NOT_RUN = "not run"
"""Status of a case that has no file, because the sweep was stopped before the case ended."""


@dataclass(frozen=True)
class CaseResult:
    """Result of a case, without the series over time."""

    key: str
    """Key of the case (`scenes.sweep.key`), which is the name of its file without the ending."""
    name: str
    """Name of the scene."""
    model: str
    status: str
    """`done`, `diverged` or `failed`, or `not run` if the sweep was stopped before the case ended."""
    sentence: str
    """Sentence that says how the case ended."""
    seed: int
    summary: Mapping[str, Metric] = field(default_factory=dict)
    """Entries of `summary.json` by name; empty if the case failed."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Reasons why entries of the summary have no value, by name."""
    errors: Mapping[str, float] = field(default_factory=dict)
    """Estimated errors of entries of the summary by name, for entries whose errors are known."""
    timing: Mapping[str, float] = field(default_factory=dict)
    """Computing times, which are different if the case is run again."""
    versions: Mapping[str, str] = field(default_factory=dict)
    scene: Mapping[str, Any] = field(default_factory=dict)
    """The scene with all defaults, as nested dictionaries: the sections by name, and in them the values by key."""


def result_of(key: str, record: Record, scene: Mapping[str, Any]) -> CaseResult:
    """Return the result of a case, given the record of its run and its scene (`CaseResult.scene`)."""
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
        If the file cannot be written.
    """
    content = finite({"format": CASE_FORMAT, **vars(result)})
    text = json.dumps({**content, "digest": _digest(content)}, indent=1, ensure_ascii=False)
    write_bytes(path, f"{text}\n".encode())


def read(path: Path) -> CaseResult | None:
    """Return the result in the file of a case, JSON or NetCDF.

    Return None if the file is missing, is damaged, or is not the file of a case.
    """
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
