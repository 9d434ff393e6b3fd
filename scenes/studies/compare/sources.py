"""Sources of a comparison: runs, cases of sweeps, and measurements. The first source is the reference."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenes.language import toml
from scenes.language.errors import SceneError
from scenes.records import measured
from scenes.records.folder import RESULT
from scenes.records.record import Metric, Record
from scenes.records.store import load
from scenes.sweep import case_file

MAX_SOURCES = 8
"""Largest number of sources: more colours are hard to distinguish."""


@dataclass(frozen=True)
class Source:
    """A run, a case of a sweep or a measurement."""

    label: str
    """Name in tables and figures."""
    scene: Mapping[str, Any]
    """The scene with all keys, parsed from TOML; for a measurement, the header of its file."""
    figures: Mapping[str, Metric]
    """Figures of the summary."""
    reasons: Mapping[str, str]
    """Reasons why some figures have no value, by the name of the figure."""
    record: Record | None
    """Series of the source; None for a case of a sweep without series."""

    @property
    def is_measured(self) -> bool:
        """Whether the source is a measurement, not a simulation."""
        return self.record is not None and self.record.model == measured.MEASURED_MODEL


def sources(paths: Sequence[Path]) -> list[Source]:
    """Read the sources of a comparison.

    Raises
    ------
    SceneError
        Too few or too many paths, or a path that is not a result.
    """
    if not 2 <= len(paths) <= MAX_SOURCES:
        raise SceneError(
            f"compare: got {len(paths)} results, must be 2 to {MAX_SOURCES}; the first one is the reference"
        )
    return [_source(path, label) for path, label in zip(paths, _labels(paths), strict=True)]


def records(given: Sequence[Source]) -> dict[str, Record]:
    """Return the records of the sources with series, by label."""
    return {source.label: source.record for source in given if source.record is not None}


def _source(path: Path, label: str) -> Source:
    if path.suffix == ".json":
        case = case_file.read(path)
        if case is None:
            raise SceneError(f"{path}: not the file of a case of a sweep, or damaged")
        if case.status == case_file.FAILED_STATUS:
            raise SceneError(f"{path}: a case that failed, without figures: {case.sentence}")
        return Source(label, case.scene, case.summary, case.reasons, None)
    record = load(path)
    summary = record.summary
    return Source(label, toml.parse(record.scene), summary.metrics, summary.reasons, record)


def _labels(paths: Sequence[Path]) -> Iterator[str]:
    """Yield a label for each path: the shortest ending of the path that no other path has."""
    parts = [_said(path) for path in paths]
    for k, own in enumerate(parts):
        others = parts[:k] + parts[k + 1 :]
        length = next((n for n in range(1, len(own) + 1) if all(own[-n:] != each[-n:] for each in others)), 0)
        yield "/".join(own[-length:]) if length else f"{'/'.join(own[-1:])} ({k + 1})"


def _said(path: Path) -> list[str]:
    """Return the parts of a path, without a final `result.nc` and without the suffix of a file."""
    place = path.resolve()
    place = place.parent if place.name == RESULT else place.with_suffix("") if place.is_file() else place
    return list(place.parts)


def flat(scene: Mapping[str, Any], before: str = "") -> dict[str, str]:
    """Return the values of a scene as texts by dotted keys; a list of tables becomes a single text.

    Parameters
    ----------
    scene : mapping
    before : str
        Prefix of all keys.
    """
    found: dict[str, str] = {}
    for name, value in scene.items():
        inner = flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {f"{before}{name}": _text(value)}
        found |= inner
    return found


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
