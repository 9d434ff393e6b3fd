"""Axes, figures and values of a study, and the texts that describe them in a report."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scenes.sweep.design import Varied
from scenes.sweep.table import cell, is_numeric
from worm3d.values.arrays import FloatArray
from worm3d.values.metrics import rounded_up, with_error, written


@dataclass(frozen=True)
class Axis:
    """An axis of a study: a varied key, and its name in reports."""

    varied: Varied
    words: str

    @property
    def unit(self) -> str:
        """Unit of the values; empty for dimensionless values and for names."""
        return "" if self.varied.unit == "1" else self.varied.unit

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words

    @property
    def is_number(self) -> bool:
        """Whether the values are numbers."""
        return is_numeric(self.varied)

    def told(self, *places: int) -> str:
        """Return a text with the value at one place, or with the range between two places, and the unit."""
        values = [cell(self.varied.values[place]) for place in places]
        words = " to ".join(f"{value:.3g}" if isinstance(value, int | float) else str(value) for value in values)
        return f"{words} {self.unit}".strip()


@dataclass(frozen=True)
class Measure:
    """A figure, a number from the summary of a run, and its name in reports."""

    name: str
    words: str
    unit: str
    better: str
    """Which values are better: "more" for larger values, "less" for smaller values, or empty."""

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words

    def told(self, value: float) -> str:
        """Return a value with its unit."""
        return f"{written(value, self.unit, 3)} {self.unit}".strip()


def rounded(off: FloatArray) -> FloatArray:
    """Return errors rounded up as in reports, so that values that are level also look level in the reports."""
    return np.array([rounded_up(each) for each in off.ravel().tolist()]).reshape(off.shape)


@dataclass(frozen=True)
class View:
    """Values of a figure in all cases, for X values of the first axis and C values of the second axis.

    The values are either taken from the runs, or interpolated so that another figure is the same in all cases.
    """

    where: str
    """Text with the conditions under which the values hold; may be empty."""
    measure: Measure
    values: FloatArray
    """Shape (X, C); NaN if a case has no value."""
    off: FloatArray
    """Errors of the values, shape (X, C); NaN if an error is unknown."""

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Whether a case has a value with an unknown error while other cases have known errors, shape (X, C)."""
        return np.asarray(np.isfinite(self.values) & ~np.isfinite(self.off) & np.isfinite(self.off).any())

    def without(self, left_out: NDArray[np.bool_]) -> View:
        """Return the view with NaN for the cases in `left_out`, shape (X, C), and for the cases in `unknown`."""
        return replace(self, values=np.where(left_out | self.unknown, np.nan, self.values))

    def told(self, x: int, curve: int) -> str:
        """Return the value of a case with its error and its unit."""
        return f"{self.number(x, curve)} {self.measure.unit}".strip()

    def number(self, x: int, curve: int) -> str:
        """Return the value of a case with its error; `none` if the case has no value."""
        value, off = float(self.values[x, curve]), float(self.off[x, curve])
        return with_error(value, off, self.measure.unit) if np.isfinite(value) else "none"
