"""What is compared: runs, cases of sweeps and measurements, each with a label; the first one is the reference."""

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

MOST = 8
"""Largest number of sources: more colours than that nobody tells apart."""


@dataclass(frozen=True)
class Source:
    """A run, a case of a sweep or a measurement."""

    label: str
    """Name in tables and figures."""
    scene: Mapping[str, Any]
    """The resolved scene as data; the header of a measurement."""
    figures: Mapping[str, Metric]
    """Figures of its summary."""
    reasons: Mapping[str, str]
    """Why a figure has no value."""
    record: Record | None
    """Its series; None for the case of a sweep without."""

    @property
    def is_measured(self) -> bool:
        """Whether it was measured, not simulated."""
        return self.record is not None and self.record.model == measured.MODEL


def sources(paths: Sequence[Path]) -> list[Source]:
    """Read what is to be compared.

    Raises
    ------
    SceneError
        Too few, too many, or one of them is not a result.
    """
    if not 2 <= len(paths) <= MOST:
        raise SceneError(f"compare: got {len(paths)} results, must be 2 to {MOST}; the first one is the reference")
    return [_source(path, label) for path, label in zip(paths, _labels(paths), strict=True)]


def records(given: Sequence[Source]) -> dict[str, Record]:
    """Return the sources that have series, by label."""
    return {source.label: source.record for source in given if source.record is not None}


def _source(path: Path, label: str) -> Source:
    if path.suffix == ".json":
        case = case_file.read(path)
        if case is None:
            raise SceneError(f"{path}: not the file of a case of a sweep, or damaged")
        if case.status == case_file.FAILED:
            raise SceneError(f"{path}: a case that failed, without figures: {case.sentence}")
        return Source(label, case.scene, case.summary, case.reasons, None)
    record = load(path)
    summary = record.summary
    return Source(label, toml.parse(record.scene), summary.metrics, summary.reasons, record)


def _labels(paths: Sequence[Path]) -> Iterator[str]:
    """Yield a label for each path: its shortest ending that no other one has."""
    parts = [_said(path) for path in paths]
    for k, own in enumerate(parts):
        others = parts[:k] + parts[k + 1 :]
        length = next((n for n in range(1, len(own) + 1) if all(own[-n:] != each[-n:] for each in others)), 0)
        yield "/".join(own[-length:]) if length else f"{'/'.join(own[-1:])} ({k + 1})"


def _said(path: Path) -> list[str]:
    """Return the parts of a path that tell one result from another: without `result.nc` and ending."""
    place = path.resolve()
    place = place.parent if place.name == RESULT else place.with_suffix("") if place.is_file() else place
    return list(place.parts)


def flat(scene: Mapping[str, Any], before: str = "") -> dict[str, str]:
    """Return a scene as texts by dotted keys, lists of tables as one text."""
    found: dict[str, str] = {}
    for name, value in scene.items():
        inner = flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {f"{before}{name}": _text(value)}
        found |= inner
    return found


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
