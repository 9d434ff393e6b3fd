"""Results of a sweep as a table. Its columns are the varied keys, the status, and the entries of the summaries."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.language.toml import value as toml_value
from scenes.records.record import Cell, Metric
from scenes.sweep.case_file import NOT_RUN, CaseResult
from scenes.sweep.design import Design, Varied
from scenes.sweep.waves import segments_per_wave
from worm3d.values.arrays import FloatArray

DONE = "done"

OF_A_CASE = ("case", "status", "reason", "seed")
"""Columns that every table has in addition to the varied keys and the entries of the summaries."""


@dataclass
class Table:
    """The results of the C cases of a sweep, with a row for each case in the order of the design."""

    design: Design
    keys: list[str] = field(default_factory=list)
    """Key of each case (`scenes.sweep.key`)."""
    status: list[str] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    """For each case, the reason why it failed, or why it lacks values; empty if it has all values."""
    seeds: list[int] = field(default_factory=list)
    figures: dict[str, FloatArray] = field(default_factory=dict)
    """Entries of the summaries that are numbers, by name, each of shape (C,). A list is represented by its length.
    Cases without a value have NaN."""
    errors: dict[str, FloatArray] = field(default_factory=dict)
    """Estimated errors of these entries, by name, each of shape (C,). Cases without an estimate have NaN."""
    segments_per_wave: list[float] = field(default_factory=list)
    """Wavelength of the gait of each case [segments]. It is NaN for a gait without a wavelength."""
    timing: dict[str, FloatArray] = field(default_factory=dict)
    """Computing times by name, each of shape (C,). They are different if a case is run again."""

    @classmethod
    def of(cls, design: Design, results: Iterable[CaseResult]) -> Table:
        """Return the table of results. There must be one result for each case, in the order of the design."""
        table = cls(design)
        for result in results:
            table._add(result)
        if len(table) != len(design):
            raise ValueError(f"results: got {len(table)} of them, must be one for each of {len(design)} cases")
        return table

    def __len__(self) -> int:
        return len(self.keys)

    def _add(self, result: CaseResult) -> None:
        row = len(self)
        ended = result.status == DONE
        self.keys.append(result.key)
        self.status.append(result.status)
        self.reasons.append("; ".join(sorted(set(result.reasons.values()))) if ended else result.sentence)
        self.seeds.append(result.seed)
        self.segments_per_wave.append(segments_per_wave(result))
        if ended:
            self._enter(self.figures, row, result.summary)
            self._enter(self.errors, row, result.errors)
            self._enter(self.timing, row, result.timing)

    def _enter(self, columns: dict[str, FloatArray], row: int, metrics: Mapping[str, Metric]) -> None:
        for name, metric in metrics.items():
            number = len(metric) if isinstance(metric, list) else metric
            if not isinstance(number, str):
                if name not in columns:
                    columns[name] = np.full(len(self.design), np.nan)
                columns[name][row] = np.nan if number is None else number

    @property
    def done(self) -> NDArray[np.bool_]:
        """Whether each case has the status `done`, shape (C,)."""
        done: NDArray[np.bool_] = np.array(self.status) == DONE
        return done

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each case has diverged or failed, shape (C,)."""
        failed: NDArray[np.bool_] = ~self.done & (np.array(self.status) != NOT_RUN)
        return failed

    @property
    def ending(self) -> str:
        """Status of the sweep: `interrupted` if a case was not run, else `incomplete` if a case failed, else `done`."""
        if NOT_RUN in self.status:
            return "interrupted"
        return "incomplete" if self.failed.any() else "done"

    def values(self) -> Iterator[dict[str, Cell]]:
        """Yield the values of the varied keys of each case, by key, as cells of a table (`cell`)."""
        for case in self.design.cases():
            yield {key: cell(value) for key, value in case.items()}

    def rows(self) -> Iterator[dict[str, Cell]]:
        """Yield the row of each case, with the cells by the names of the columns."""
        for row, values in enumerate(self.values()):
            yield {
                "case": self.keys[row],
                **values,
                "status": self.status[row],
                "reason": self.reasons[row],
                "seed": self.seeds[row],
                **{name: _number(column[row]) for name, column in self.figures.items()},
            }


def cell(value: Any) -> Cell:
    """Return a value of a scene as a cell of a table. Values other than numbers and texts become TOML text."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return toml_value(value)
    return value


def is_numeric(varied: Varied) -> bool:
    """Return whether all values of a varied key are numbers."""
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in varied.values)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
