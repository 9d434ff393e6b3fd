"""Names and text forms of the figures of a study: axes, figures of the summary, views of them."""

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
    """A varied key in the words of a report."""

    varied: Varied
    words: str

    @property
    def unit(self) -> str:
        """Unit, empty for a pure number and for names."""
        return "" if self.varied.unit == "1" else self.varied.unit

    @property
    def label(self) -> str:
        """Words and unit."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words

    @property
    def is_number(self) -> bool:
        """Whether the values are numbers."""
        return is_numeric(self.varied)

    def told(self, *places: int) -> str:
        """Return a value with its unit, or a range from a first to a last value."""
        values = [cell(self.varied.values[place]) for place in places]
        words = " to ".join(f"{value:.3g}" if isinstance(value, int | float) else str(value) for value in values)
        return f"{words} {self.unit}".strip()


@dataclass(frozen=True)
class Measure:
    """A figure of the summary in the words of a report."""

    name: str
    words: str
    unit: str
    better: str
    """`more` or `less`, depending on which is better; empty if neither is."""

    @property
    def label(self) -> str:
        """Words and unit."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words

    def told(self, value: float) -> str:
        """Return a value with its unit."""
        return f"{written(value, self.unit, 3)} {self.unit}".strip()


def rounded(off: FloatArray) -> FloatArray:
    """Return errors rounded as in print, so that level values are level in print too."""
    return np.array([rounded_up(each) for each in off.ravel().tolist()]).reshape(off.shape)


@dataclass(frozen=True)
class View:
    """A figure of the cases, either plain or at equal values of another figure."""

    where: str
    """Conditions of the view in words; empty if there is nothing to say."""
    measure: Measure
    values: FloatArray
    """Shape (X, C), NaN where a case has no value."""
    off: FloatArray
    """Errors of the values, shape (X, C), NaN where an error is unknown."""

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Whether a case has a value with an unknown error, although other cases have known errors, shape (X, C)."""
        return np.asarray(np.isfinite(self.values) & ~np.isfinite(self.off) & np.isfinite(self.off).any())

    def without(self, left_out: NDArray[np.bool_]) -> View:
        """Return the view without some cases, shape (X, C), and without the `unknown` cases."""
        return replace(self, values=np.where(left_out | self.unknown, np.nan, self.values))

    def told(self, x: int, curve: int) -> str:
        """Return the value of a case with its error and its unit."""
        return f"{self.number(x, curve)} {self.measure.unit}".strip()

    def number(self, x: int, curve: int) -> str:
        """Return the value of a case with its error; `none` if the case has no value."""
        value, off = float(self.values[x, curve]), float(self.off[x, curve])
        return with_error(value, off, self.measure.unit) if np.isfinite(value) else "none"
