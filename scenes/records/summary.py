"""The figures of merit of a run: `summary.json`, where a figure without a value has a reason instead."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from scenes.records.files import write_bytes

Cell = float | int | str | None

Figure = Cell | list[dict[str, Cell]]
"""A figure of merit, or a table of them: a row for each case of a study."""


@dataclass(frozen=True)
class Summary:
    """Figures by name; one that is None, NaN or infinite becomes None and needs a reason.

    Attributes
    ----------
    figures : mapping of name to float, int, str, None, or a list of rows
    reasons : mapping of name to str
        Why a figure has no value.
    """

    figures: Mapping[str, Figure]
    reasons: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        figures = {name: figure if _has_value(figure) else None for name, figure in self.figures.items()}
        absent = [name for name, figure in figures.items() if figure is None]
        unexplained = sorted(set(absent) - self.reasons.keys())
        if unexplained:
            raise ValueError(f"summary: {', '.join(unexplained)} without a value, must have a reason")
        object.__setattr__(self, "figures", MappingProxyType(figures))
        object.__setattr__(self, "reasons", MappingProxyType({name: self.reasons[name] for name in absent}))

    def __getitem__(self, name: str) -> Figure:
        """Return a figure by its name."""
        return self.figures[name]

    def to_dict(self) -> dict[str, Any]:
        """Return the figures, and the reasons under `reasons`, as JSON can hold them."""
        return {**self.figures, "reasons": dict(self.reasons)}


def write_summary(summary: Summary, timing: Mapping[str, float], path: Path) -> None:
    """Write the figures and the wall-clock figures as JSON, whole or not at all.

    Raises
    ------
    DiscError
        The file cannot be written.
    """
    content = {**summary.to_dict(), **timing}
    write_bytes(path, (json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())


def without_nan(content: Any) -> Any:
    """Return content for JSON, with None in place of each number that is not finite."""
    if isinstance(content, Mapping):
        return {key: without_nan(item) for key, item in content.items()}
    if isinstance(content, list | tuple):
        return [without_nan(item) for item in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _has_value(figure: Figure) -> bool:
    return figure is not None and not (isinstance(figure, float) and not math.isfinite(figure))
