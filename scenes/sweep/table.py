"""Results of the cases of a sweep as columns: varied values, status, and every entry of the summaries."""

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
"""Columns of every table, in addition to the varied keys and the entries of the summaries."""


@dataclass
class Table:
    """A row for each of C cases, in the order of the design."""

    design: Design
    keys: list[str] = field(default_factory=list)
    """Key of each case, which is the stem of the file."""
    status: list[str] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    """Reason why a case did not finish, or why values are missing; empty if nothing is missing."""
    seeds: list[int] = field(default_factory=list)
    figures: dict[str, FloatArray] = field(default_factory=dict)
    """Numbers of the summaries by name, and lengths of lists, each of shape (C,), NaN for cases without a value."""
    errors: dict[str, FloatArray] = field(default_factory=dict)
    """Errors of these numbers, each of shape (C,), NaN for cases without a known error."""
    segments_per_wave: list[float] = field(default_factory=list)
    """Commanded wavelength [segments], NaN for a gait without a wavelength."""
    timing: dict[str, FloatArray] = field(default_factory=dict)
    """Wall-clock values, each of shape (C,): these differ when a case is run again."""

    @classmethod
    def of(cls, design: Design, results: Iterable[CaseResult]) -> Table:
        """Return the table of results, one for each case of a design; the results are read one at a time."""
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
        """Whether each case finished, shape (C,)."""
        done: NDArray[np.bool_] = np.array(self.status) == DONE
        return done

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Whether each case was run and did not finish, shape (C,)."""
        failed: NDArray[np.bool_] = ~self.done & (np.array(self.status) != NOT_RUN)
        return failed

    @property
    def ending(self) -> str:
        """Status of the sweep: `done`, `incomplete` if a case failed, `interrupted` if a case was not run."""
        if NOT_RUN in self.status:
            return "interrupted"
        return "incomplete" if self.failed.any() else "done"

    def values(self) -> Iterator[dict[str, Cell]]:
        """Yield the varied values of each case by key, converted by `cell`."""
        for case in self.design.cases():
            yield {key: cell(value) for key, value in case.items()}

    def rows(self) -> Iterator[dict[str, Cell]]:
        """Yield each case: key, values, status, reason, seed and entries of the summary by name."""
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
    """Return a value of a scene for a table: a number or a text; lists become TOML text."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return toml_value(value)
    return value


def is_numeric(varied: Varied) -> bool:
    """Return whether all values of a varied key are numbers."""
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in varied.values)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
